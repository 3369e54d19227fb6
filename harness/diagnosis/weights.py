"""Questions about the weight of a direction that was drawn: its densities, the BRDF, and f cos / pdf."""

from __future__ import annotations

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.tally import Tally
from harness.diagnosis.vertex import GRAZING, Vertex


def ask_weight(case: Case, vertex: Vertex, where: np.ndarray, tally: Tally) -> None:
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
        wanted = expected.brdf(kd, ks, lobe)
        found = vertex["brdf"][where, :3]
        tally.ask("brdf", found, wanted, lanes, vertex=number, shapes=of,
                  difference=np.abs(found - wanted).max(axis=1) / (0.01 + wanted.max(axis=1)))
        tally.note_shift("brdf", found[:, 0], wanted[:, 0], of)
    if "density" in case.own:
        return
    whole = _weight(case, vertex, where, cosine, lobe)
    # The side is Mitsuba's normal's: where the two differ by rounding, a grazing direction may be below one of them.
    above = np.abs(cosine) > GRAZING
    difference = np.abs(weight - whole).max(axis=1) / (0.01 + np.abs(whole).max(axis=1))
    tally.ask("weight", weight[above], whole[above], lanes[above], vertex=number, difference=difference[above],
              shapes=of[above])
    tally.note_shift("weight", weight[above, 0], whole[above, 0], of[above])


def _weight(case: Case, vertex: Vertex, where: np.ndarray, cosine: np.ndarray, lobe: np.ndarray) -> np.ndarray:
    """f cos / pdf, (M, 3), of the recorded directions: Mitsuba's values over the densities of the strategy."""
    theirs, of = vertex.theirs, vertex.shape[where]
    kd, ks = theirs.kd[where].astype(np.float64), theirs.ks[where].astype(np.float64)
    # Mitsuba's mesh has other normals than the surface of a displaced sphere.
    meshed = case.of_kind("displacedsphere")[of]
    true = expected.brdf(kd, ks, lobe) * np.maximum(cosine, 0)[:, None]
    value = np.where(meshed[:, None], true, theirs.value[where])
    share = vertex["glossy"][where, 3]
    glossy = vertex["taken"][where, 0] < share
    if case.drawn != "lobes" or "sampler" not in case.own:
        return expected.weight(case.drawn, value, kd, ks, share, cosine, lobe, glossy)
    # Which term a sampler of one's own has chosen is not known: what it draws has the weight of one of them.
    either = [expected.weight(case.drawn, value, kd, ks, share, cosine, lobe, np.full(len(where), term))
              for term in (False, True)]
    apart = [np.abs(vertex["weight"][where, :3] - each).max(axis=1) for each in either]
    return np.where((apart[0] <= apart[1])[:, None], *either)
