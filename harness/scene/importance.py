"""How directions are drawn from an environment map: its density, its mean, and the table by which GLSL draws.

The radiance of a map is Σ L_ij T_ij over its texels (row i, column j), where the tent T_ij falls from 1 at the texel's
centre to 0 at its neighbours' centres, linearly in both angles: that is what a bilinear lookup is. The density is the
same sum, pdf(d) = Σ p_ij T_ij(d) per steradian, p_ij proportional to |L_ij|, the length of the texel's RGB. So:

- the pdf at d is one bilinear lookup at the place of the radiance, and is kept in the alpha of the image: who reads the
  radiance has read the pdf;
- it is above zero wherever the radiance is, has no steps, and is finite at the poles;
- it integrates to 1 exactly, with the closed-form integrals of tents, in which sin θ is;
- a draw picks a texel with probability p_ij ∫ T_ij, and then a direction with density T_ij / ∫ T_ij: an alias table and
  a closed form (glsl/lib/environment.glsl).

By |L| and not by luminance, since that is what makes the sum of the channels' variances smallest, and a blue lamp is
drawn like a green one.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from harness.errors import HarnessError
from harness.scene.bitmaps import environment_texels
from harness.scene.model import RGB, EnvironmentMap, as_matrix

# Maps whose tables are kept: at most four float32 a texel and array.
_KEPT = 4


def mean_radiance(environment: EnvironmentMap) -> RGB:
    """The mean over the sphere of the bilinear map times its scale, exactly; (0, 0, 0) for a black map.

    Raises SceneError where the file changed since the scene was loaded.
    """
    texels = environment_texels(environment).astype(np.float64)
    shares = tent_integrals(*texels.shape[:2]) / (4 * np.pi)
    red, green, blue = environment.scale * (shares @ texels.sum(axis=1))
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


def texel_density(environment: EnvironmentMap) -> np.ndarray:
    """p_ij, per steradian, (rows, columns) float64, read-only: what is interpolated bilinearly, as the radiance is.

    HarnessError for a black map; SceneError where the file changed since the scene was loaded.
    """
    return _prepared(environment)[0]


def alias_table(environment: EnvironmentMap) -> np.ndarray:
    """(rows, columns, 4) float32, read-only, one bin a texel: a share, and the column and the row of another texel.

    Bins are equally likely; a bin's own texel is meant in that share of it, and the other in the rest. Errors as
    `texel_density`.
    """
    return _prepared(environment)[1]


def pdf(environment: EnvironmentMap, directions: np.ndarray) -> np.ndarray:
    """The density per steradian at unit directions of the scene (N, 3), in float64, (N,). Errors as `texel_density`."""
    density = texel_density(environment)
    rows, columns = density.shape
    local = np.asarray(directions, dtype=np.float64) @ np.array(environment.to_world)[:3, :3]
    x = np.arctan2(local[:, 0], -local[:, 2]) / (2 * np.pi) * columns - 0.5
    y = np.arctan2(np.hypot(local[:, 0], local[:, 2]), local[:, 1]) / np.pi * (rows - 1)
    column, row = np.floor(x).astype(int), np.clip(np.floor(y).astype(int), 0, rows - 2)
    right, down = x - column, y - row
    near, far = column % columns, (column + 1) % columns
    upper = (1 - right) * density[row, near] + right * density[row, far]
    lower = (1 - right) * density[row + 1, near] + right * density[row + 1, far]
    return np.asarray((1 - down) * upper + down * lower)


def sweep(probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An alias table of probabilities (N,) that sum to 1: shares (N,) and aliases (N,), as `alias_table` has them.

    Walker 1974, "New fast method for generating discrete random numbers with arbitrary frequency distributions", built
    by the sweep of Hübschle-Schneider & Sanders 2022, "Parallel Weighted Random Sampling", section 4: bins with less
    than their part are filled up, in order, from those with more, in order; so neighbours have neighbours for aliases.
    """
    parts = probabilities * len(probabilities)
    light, heavy = np.flatnonzero(parts < 1), np.flatnonzero(parts >= 1)
    shares, aliases = np.ones(len(parts)), np.arange(len(parts))
    if not len(light):
        return shares, aliases
    lacking, spare = np.cumsum(1 - parts[light]), np.cumsum(parts[heavy] - 1)
    # A light bin takes from the first heavy one that is not used up by those before it.
    giver = np.searchsorted(spare, lacking - (1 - parts[light]), side="right")
    shares[light], aliases[light] = parts[light], heavy[np.minimum(giver, len(heavy) - 1)]
    # The light bin that uses a heavy one up may take more than it had to spare, and the next heavy one stands in.
    taker = np.searchsorted(lacking, spare[:-1], side="left")
    used_up = taker < len(light)
    over = lacking[np.minimum(taker, len(light) - 1)] - spare[:-1]
    shares[heavy[:-1]] = np.where(used_up, np.clip(1 - over, 0, 1), 1.0)
    aliases[heavy[:-1]] = np.where(shares[heavy[:-1]] < 1, heavy[1:], heavy[:-1])
    return shares, aliases


def _prepared(environment: EnvironmentMap) -> tuple[np.ndarray, np.ndarray]:
    """The density and the table, made once for each image."""
    if environment.scale == 0:
        raise HarnessError(_black(environment.path.name))
    # The scale and the place in the world change neither.
    return _tables(replace(environment, scale=1.0, to_world=as_matrix(np.eye(4))))


@functools.lru_cache(maxsize=_KEPT)
def _tables(environment: EnvironmentMap) -> tuple[np.ndarray, np.ndarray]:
    texels = environment_texels(environment).astype(np.float64)
    rows, columns = texels.shape[:2]
    size = np.linalg.norm(texels, axis=2)
    weights = size * tent_integrals(rows, columns)[:, None]
    total = weights.sum()
    if total == 0:
        raise HarnessError(_black(environment.path.name))
    density = size / total
    shares, aliases = sweep((weights / total).ravel())
    table = np.zeros((rows, columns, 4), dtype=np.float32)
    table[..., 0] = shares.reshape(rows, columns)
    table[..., 1] = (aliases % columns).reshape(rows, columns)
    table[..., 2] = (aliases // columns).reshape(rows, columns)
    for array in (density, table):
        array.setflags(write=False)
    return density, table


def _black(name: str) -> str:
    return (f"'{name}' is black, so no direction can be drawn from it; take a strategy that gathers the environment "
            "where paths escape, or give the map light")
