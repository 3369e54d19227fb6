"""Directions drawn from an environment map by lib/environment.glsl: do they follow their pdf, at poles and seam too?

What is drawn by is a table of our own making (harness/scene/importance.py), which is held against its definition by
arithmetic elsewhere; here it is the shader's use of it that is judged, on a map with a sun, a lamp on a pole and one on
the seam, and so few rows that the poles are a third of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from harness.checks.chi2 import chi2
from harness.checks.domains import Crowded, Domain, Sphere
from harness.checks.finding import Finding
from harness.checks.integral import integral
from harness.checks.shader import Probe
from harness.gpu.probes import Picture
from harness.scene.importance import Tables, bilinear, tables_of, tent_integrals

ROWS, COLUMNS = 9, 14
SUN, POLE_LAMP, SEAM_LAMP = ((2, 5), 12.0), ((0, 9), 90.0), ((6, 0), 9.0)
COUNT = 1 << 17
STEPS = 7  # midpoints along each side of a cell: an image is smooth between its texels
NORTH, SOUTH = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
DOMAINS: tuple[tuple[str, Domain], ...] = (("", Sphere(NORTH)), (" about the first row's pole", Crowded(NORTH)),
                                           (" about the last row's pole", Crowded(SOUTH)))
UNIT = 1e-5  # of a direction's length, in float32
LOOKUP = 1e-5  # of the largest texel
INTEGRAL = 1e-4  # of midpoints over an image so small
RATIO = 1e-4  # of the mean of radiance / pdf, by channel; COUNT points of a Sobol sequence know it to 6e-5


def findings(probe: Probe) -> Iterator[Finding]:
    """Of the image's lookup, which is the pdf as well, and of directions drawn by it."""
    texels = image()
    tables = tables_of(texels)
    numbers = np.random.default_rng(0).random((COUNT, 3), dtype=np.float32)
    drawn, _, looked_up = probed(probe, texels, tables, numbers, Sphere().forward(numbers[:, :2].astype(np.float64)))
    yield _lookup(texels, tables, Sphere().forward(numbers[:, :2].astype(np.float64)), looked_up)

    def pdf(d: np.ndarray) -> np.ndarray:
        return probed(probe, texels, tables, np.zeros_like(d), d)[2][:, 3].astype(np.float64)

    total = integral(pdf, Sphere(NORTH), tolerance=INTEGRAL)
    yield replace(total, function="environment_texel", sentence=f"{total.sentence}, as the alpha of an image")
    yield from _directions(tables, drawn[:, :3].astype(np.float64))
    yield _corners(probe, texels, tables)
    yield _ratio(probe, texels, tables)


def image() -> np.ndarray:
    """(ROWS, COLUMNS, 3) float32: noise, and lamps where errors hide."""
    texels = np.random.default_rng(7).uniform(0.2, 1.2, (ROWS, COLUMNS, 3))
    for place, radiance in (SUN, POLE_LAMP, SEAM_LAMP):
        texels[place] = radiance
    return texels.astype(np.float32)


def probed(probe: Probe, texels: np.ndarray, tables: Tables, numbers: np.ndarray,
           directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For numbers (N, 3): directions drawn and their pdf, their radiance; radiance and pdf of `directions` (N, 3). All
    (N, 4) float32, in the image's own space."""
    rgba = np.concatenate([texels, tables.density[..., None]], axis=-1)
    height, width = texels.shape[:2]
    size = (width, height, *tables.table.shape[1::-1])
    nothing = np.zeros(len(numbers))
    found = probe("environment_sampling.frag", np.c_[numbers, nothing], np.c_[directions, nothing], outputs=3,
                  uniforms={"size": tuple(map(float, size))},
                  pictures={"image": Picture(rgba, filtered=True, repeats=True), "table": Picture(tables.table)})
    return found[:, :4], found[:, 4:8], found[:, 8:]


def _lookup(texels: np.ndarray, tables: Tables, d: np.ndarray, found: np.ndarray) -> Finding:
    """Whether an image is interpolated as Mitsuba does."""
    expected = bilinear(np.concatenate([texels, tables.density[..., None]], axis=-1), d.astype(np.float32))
    off = np.nan_to_num(np.abs(found - expected) / expected.max(axis=0), nan=np.inf).max(axis=1)
    worst = ", ".join(f"{value:.3f}" for value in d[off.argmax()])
    return Finding("lookup", float(off.max()), 0.0, bool(off.max() <= LOOKUP), "an image is interpolated to within "
                   f"{off.max():.2g} of its largest texel, expected {LOOKUP:g}; worst at ({worst})", error=LOOKUP,
                   function="environment_texel")


def _directions(tables: Tables, drawn: np.ndarray) -> Iterator[Finding]:
    """Whether directions have length 1 and follow the density."""
    length = np.nan_to_num(np.abs(np.linalg.norm(drawn, axis=1) - 1), nan=np.inf).max()
    yield Finding("length", float(length), 0.0, bool(length <= UNIT), "directions are off unit length by "
                  f"{length:.2g}, expected {UNIT:g} at most", error=UNIT, function="sample_environment_texel")
    if length > UNIT:
        return
    for where, domain in DOMAINS:
        found = chi2(lambda _: drawn, lambda d: bilinear(tables.density, d), domain, count=len(drawn), steps=STEPS)
        yield replace(found, function="sample_environment_texel", sentence=f"{found.sentence}{where}")


def _corners(probe: Probe, texels: np.ndarray, tables: Tables) -> Finding:
    """Whether the smallest and the largest numbers, and those at the ends of bins, draw unit directions with a pdf."""
    last = 1 - 2.0**-24
    ends = np.array([0, 2.0**-24, 1 / 512, 0.5, 511 / 512, last])
    numbers = np.stack(np.meshgrid(ends, ends, ends), axis=-1).reshape(-1, 3)
    drawn = probed(probe, texels, tables, numbers, np.tile(NORTH, (len(numbers), 1)))[0].astype(np.float64)
    bad = ~((np.abs(np.linalg.norm(drawn[:, :3], axis=1) - 1) <= UNIT) & np.isfinite(drawn[:, 3]) & (drawn[:, 3] > 0))
    return Finding("ends", float(bad.sum()), 0.0, not bad.any(), f"{bad.sum()} of {len(bad)} triples of the smallest "
                   "and largest numbers draw no unit direction with a pdf above zero", error=0.0,
                   function="sample_environment_texel")


def _ratio(probe: Probe, texels: np.ndarray, tables: Tables) -> Finding:
    """Whether radiance / pdf has the mean ∫ radiance, by quadrature over the numbers."""
    numbers = np.floor(qmc.Sobol(3, seed=1).random(COUNT) * 2**24) / 2**24
    drawn, radiance, _ = probed(probe, texels, tables, numbers, np.tile(NORTH, (COUNT, 1)))
    found = (radiance[:, :3].astype(np.float64) / drawn[:, 3:]).mean(axis=0)
    expected = tent_integrals(ROWS, COLUMNS) @ texels.sum(axis=1, dtype=np.float64)
    off = np.nan_to_num(np.abs(found / expected - 1), nan=np.inf)
    worst = int(off.argmax())
    return Finding("weight", float(found[worst]), float(expected[worst]), bool(off[worst] <= RATIO), "radiance / pdf "
                   f"has the mean {found[worst]:.6g}, expected {expected[worst]:.6g} to within {RATIO:g} of it",
                   error=RATIO * float(expected[worst]), function="sample_environment_texel")
