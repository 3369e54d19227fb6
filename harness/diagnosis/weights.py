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


def _weights(case: Case, vertex: Vertex, where: np.ndarray, cosine: np.ndarray, lobe: np.ndarray) -> np.ndarray:
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
