"""How directions are drawn from an environment map: its density, its mean, and the table by which GLSL draws.

The radiance of a map is Σ L_ij T_ij over its texels (row i, column j), where the tent T_ij falls from 1 at the texel's
centre to 0 at its neighbours' centres, linearly in both angles: that is what a bilinear lookup is. The density is the
same sum, pdf(d) = Σ p_ij T_ij(d) per steradian, p_ij proportional to |L_ij|, the length of the texel's RGB, to within a
few percent. So:

- the pdf at d is one bilinear lookup at the place of the radiance, and is kept in the alpha of the image: who reads the
  radiance has read the pdf;
- it is above zero wherever the radiance is, has no steps, and is finite at the poles;
- it integrates to 1 exactly, with the closed-form integrals of tents, in which sin θ is;
- a draw picks a texel with probability p_ij ∫ T_ij, and then a direction with density T_ij / ∫ T_ij, in closed form
  (glsl/lib/environment.glsl).

By |L| and not by luminance, since that is what makes the sum of the channels' variances smallest, and a blue lamp is
drawn like a green one.

A texel is picked in three lookups. The rows are cut into bands of about the same probability, each band into blocks:
these two are looked up in tables of BINS bins, where bins hold one band, one block each; that is why probabilities are
rounded to whole bins. The texel of a block is drawn by an alias table. Bands and blocks keep what points of the square
that are spread evenly have: the error of an unoccluded diffuse surface under sky.exr by 64 of them was 0.22 of that
by independent numbers, by an alias table of the whole map 0.75, by an inverse CDF 0.21. On llvmpipe an iteration with
two directions (23 ns for sky.exr, 100 ns for a map of 1024 x 512 with nothing drawn) took 16 and 72 ns more with it, 8
and 71 with an alias table alone, 24 and 196 with a quadtree, 60 and 320 with an inverse CDF by binary search.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, replace

import numpy as np

from harness.errors import HarnessError
from harness.scene.bitmaps import environment_texels
from harness.scene.model import RGB, EnvironmentMap, as_matrix

# Bands of a map, and blocks of a band, at most: each has that part of the probability at least, or is a single row or
# column. More of them gain nothing with less than 1000 samples.
STRATA = 32
# Into how many bins the probability of the map is cut, and that of each band; a power of two, for exact arithmetic.
BINS = 512
# Of a mean, so that a map that is the same everywhere has nothing above it.
ROUNDING = 1e-6
# Maps whose tables are kept: at most four float32 a texel and array.
_KEPT = 4


def mean_radiance(environment: EnvironmentMap) -> RGB:
    """The mean over the sphere of the bilinear map times its scale, exactly; (0, 0, 0) for a black map.

    Raises SceneError where the file changed since the scene was loaded.
    """
    texels = environment_texels(environment)
    shares = tent_integrals(*texels.shape[:2]) / (4 * np.pi)
    red, green, blue = environment.scale * (shares @ texels.sum(axis=1, dtype=np.float64))
    return float(red), float(green), float(blue)


def is_black(environment: EnvironmentMap) -> bool:
    """Whether no light comes from the map, so that nothing can be drawn from it."""
    return max(mean_radiance(environment)) == 0


def tent_integrals(rows: int, columns: int) -> np.ndarray:
    """∫ T_ij over the sphere, steradians, by row, (rows,); they are the same in all columns and sum to 4π / columns.

    With Δ = π / (rows - 1) the angle of a row: sin θ_i (2 sin(Δ/2))² / Δ, and 1 - sin(Δ) / Δ on the poles.
    """
    step = np.pi / (rows - 1)
    of_row = np.sin(np.arange(rows) * step) * (2 * np.sin(step / 2))**2 / step
    # 1 - sin(x)/x loses all digits of small x; its series does not.
    square = step * step
    series = square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    of_row[[0, -1]] = series if step < 0.1 else 1 - np.sin(step) / step
    return np.asarray(of_row * 2 * np.pi / columns)


def texel_density(environment: EnvironmentMap, *, compensated: bool = False) -> np.ndarray:
    """p_ij, per steradian, (rows, columns) float64, read-only: what is interpolated bilinearly, as the radiance is.

    HarnessError for a black map; SceneError where the file changed since the scene was loaded.
    """
    return _prepared(environment, compensated).density


def sampling_table(environment: EnvironmentMap, *, compensated: bool = False) -> np.ndarray:
    """What GLSL picks a texel by, as in `Tables`, read-only. Errors as `texel_density`."""
    return _prepared(environment, compensated).table


def pdf(environment: EnvironmentMap, directions: np.ndarray, *, compensated: bool = False) -> np.ndarray:
    """The density per steradian at unit directions of the scene (N, 3), in float64, (N,). Errors as `texel_density`."""
    rotation = np.array(environment.to_world)[:3, :3]
    return bilinear(texel_density(environment, compensated=compensated), np.asarray(directions, np.float64) @ rotation)


def bilinear(texels: np.ndarray, d: np.ndarray) -> np.ndarray:
    """What an image (rows, columns, …) has at directions (N, 3) of the map's space, in float64, (N, …)."""
    rows, columns = texels.shape[:2]
    x = np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi) * columns - 0.5
    y = np.arctan2(np.hypot(d[:, 0], d[:, 2]), d[:, 1]) / np.pi * (rows - 1)
    column, row = np.floor(x).astype(int), np.clip(np.floor(y).astype(int), 0, rows - 2)
    right, down = ((at - first).reshape(-1, *[1] * (texels.ndim - 2)) for at, first in ((x, column), (y, row)))
    near, far = column % columns, (column + 1) % columns
    upper = (1 - right) * texels[row, near] + right * texels[row, far]
    lower = (1 - right) * texels[row + 1, near] + right * texels[row + 1, far]
    return np.asarray((1 - down) * upper + down * lower)


@dataclass(frozen=True, eq=False)
class Tables:
    """How directions are drawn from an image of (rows, columns) texels.

    `density`: p_ij, per steradian, (rows, columns) float64. `table`: (rows + 1 + bands, at least BINS and columns, 4)
    float32. A texel at (row, column): its bin of its block's alias table, whose bins are equally likely: in a share x
    of it that texel is meant, in the rest the one at column y, row z. Row `rows`: by bin, a band, as (its first bin +
    BINS · its number, how many bins it has, its first row, its rows). Row `rows` + 1 + band: by bin, a block, as (its
    first bin, its bins, its first column, its columns).
    """

    density: np.ndarray
    table: np.ndarray


def tables_of(texels: np.ndarray, *, compensated: bool = False) -> Tables:
    """Those of an image, (rows, columns, 3), three rows at least. ValueError where it is black.

    `compensated`: only what is above the mean over the sphere is drawn, for use together with directions that a BSDF
    draws, which find the rest: Karlík et al. 2019, "MIS Compensation: Optimizing Sampling Techniques in Multiple
    Importance Sampling", ACM TOG 38(6). Over sky.exr the balance heuristic's variance is then 1.4 (glossy) to 1.75
    (diffuse) times smaller, that of environment.xml's image 1.6 times. All is drawn where nothing is above the mean.
    """
    size = np.sqrt(np.einsum("ijk,ijk->ij", texels, texels, dtype=np.float64))
    rows, columns = size.shape
    integrals = tent_integrals(rows, columns)[:, None]
    if compensated:
        above = np.maximum(size - (size * integrals).sum() / (4 * np.pi) * (1 + ROUNDING), 0)
        size = above if above.any() else size
    weights = np.multiply(size, integrals, out=size)
    if not weights.any():
        raise ValueError("nothing can be drawn from a black image")
    bands = runs(weights.sum(axis=1), STRATA)
    bins_of_bands = whole_bins(np.add.reduceat(weights.sum(axis=1), bands[:-1]))
    table = np.zeros((rows + len(bands), max(columns, BINS), 4), dtype=np.float32)  # holds such integers exactly
    probability = np.zeros_like(weights)
    for number, (top, bottom) in enumerate(itertools.pairwise(bands)):
        first, count = bins_of_bands[:number].sum(), bins_of_bands[number]
        table[rows, first:first + count] = first + BINS * number, count, top, bottom - top
        of_columns = weights[top:bottom].sum(axis=0)
        blocks = runs(of_columns, STRATA)
        bins_of_blocks = whole_bins(np.add.reduceat(of_columns, blocks[:-1]))
        first = 0
        for (left, right), bins in zip(itertools.pairwise(blocks), bins_of_blocks, strict=True):
            table[rows + 1 + number, first:first + bins] = first, bins, left, right - left
            first += bins
            block = weights[top:bottom, left:right]
            share, alias = sweep((block / block.sum()).ravel())
            place = np.stack([share, left + alias % (right - left), top + alias // (right - left)], axis=-1)
            table[top:bottom, left:right, :3] = place.reshape(*block.shape, 3)
            probability[top:bottom, left:right] = block / block.sum() * (count / BINS) * (bins / BINS)
    found = Tables(np.divide(probability, integrals, out=probability), table)
    for array in (found.density, found.table):
        array.setflags(write=False)
    return found


def sweep(probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An alias table of probabilities (N,) that sum to 1: the share in which each of N equally likely bins means its
    own outcome, and the other that it means in the rest.

    Walker 1974, "New fast method for generating discrete random numbers with arbitrary frequency distributions", built
    by the sweep of Hübschle-Schneider & Sanders 2022, "Parallel Weighted Random Sampling", ACM TOMS 48(3): bins with
    less than their part are filled up, in order, from those with more, in order; so neighbours have neighbours for
    aliases.
    """
    parts = probabilities * len(probabilities)
    light, heavy = np.flatnonzero(parts < 1), np.flatnonzero(parts >= 1)
    shares, aliases = np.ones(len(parts)), np.arange(len(parts))
    if not len(light) or not len(heavy):  # all the same, but for rounding
        return shares, aliases
    lacking, spare = np.cumsum(1 - parts[light]), np.cumsum(parts[heavy] - 1)
    # A light bin takes from the first heavy one that is not used up by those before it: by the very numbers that tell
    # below which light bin uses a heavy one up, or where they are equal the two would differ by rounding.
    giver = np.searchsorted(spare, np.concatenate([[0.0], lacking[:-1]]), side="right")
    shares[light], aliases[light] = parts[light], heavy[np.minimum(giver, len(heavy) - 1)]
    # The light bin that uses a heavy one up may take more than it had to spare, and the next heavy one stands in.
    taker = np.searchsorted(lacking, spare[:-1], side="left")
    used_up = taker < len(light)
    over = lacking[np.minimum(taker, len(light) - 1)] - spare[:-1]
    shares[heavy[:-1]] = np.where(used_up, np.clip(1 - over, 0, 1), 1.0)
    aliases[heavy[:-1]] = np.where(shares[heavy[:-1]] < 1, heavy[1:], heavy[:-1])
    return shares, aliases


def runs(probabilities: np.ndarray, most: int) -> np.ndarray:
    """Where runs of neighbours begin and the last ends, (R + 1,): at most `most` of them, as even as can be; each has a
    part of 1 / most of the probability (N,) at least."""
    total = np.concatenate([[0.0], np.cumsum(probabilities)])
    least = total[-1] / most * (1 - 1e-9)  # or the last of equal ones may miss it by rounding
    ends = [0]
    while total[-1] - total[ends[-1]] >= least:
        ends.append(min(int(np.searchsorted(total, total[ends[-1]] + least)), len(probabilities)))
    ends[-1] = len(probabilities)  # what is left over joins the last
    return np.array(ends)


def whole_bins(probabilities: np.ndarray) -> np.ndarray:
    """BINS bins shared out among runs by their probabilities (R,), by largest remainder."""
    parts = probabilities / probabilities.sum() * BINS
    bins = np.floor(parts).astype(int)
    bins[np.argsort(bins - parts, kind="stable")[:BINS - bins.sum()]] += 1
    return bins


def _prepared(environment: EnvironmentMap, compensated: bool) -> Tables:
    """Made once for each image."""
    black = (f"'{environment.path.name}' is black, so no direction can be drawn from it; take a strategy that gathers "
             "the environment where paths escape, or give the map light")
    if environment.scale == 0:
        raise HarnessError(black)
    try:
        # The scale and the place in the world change nothing.
        return _kept(replace(environment, scale=1.0, to_world=as_matrix(np.eye(4))), compensated)
    except ValueError:
        raise HarnessError(black) from None


@functools.lru_cache(maxsize=_KEPT)
def _kept(environment: EnvironmentMap, compensated: bool) -> Tables:
    return tables_of(environment_texels(environment), compensated=compensated)
