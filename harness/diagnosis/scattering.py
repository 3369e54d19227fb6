"""Questions about how a path goes on from a vertex: with which material, which numbers, and in which direction."""

from __future__ import annotations

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.questions import QUESTIONS
from harness.diagnosis.tally import Tally
from harness.diagnosis.vertex import ENVIRONMENT, GRAZING, SCATTER, Progress, Vertex


def ask_scattering(case: Case, vertex: Vertex, same: np.ndarray, progress: Progress, tally: Tally) -> np.ndarray:
    """Whether the path scatters, with which material and which numbers; indices where both say that it does."""
    theirs = vertex.theirs
    drew = (vertex.called & SCATTER) != 0
    should = (theirs.cosine > 0) | (theirs.two_sided & (theirs.cosine < 0))
    should &= vertex.number + 1 < case.scene.max_depth
    clear = np.flatnonzero(same & (np.abs(theirs.cosine) > GRAZING))
    tally.ask("scatters", drew[clear], should[clear], vertex.lanes[clear], vertex=vertex.number,
              difference=(drew != should)[clear].astype(float))
    where = np.flatnonzero(same & drew & should)
    lanes = vertex.lanes[where]
    taken, wanted = vertex["direction"][where, 3], case.numbers_of_scattering
    if not case.own & {"loop", "sampler"}:
        # Of another generator's states nothing is known but how many numbers it gave.
        before, expected_before = ((vertex["weight"][where, 3], progress.taken[lanes]) if "generator" in case.own else
                                   (expected.uint32(vertex["states"][where, :2]), progress.state[lanes]))
        tally.ask("draws", np.c_[before, taken], np.c_[expected_before, np.full(len(lanes), wanted)], lanes,
                  vertex=vertex.number, notes=[("in sample_phong", taken != wanted)])
    _ask_material(vertex, where, tally)
    wrong = np.maximum(vertex["facing"][where, 3], vertex["surface"][where, 2] / (1 + np.abs(vertex["met"][where, :3])
                                                                                  .max(axis=1)))
    away = (vertex["facing"][where, :3] * vertex["ray"][where, :3]).sum(axis=1) > GRAZING
    tally.ask("arguments", wrong, np.zeros(len(where)), lanes, vertex=vertex.number,
              difference=np.where(away, np.inf, wrong))
    missed = np.flatnonzero((vertex.called & ENVIRONMENT) != 0)
    tally.ask("arguments", vertex["surface"][missed, 3], np.zeros(len(missed)), vertex.lanes[missed],
              vertex=vertex.number)
    return where


def _ask_material(vertex: Vertex, where: np.ndarray, tally: Tally) -> None:
    theirs = vertex.theirs
    kd, ks, alpha = (value[where].astype(np.float64) for value in (theirs.kd, theirs.ks, theirs.alpha))
    share = expected.glossy_share(kd, ks)
    diffuse, glossy = vertex["diffuse"][where], vertex["glossy"][where]
    has_lobe = ks.max(axis=1) > 0
    parts = {"kd": np.abs(diffuse[:, :3] - kd).max(axis=1), "ks": (np.abs(glossy[:, :3] - ks) / (1 + ks)).max(axis=1),
             "alpha": np.where(has_lobe, np.abs(diffuse[:, 3] - alpha) / (1 + alpha), 0),
             "p_glossy": np.abs(glossy[:, 3] - share)}
    difference = np.maximum.reduce(list(parts.values()))
    tally.ask("material", np.c_[diffuse[:, :3], glossy[:, :3], np.where(has_lobe, diffuse[:, 3], 0), glossy[:, 3]],
              np.c_[kd, ks, np.where(has_lobe, alpha, 0), share], vertex.lanes[where], vertex=vertex.number,
              difference=difference, shapes=vertex.shape[where],
              notes=[(name, part >= 0.5 * difference) for name, part in parts.items()])
    tally.note_shift("material", diffuse[:, 0], kd[:, 0], vertex.shape[where])


def ask_sampling(case: Case, vertex: Vertex, where: np.ndarray, tally: Tally) -> None:
    """By which lobe the direction was drawn, and whether it is the one that the numbers make of it."""
    sampler = vertex["tangent"][where, 3]
    where = where[sampler > 0]  # a library without these functions has a sampler of its own
    sampler = sampler[sampler > 0]
    lanes, number = vertex.lanes[where], vertex.number
    normal, viewer = vertex["facing"][where, :3], -vertex["ray"][where, :3]
    mirror = expected.mirrored(normal, viewer)
    alpha, share = vertex["diffuse"][where, 3], vertex["glossy"][where, 3]
    axis, exponent, u = vertex["lobe"][where, :3], vertex["lobe"][where, 3], vertex["numbers"][where, :2]
    if "sampler" not in case.own:
        given = _numbers(case, vertex, where)
        choice, numbers = given[:, 0], given[:, -2:]
        glossy = choice < share if case.chooses else np.full(len(where), case.drawn == "phong")
        which = {"uniform": 1, "cosine": 2}.get(case.drawn, 3)
        wanted_exponent = np.where(sampler == 1, 0.0, np.where(glossy, alpha, 1.0))
        wanted = np.c_[np.full(len(where), which), np.where(glossy[:, None], mirror, normal), wanted_exponent, numbers]
        found = np.c_[sampler, axis, exponent, u]
        apart = np.abs(found - wanted)
        apart[:, 4] /= 1 + wanted_exponent
        sure = vertex["direction"][where, 3] >= case.numbers_of_scattering  # else `draws` accuses
        sure &= (np.abs(choice - share) > 1e-6) | (not case.chooses)
        tally.ask("lobe", found[sure], wanted[sure], lanes[sure], vertex=number, difference=apart[sure].max(axis=1))
    tangent, bitangent = vertex["tangent"][where, :3], vertex["bitangent"][where, :3]
    if "to_world" in case.functions and tangent.any():
        _ask_frame(case, vertex, where, tangent, bitangent, axis, tally)
    if "sampler" in case.own:
        return
    turned = vertex["about"][where, :3]
    if turned.any():
        wanted = expected.about(axis, tangent, bitangent, np.full(len(where), 0.6), u[:, 1])
        tally.ask("azimuth", turned, wanted, lanes, vertex=number, shapes=vertex.shape[where])
    wanted = expected.about(axis, tangent, bitangent, expected.polar_cosine(sampler, exponent, u[:, 0]), u[:, 1])
    direction, drawn = vertex["direction"][where, :3], vertex["drawn"][where, :3]
    # What a sampler returned must also be what sample_phong returns.
    kept = np.abs(direction - drawn).max(axis=1) <= QUESTIONS["direction"].tolerance
    tally.ask("direction", direction, wanted, lanes, vertex=number, shapes=vertex.shape[where],
              notes=[("sample_phong", ~kept), *((word, kept & (sampler == which)) for which, word in
                                                ((1, "sample_uniform"), (2, "sample_cosine"), (3, "sample_lobe")))])


def _numbers(case: Case, vertex: Vertex, where: np.ndarray) -> np.ndarray:
    """The numbers that sample_phong should take, one column each: those that its generator's state leads to; of a
    generator of one's own, those that it took."""
    count = case.numbers_of_scattering
    if "generator" in case.own:
        return vertex["taken"][where, :count]
    state = expected.uint32(vertex["states"][where, :2])
    return np.stack([expected.number(expected.advance(state, step)) for step in range(count)], axis=1)


def _ask_frame(case: Case, vertex: Vertex, where: np.ndarray, tangent: np.ndarray, bitangent: np.ndarray,
               axis: np.ndarray, tally: Tally) -> None:
    """The basis about an axis: ours, by which the oracle follows paths; of somebody's own any orthonormal one."""
    if "sampler" in case.own:
        basis = np.stack([tangent, bitangent, axis], axis=1)
        found = (basis @ np.swapaxes(basis, 1, 2)).reshape(-1, 9)
        found[:, 8] -= (axis**2).sum(axis=1) - 1  # the axis was given
        wanted = np.tile(np.eye(3).ravel(), (len(where), 1))
        sure = np.ones(len(where), dtype=bool)
    else:
        found, wanted = np.c_[tangent, bitangent], np.concatenate(expected.frame(axis), axis=1)
        sure = np.abs(axis[:, 2] - expected.TURNS_AT) > GRAZING
    tally.ask("frame", found[sure], wanted[sure], vertex.lanes[where[sure]], vertex=vertex.number,
              shapes=vertex.shape[where[sure]])
