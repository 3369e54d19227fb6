"""Questions about a vertex: what is met, how it looks, and where the path goes from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.surface import residual, shell
from harness.diagnosis.tally import Tally
from harness.gpu.tap import Observed, Records
from harness.reference.coupled_steps import NO_HIT, Vertices

# What the taps note of a vertex: which functions were called.
NORMAL, ENVIRONMENT, EMISSION, SCATTER = 2, 4, 8, 16
# Rays so nearly along a surface may be taken to be on either side of it.
GRAZING = 1e-5
# Mitsuba's cylinder is off by up to 5e-4 in float32, its quadratic cancels; the shader's by 1.4e-5.
COARSE = 50.0
# The mesh that Mitsuba has for a displaced sphere: its facets, in the measure of `distance`.
MESH = 100.0
# The outermost part of the shell about a displaced sphere, in which no ray need march where that is cut too small.
OUTERMOST = 0.94
# A normal's length is rounded once, by 1e-7: it counts so many times as much as its direction.
UNIT = 50.0
# How far an origin may be lifted off the surface, in units of 1 + its largest coordinate: Mitsuba's offset is 8.94e-5.
# A quarter of it meets its own surface again, twice as much leaks light past contacts.
LEAST_LIFT, MOST_LIFT = 0.5 * 8.94e-5, 2.0 * 8.94e-5


@dataclass
class Progress:
    """What is carried along the paths of a look, (N, ...): `state` of the generator before the next scattering, as the
    path's own recorded one leads to; `throughput` and `radiance` in float32 as the loop should have them."""

    state: np.ndarray
    throughput: np.ndarray
    radiance: np.ndarray
    direction: np.ndarray
    lifted: np.ndarray
    met: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True, eq=False)
class _Vertex:
    """The records of one vertex on the paths `lanes` that reach it, and what Mitsuba finds there."""

    number: int
    lanes: np.ndarray
    seen: Records
    theirs: Vertices
    shape: np.ndarray
    called: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.seen[name].astype(np.float64)


def begin(state: np.ndarray) -> Progress:
    """Before the first vertex."""
    count = len(state)
    nothing = np.zeros((count, 3))
    return Progress(state, np.ones((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32), nothing,
                    nothing.copy(), nothing.copy(), nothing.copy())


def ask_vertex(case: Case, seen: Observed, number: int, progress: Progress, tally: Tally) -> None:
    """All questions about vertex `number` of the paths that reach it."""
    lanes = np.flatnonzero(seen.paths["gaze"][:, 3] > number)
    if not len(lanes):
        return
    records = {name: values[lanes] for name, values in seen.vertices[number].items()}
    direction = records["ray"][:, :3]
    theirs = case.steps.vertices(records["origin"][:, :3], direction, records["direction"][:, :3])
    vertex = _Vertex(number, lanes, records, _within_reach(theirs, records["place"][:, 3]),
                     records["ray"][:, 3].astype(int), records["normal"][:, 3].astype(int))
    _ask_ray(case, seen, vertex, progress, tally)
    same = _ask_hit(case, vertex, tally)
    _ask_surface(case, vertex, same, tally)
    light = _ask_light(case, vertex, same, tally)
    progress.radiance[lanes] += progress.throughput[lanes] * light.astype(np.float32)
    scattered = _ask_scattering(case, vertex, same, progress, tally)
    _ask_sampling(case, vertex, scattered, tally)
    _ask_weight(case, vertex, scattered, tally)
    drew = (vertex.called & SCATTER) != 0
    weight = np.where(drew[:, None], records["weight"][:, :3], 0).astype(np.float32)
    progress.throughput[lanes] *= weight
    taken = np.where(drew, records["direction"][:, 3], 0).astype(int)
    for steps in np.unique(taken[taken > 0]):
        those = lanes[taken == steps]
        progress.state[those] = expected.advance(expected.uint32(seen.vertices[number]["states"][those, :2]), steps)
    progress.direction[lanes], progress.met[lanes] = records["direction"][:, :3], records["met"][:, :3]
    progress.lifted[lanes], progress.normal[lanes] = records["lifted"][:, :3], records["facing"][:, :3]
    if "loop" not in case.own:
        goes = drew & (progress.throughput[lanes] != 0).any(axis=1)
        further = seen.paths["gaze"][lanes, 3] > number + 1
        tally.ask("goes on", further, goes, lanes, vertex=number, difference=(further != goes).astype(float))


def _within_reach(theirs: Vertices, reach: np.ndarray) -> Vertices:
    """Mitsuba's ray has no end; what lies beyond the shader's is not met."""
    beyond = theirs.distance > reach * (1 + 1e-5)
    theirs.shape[beyond & (theirs.shape >= 0)] = -2  # nor is what Mitsuba gathers there what is gathered
    return theirs


def _ask_ray(case: Case, seen: Observed, vertex: _Vertex, progress: Progress, tally: Tally) -> None:
    """Whether the ray is the one that the camera made, or that was scattered, and starts where it should."""
    lanes, origin, reach = vertex.lanes, vertex["origin"][:, :3], vertex["place"][:, 3]
    if vertex.number == 0:
        eye, gaze = seen.paths["eye"][lanes], seen.paths["gaze"][lanes, :3]
        tally.ask("arguments", np.c_[origin, vertex["ray"][:, :3], reach], np.c_[eye[:, :3], gaze, eye[:, 3]], lanes,
                  difference=np.maximum(np.abs(origin - eye[:, :3]).max(axis=1), np.abs(reach - eye[:, 3])))
        return
    before = vertex.number - 1
    tally.ask("arguments", reach, np.full(len(lanes), NO_HIT), lanes, vertex=before,
              difference=(reach < 0.99 * NO_HIT).astype(float))
    place, normal = progress.met[lanes], progress.normal[lanes]
    unit = 1 + np.abs(place).max(axis=1)
    if "loop" not in case.own:
        apart = np.abs(vertex["ray"][:, :3] - progress.direction[lanes]).max(axis=1)
        asked = seen.vertices[before]["lifted"][lanes, 3] > 0
        moved = np.abs(origin - progress.lifted[lanes]).max(axis=1) / unit
        tally.ask("origin", np.c_[origin, vertex["ray"][:, :3]],
                  np.c_[np.where(asked[:, None], progress.lifted[lanes], origin), progress.direction[lanes]], lanes,
                  vertex=before, difference=np.maximum(apart, np.where(asked, moved, 0)))
        start = np.where(asked[:, None], progress.lifted[lanes], origin)
    else:
        start = origin
    lift = ((start - place) * normal).sum(axis=1) / unit
    aside = np.abs(start - place - normal * (lift * unit)[:, None]).max(axis=1) / unit
    outside = (lift < LEAST_LIFT) | (lift > MOST_LIFT) | (aside > MOST_LIFT)
    tally.ask("offset", lift, np.clip(lift, LEAST_LIFT, MOST_LIFT), lanes, vertex=before,
              difference=outside.astype(float))


def _ask_hit(case: Case, vertex: _Vertex, tally: Tally) -> np.ndarray:
    """Where both met the same shape."""
    theirs, mine = vertex.theirs, vertex.shape
    distance = np.where(mine >= 0, vertex["origin"][:, 3], NO_HIT)
    missed = (theirs.shape >= 0) & (theirs.distance < distance)
    known = theirs.shape >= -1
    about = np.where(missed, theirs.shape, mine)
    outside = _outside(case, vertex, about)
    tally.ask("hit", mine[known], theirs.shape[known], vertex.lanes[known], vertex=vertex.number,
              difference=(mine != theirs.shape)[known].astype(float),
              shapes=about[known], notes=[("entered wrongly", outside[known])])
    same = (mine >= 0) & (mine == theirs.shape)
    where = np.flatnonzero(same)
    of = mine[where]
    origin, t = vertex["origin"][where, :3], vertex["origin"][where, 3]
    across = np.abs(theirs.cosine[where]) / (1 + np.abs(origin).max(axis=1) + theirs.distance[where])
    apart = np.abs(t - theirs.distance[where]) * across
    slack = np.where(case.of_kind("cylinder")[of], COARSE, np.where(case.of_kind("displacedsphere")[of], MESH, 1.0))
    tally.ask("distance", t, theirs.distance[where], vertex.lanes[where], vertex=vertex.number, difference=apart,
              slack=slack, shapes=of, notes=[("entered wrongly", outside[where])])
    return same


def _outside(case: Case, vertex: _Vertex, about: np.ndarray) -> np.ndarray:
    """Of rays that should meet a displaced sphere, whether they start within its shell, or meet it at its outermost:
    what sets out on the march decides there."""
    found = np.zeros(len(about), dtype=bool)
    for shape in np.flatnonzero(case.of_kind("displacedsphere")[:-1]):
        on = about == shape
        sphere = case.scene.shapes[shape]
        found[on] = ((shell(sphere, vertex["origin"][on, :3]) < 1)
                     | (shell(sphere, vertex.theirs.point[on].astype(np.float64)) > OUTERMOST))
    return found


def _ask_surface(case: Case, vertex: _Vertex, same: np.ndarray, tally: Tally) -> None:
    """The way that the loop takes, the normal, and the texture coordinates."""
    hit = vertex.shape >= 0
    shaded, escaped = (vertex.called & NORMAL) != 0, (vertex.called & ENVIRONMENT) != 0
    tally.ask("branch", np.c_[shaded, escaped], np.c_[hit, ~hit], vertex.lanes, vertex=vertex.number,
              difference=((shaded != hit) | (escaped == hit)).astype(float))
    where = np.flatnonzero(same & shaded)
    of = vertex.shape[where]
    normal, theirs = vertex["turned"][where, :3], vertex.theirs.normal[where].astype(np.float64)
    slack = np.where(case.of_kind("cylinder")[of], COARSE, 1.0)
    outside = _outside(case, vertex, vertex.shape)
    for shape in np.unique(of[case.of_kind("displacedsphere")[of]]):
        on = of == shape
        found = residual(case.scene.shapes[shape], vertex["place"][where[on], :3], vertex["normal"][where[on], :3])
        tally.ask("distance", found.height, np.zeros(int(on.sum())), vertex.lanes[where[on]], vertex=vertex.number,
                  slack=found.slack, shapes=of[on], notes=[("entered wrongly", outside[where[on]])])
        theirs[on], slack[on] = normal[on] - found.normal, found.normal_slack
    long = UNIT * np.abs(np.linalg.norm(normal, axis=1) - 1) * slack
    tally.ask("normal", normal, theirs, vertex.lanes[where], vertex=vertex.number, slack=slack, shapes=of,
              difference=np.maximum(np.abs(normal - theirs).max(axis=1), long))
    met, point = vertex["met"][where, :3], vertex.theirs.point[where].astype(np.float64)
    off = np.abs(((met - point) * vertex.theirs.normal[where]).sum(axis=1)) / (1 + np.abs(point).max(axis=1))
    smooth = ~case.of_kind("displacedsphere")[of]
    tally.ask("place", met[smooth], point[smooth], vertex.lanes[where[smooth]], vertex=vertex.number,
              difference=off[smooth], slack=slack[smooth], shapes=of[smooth])
    uses = case.has_coordinates()[of]
    where, of = where[uses], of[uses]
    apart = _uv_apart(case, vertex["surface"][where, :2], vertex.theirs.uv[where], of)
    slack = np.where(case.of_kind("cylinder")[of], COARSE, 1.0)
    tally.ask("coordinate", vertex["surface"][where, :2], vertex.theirs.uv[where], vertex.lanes[where],
              vertex=vertex.number, difference=apart, slack=slack, shapes=of)


def _uv_apart(case: Case, mine: np.ndarray, theirs: np.ndarray, of: np.ndarray) -> np.ndarray:
    """How far texture coordinates are apart: angles modulo a turn, and less where their circle is small."""
    apart = np.abs(mine - theirs)
    for kinds, angle in ((("sphere", "cylinder"), 0), (("disk",), 1)):
        round_ = case.of_kind(*kinds)[of]
        turned = np.minimum(apart[:, angle], np.abs(1 - apart[:, angle]))
        sphere = case.of_kind("sphere")[of]
        circle = np.where(sphere, np.sin(np.pi * np.clip(theirs[:, 1], 0, 1)), 1.0)
        circle = np.where(case.of_kind("disk")[of], np.clip(theirs[:, 0], 0, 1), circle)
        apart[:, angle] = np.where(round_, turned * circle, apart[:, angle])
    return np.asarray(apart.max(axis=1)) if len(apart) else np.zeros(0)


def _ask_light(case: Case, vertex: _Vertex, same: np.ndarray, tally: Tally) -> np.ndarray:
    """What the shader gathered, (M, 3), zero where it asked for nothing."""
    theirs = vertex.theirs
    hit = vertex.shape >= 0
    asked, wanted = (vertex.called & EMISSION) != 0, (theirs.cosine > 0) & case.emits
    clear = np.flatnonzero(same & (np.abs(theirs.cosine) > GRAZING))
    tally.ask("gathers", asked[clear], wanted[clear], vertex.lanes[clear], vertex=vertex.number,
              difference=(asked != wanted)[clear].astype(float))
    gathered = (vertex.called & (EMISSION | ENVIRONMENT)) != 0
    light = np.where(gathered[:, None], vertex["light"][:, :3], 0.0)
    both = gathered & ((same & wanted) | (~hit & (theirs.shape == -1)))
    where = np.flatnonzero(both)
    expected_light = theirs.light[where].astype(np.float64)
    scale = 1e-3 + np.abs(expected_light).max(axis=1) + case.contrast_of_light()[vertex.shape[where]]
    difference = np.abs(light[where] - expected_light).max(axis=1) / scale
    tally.ask("light", light[where], expected_light, vertex.lanes[where], vertex=vertex.number, difference=difference,
              shapes=vertex.shape[where])
    tally.note_shift("light", light[where, 0], expected_light[:, 0], vertex.shape[where])
    return light


def _ask_scattering(case: Case, vertex: _Vertex, same: np.ndarray, progress: Progress, tally: Tally) -> np.ndarray:
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
    if not case.own & {"generator", "loop", "sampler"}:
        before = expected.uint32(vertex["states"][where, :2])
        taken = vertex["direction"][where, 3]
        wanted = 3 if case.chooses else 2
        tally.ask("draws", np.c_[before, taken], np.c_[progress.state[lanes], np.full(len(lanes), wanted)], lanes,
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


def _ask_material(vertex: _Vertex, where: np.ndarray, tally: Tally) -> None:
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


def _ask_sampling(case: Case, vertex: _Vertex, where: np.ndarray, tally: Tally) -> None:
    """By which lobe the direction was drawn, and whether it is the one that the numbers make of it."""
    sampler = vertex["tangent"][where, 3]
    where = where[sampler > 0]  # a library without these functions has a sampler of its own
    sampler = sampler[sampler > 0]
    lanes, number = vertex.lanes[where], vertex.number
    normal, viewer = vertex["facing"][where, :3], -vertex["ray"][where, :3]
    mirror = expected.mirrored(normal, viewer)
    alpha, share = vertex["diffuse"][where, 3], vertex["glossy"][where, 3]
    axis, exponent, u = vertex["lobe"][where, :3], vertex["lobe"][where, 3], vertex["numbers"][where, :2]
    state = expected.uint32(vertex["states"][where, :2])
    if not case.own & {"generator", "sampler"}:
        choice = expected.number(state)
        glossy = choice < share if case.chooses else np.full(len(where), case.strategy == "phong")
        which = 1 if case.strategy == "uniform" else 2 if case.plain_cosine else 3
        first = expected.advance(state, int(case.chooses))
        numbers = np.stack([expected.number(first), expected.number(expected.advance(first))], axis=1)
        wanted_exponent = np.where(sampler == 1, 0.0, np.where(glossy, alpha, 1.0))
        wanted = np.c_[np.full(len(where), which), np.where(glossy[:, None], mirror, normal), wanted_exponent, numbers]
        found = np.c_[sampler, axis, exponent, u]
        apart = np.abs(found - wanted)
        apart[:, 4] /= 1 + wanted_exponent
        sure = np.abs(choice - share) > 1e-6 if case.chooses else np.ones(len(where), dtype=bool)
        tally.ask("lobe", found[sure], wanted[sure], lanes[sure], vertex=number, difference=apart[sure].max(axis=1))
    tangent, bitangent = vertex["tangent"][where, :3], vertex["bitangent"][where, :3]
    if "to_world" in case.functions and tangent.any():
        _ask_frame(case, vertex, where, tangent, bitangent, axis, tally)
    if "sampler" in case.own:
        return
    for name, cosine, found in (("azimuth", np.full(len(where), 0.6), vertex["about"][where, :3]),
                                ("direction", expected.polar_cosine(sampler, exponent, u[:, 0]),
                                 vertex["direction"][where, :3])):
        if name == "azimuth" and not found.any():
            continue
        phi, sine = 2 * np.pi * u[:, 1:], np.sqrt(np.maximum(0, 1 - cosine**2))[:, None]
        wanted = sine * (np.cos(phi) * tangent + np.sin(phi) * bitangent) + cosine[:, None] * axis
        tally.ask(name, found, wanted, lanes, vertex=number, shapes=vertex.shape[where],
                  notes=[(word, sampler == which) for which, word in
                         ((1, "sample_uniform"), (2, "sample_cosine"), (3, "sample_lobe"))])


def _ask_frame(case: Case, vertex: _Vertex, where: np.ndarray, tangent: np.ndarray, bitangent: np.ndarray,
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


def _ask_weight(case: Case, vertex: _Vertex, where: np.ndarray, tally: Tally) -> None:
    """The densities, the BRDF and the weight of the direction that was drawn."""
    lanes, number, of = vertex.lanes[where], vertex.number, vertex.shape[where]
    normal, viewer = vertex["facing"][where, :3], -vertex["ray"][where, :3]
    direction, weight = vertex["direction"][where, :3], vertex["weight"][where, :3]
    alpha = vertex["diffuse"][where, 3]
    kd, ks = vertex["diffuse"][where, :3], vertex["glossy"][where, :3]
    cosine = (normal * direction).sum(axis=1)
    to_mirror = vertex["brdf"][where, 3] if "eval_phong" in case.functions else (
        expected.mirrored(normal, viewer) * direction).sum(axis=1)
    lobe, diffuse = expected.lobe_pdf(to_mirror, alpha), np.maximum(cosine, 0) / np.pi
    if "pdf_lobe" in case.functions and vertex["numbers"][:, 2:].any():
        for name, found, wanted in (("pdf_lobe", vertex["numbers"][where, 2], lobe),
                                    ("pdf_cosine", vertex["numbers"][where, 3], diffuse)):
            tally.ask("pdf", found, wanted, lanes, vertex=number, difference=np.abs(found - wanted) / (0.01 + wanted),
                      notes=[(name, np.ones(len(where), dtype=bool))], shapes=of)
            if name == "pdf_lobe":
                tally.note_shift("pdf", found, wanted, of)
    if vertex["brdf"].any():
        wanted = kd / np.pi + ks * lobe[:, None]
        found = vertex["brdf"][where, :3]
        tally.ask("brdf", found, wanted, lanes, vertex=number, shapes=of,
                  difference=np.abs(found - wanted).max(axis=1) / (0.01 + wanted.max(axis=1)))
        tally.note_shift("brdf", found[:, 0], wanted[:, 0], of)
    if "sampler" in case.own:
        return
    whole = _weights(case, vertex, where, cosine, lobe)
    # The side is Mitsuba's normal's: where the two differ by rounding, a grazing direction may be below one of them.
    above = np.abs(cosine) > GRAZING
    difference = np.abs(weight - whole).max(axis=1) / (0.01 + np.abs(whole).max(axis=1))
    tally.ask("weight", weight[above], whole[above], lanes[above], vertex=number, difference=difference[above],
              shapes=of[above])
    tally.note_shift("weight", weight[above, 0], whole[above, 0], of[above])


def _weights(case: Case, vertex: _Vertex, where: np.ndarray, cosine: np.ndarray, lobe: np.ndarray) -> np.ndarray:
    """f cos / pdf, (M, 3), of the recorded directions: Mitsuba's values over the densities of the strategy."""
    theirs, of = vertex.theirs, vertex.shape[where]
    alpha, share, diffuse = vertex["diffuse"][where, 3], vertex["glossy"][where, 3], np.maximum(cosine, 0) / np.pi
    kd, ks = theirs.kd[where].astype(np.float64), theirs.ks[where].astype(np.float64)
    # Mitsuba's mesh has other normals than the surface of a displaced sphere.
    meshed = case.of_kind("displacedsphere")[of]
    true = (kd / np.pi + ks * lobe[:, None]) * np.maximum(cosine, 0)[:, None]
    value = np.where(meshed[:, None], true, theirs.value[where])
    if case.strategy == "uniform":
        whole = value * (2 * np.pi)
    elif case.plain_cosine:
        whole = value / diffuse[:, None]
    elif case.strategy == "phong":
        whole = value / lobe[:, None]
    elif case.strategy == "lobes":
        if case.own:
            exponent = vertex["lobe"][where, 3]
            glossy = np.abs(exponent - alpha) < np.abs(exponent - 1)
        else:
            glossy = expected.number(expected.uint32(vertex["states"][where, :2])) < share
        # Each term against its own density, of which only the share is left: in a lobe's tail both are tiny.
        whole = np.where(glossy[:, None], ks * (cosine / share)[:, None], kd / (1 - share)[:, None])
    else:
        whole = value / ((1 - share) * diffuse + share * lobe)[:, None]
    return np.where(np.isfinite(whole) & (cosine > 0)[:, None], whole, 0.0)
