"""The checks that find the handout's errors: each measures one property of a shader's functions through a probe."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

from harness.course.variants import Variant

# A shader that is right fails a statistical check of this package less often than this, with other random numbers.
LEVEL = 1e-6
# Draws of one check, about what half an image of 1024² pixels takes for its first bounce.
DRAWS = 1 << 18

Pdf = Callable[[np.ndarray], np.ndarray]  # densities per steradian (N,) of directions (N, 3)


def pdf_integral(variant: Variant, alpha: float) -> float:
    """∫ pdf_lobe over the sphere by the midpoint rule, in steps of cos^(α+1), over which the lobe is spread evenly."""
    power = (np.arange(20_000) + 0.5) / 20_000
    cosine = power ** (1 / (alpha + 1))
    densities = variant.probe("pdf.frag", np.c_[cosine, np.full(len(cosine), alpha), np.zeros((len(cosine), 2))])[:, 2]
    return float(2 * np.pi * np.mean(densities * cosine / ((alpha + 1) * power)))


def lobe_directions(variant: Variant, alpha: float, angle: float, strategy: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """DRAWS directions (N, 3) about the normal (0,0,1) for a viewer at `angle` radians, and their weights (N,).

    The material is a white lobe with exponent `alpha` and no diffuse term; `strategy` as lib/phong.glsl numbers it.
    """
    normal = np.tile([0.0, 0.0, 1.0, 0.0], (DRAWS, 1))
    viewer = np.tile([np.sin(angle), 0.0, np.cos(angle), 0.0], (DRAWS, 1))
    found = variant.probe(
        "phong.frag", normal, viewer, viewer, outputs=3, defines={"STRATEGY": strategy, "HAS_DIFFUSE": 0},
        uniforms={"kd": (0.0, 0.0, 0.0), "ks": (1.0, 1.0, 1.0), "alpha": alpha, "p_glossy": 1.0, "replica": 1})
    return found[:, 4:7], found[:, 8]


def direction_chi2(directions: np.ndarray, pdf: Pdf) -> tuple[float, float]:
    """Pearson's χ² of directions (N, 3) against a pdf over the upper hemisphere, per degree of freedom; its p-value.

    Cells are rings of equal solid angle cut into sectors; what the pdf leaves for below the horizon, together with
    cells that expect fewer than 10, makes one more if it expects as many. The pdf is integrated over a cell by 40 × 40
    midpoints.
    """
    rings, sectors, steps = 16, 23, 40  # an odd number of sectors: none falls together with a symmetry of the basis
    height, turn = np.meshgrid((np.arange(rings * steps) + 0.5) / (rings * steps),
                               (np.arange(sectors * steps) + 0.5) / (sectors * steps) * 2 * np.pi, indexing="ij")
    radius = np.sqrt(1 - height**2)
    at = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=-1).reshape(-1, 3)
    share = pdf(at).reshape(rings, steps, sectors, steps).mean(axis=(1, 3)) * 2 * np.pi / (rings * sectors)
    above = directions[directions[:, 2] > 0]
    ring = np.minimum((above[:, 2] * rings).astype(int), rings - 1)
    sector = (np.arctan2(above[:, 1], above[:, 0]) / (2 * np.pi) % 1 * sectors).astype(int) % sectors
    observed = np.bincount(ring * sectors + sector, minlength=rings * sectors).astype(float)
    expected = share.ravel() * len(directions)
    large = expected >= 10
    rest = len(directions) - expected[large].sum()
    observed = np.append(observed[large], len(directions) - observed[large].sum())
    expected = np.append(expected[large], rest)
    if rest < 10:
        observed, expected = observed[:-1], expected[:-1]
    chi2 = float(np.sum((observed - expected) ** 2 / expected))
    dof = len(expected) - 1
    return chi2 / dof, float(stats.chi2.sf(chi2, dof))


def probed_lobe_pdf(variant: Variant, alpha: float, angle: float) -> Pdf:
    """`pdf_lobe` of the variant about the mirror image of a viewer at `angle`, for `direction_chi2`."""
    mirror = np.array([-np.sin(angle), 0.0, np.cos(angle)])

    def pdf(directions: np.ndarray) -> np.ndarray:
        rows = np.c_[directions @ mirror, np.full(len(directions), alpha), np.zeros((len(directions), 2))]
        return variant.probe("pdf.frag", rows)[:, 2]

    return pdf


def lobe_albedo(alpha: float, angle: float) -> float:
    """∫ (α+1)/(2π) max(r·l, 0)^α max(n·l, 0) dl for a viewer at `angle` radians, by midpoints about r."""
    power, turn = np.meshgrid((np.arange(2000) + 0.5) / 2000, (np.arange(250) + 0.5) / 250 * 2 * np.pi)
    cosine = power ** (1 / (alpha + 1))
    height = cosine * np.cos(angle) + np.sqrt(1 - cosine**2) * np.cos(turn) * np.sin(angle)
    return float(np.maximum(height, 0).mean())


def frame_defects(variant: Variant, axes: np.ndarray) -> np.ndarray:
    """How far the frame about each axis (N, 3) is from orthonormal: largest |FᵀF - 1|, infinite for NaN; (N,)."""
    found = variant.probe("basis.frag", np.c_[axes, np.zeros(len(axes))], outputs=3)
    frames = found.reshape(-1, 3, 4)[..., :3]
    gram = np.einsum("nij,nkj->nik", frames, frames)
    return np.nan_to_num(np.abs(gram - np.eye(3)).max(axis=(1, 2)), nan=np.inf)


def random_numbers(variant: Variant, sample: int, side: int = 256) -> np.ndarray:
    """The first eight numbers of one sample (pass) in each of side² pixels; (side, side, 8), y first."""
    y, x = (grid.ravel() for grid in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    nothing = np.zeros(side * side)
    found = variant.probe("random.frag", np.stack([x, y, nothing, nothing], axis=-1),
                          np.stack([nothing + (sample >> 16), nothing + (sample & 0xFFFF), nothing, nothing], axis=-1),
                          outputs=3)
    return found[:, :8].reshape(side, side, 8)


def distinct_share(numbers: np.ndarray) -> float:
    """How many distinct values there are among numbers (N,), as a share of what N uniform 24-bit numbers would have."""
    expected = 2.0**24 * -np.expm1(numbers.size * np.log1p(-(2.0**-24)))
    return float(len(np.unique(numbers)) / expected)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two arrays whose mean is zero: Σ a b / √(Σ a² Σ b²)."""
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum()))


def correlates(value: float, pairs: int) -> bool:
    """Whether a correlation of so many independent pairs is more than chance, at LEVEL."""
    return bool(abs(value) * np.sqrt(pairs) > stats.norm.isf(LEVEL / 2))
