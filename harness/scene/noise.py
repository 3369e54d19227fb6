"""Value noise and its fractal sums, as glsl/lib/noise.glsl defines them, for NumPy and drjit alike.

    noise(p) = values at the corners of p's unit cell, interpolated with Perlin's quintic 6f⁵ - 15f⁴ + 10f³ per axis
    fbm(p)   = Σ gainⁱ noise(lacunarityⁱ p) / Σ gainⁱ  over i < octaves, each octave with a seed of its own

Both lie within [0, 1] and are twice differentiable. Perlin 2002, "Improving Noise"; Ebert et al. 2003, "Texturing and
Modeling", 3rd ed., chapter 2. The formulas use operators only; an `Arithmetic` supplies the rest for a kind of array.
Points and gradients are tuples of three arrays. Multiplications of p by lacunarity follow the shader's order, so that
float32 arrays round as it does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

# Constants of the hash, explained in glsl/lib/noise.glsl.
AXES = (0x85EBCA77, 0xC2B2AE3D, 0x165667B1)
SEED_FACTOR, OFFSET = 747796405, 2891336453
OCTAVE = 0x9E3779B9
UINT32 = 0xFFFFFFFF
UNIT = 2.0**-24

# The least number that |∇noise| never exceeds is 15/8, the steepest slope of the quintic: reached half way between two
# faces of a cell that hold 0 and 1. (Found over all 256 ways to put 0 and 1 on the corners; the gradient's length is a
# convex function of the eight values, so no values between reach more.)
STEEPEST_NOISE = 15 / 8
# The same for |u·Hu|, H the Hessian and u any unit vector: 2 (15/8)², reached in the middle between two faces that hold
# 0 1 1 0 around. (Over the corners' 128 ways, up to exchanging 0 and 1, and a grid of 21³ places; convex as well.)
SHARPEST_NOISE = 225 / 32

Triple = tuple[Any, Any, Any]


@dataclass(frozen=True)
class Arithmetic:
    """What the formulas need of a kind of array beyond operators."""

    floor: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    select: Callable[[Any, Any, Any], Any]  # condition, then, else
    to_uint: Callable[[Any], Any]  # whole numbers, negative ones too, modulo 2³² as unsigned 32-bit integers
    to_float: Callable[[Any], Any]  # whole numbers up to 2²⁴


NUMPY = Arithmetic(np.floor, np.sqrt, np.where, lambda x: x.astype(np.int64).astype(np.uint32),
                   lambda x: x.astype(np.float64))


def value_noise(arithmetic: Arithmetic, p: Triple, seed: int) -> tuple[Any, Triple]:
    """Value noise at p and its gradient; a cell is a unit cube.

    With NUMPY the coordinates are float64 arrays of any one shape but ().
    """
    corner = tuple(map(arithmetic.floor, p))
    f = tuple(x - c for x, c in zip(p, corner, strict=True))
    u, v, w = (x * x * x * (x * (x * 6.0 - 15.0) + 10.0) for x in f)
    du, dv, dw = (30.0 * x * x * (x * (x - 2.0) + 1.0) for x in f)
    first = sum(arithmetic.to_uint(c) * axis for c, axis in zip(corner, AXES, strict=True))
    first = first + (seed * SEED_FACTOR + OFFSET & UINT32)

    def value(x: int, y: int, z: int) -> Any:
        state = first + (x * AXES[0] + y * AXES[1] + z * AXES[2] & UINT32)
        word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737
        return arithmetic.to_float(word >> 8)

    corners = [(x, y) for y in (0, 1) for x in (0, 1)]
    lower = [value(x, y, 0) for x, y in corners]
    along_z = [value(x, y, 1) - low for (x, y), low in zip(corners, lower, strict=True)]
    a = [low + w * step for low, step in zip(lower, along_z, strict=True)]
    along_y = (a[2] - a[0], a[3] - a[1])
    b = (a[0] + v * along_y[0], a[1] + v * along_y[1])
    z = (along_z[0] + v * (along_z[2] - along_z[0]), along_z[1] + v * (along_z[3] - along_z[1]))
    along_x = b[1] - b[0]
    gradient = (UNIT * du * along_x,
                UNIT * dv * (along_y[0] + u * (along_y[1] - along_y[0])),
                UNIT * dw * (z[0] + u * (z[1] - z[0])))
    return UNIT * (b[0] + u * along_x), gradient


def fbm(arithmetic: Arithmetic, p: Triple, octaves: int, lacunarity: float, gain: float,
        seed: int) -> tuple[Any, Triple]:
    """Fractal noise at p and its gradient; arrays as in `value_noise`."""
    total: Any = 0.0
    slopes: Triple = (0.0, 0.0, 0.0)
    for octave, weight in enumerate(octave_weights(octaves, gain)):
        noise, gradient = value_noise(arithmetic, p, seed + octave * OCTAVE)
        total = total + weight * noise
        steep = weight * lacunarity**octave
        slopes = (slopes[0] + steep * gradient[0], slopes[1] + steep * gradient[1], slopes[2] + steep * gradient[2])
        p = (p[0] * lacunarity, p[1] * lacunarity, p[2] * lacunarity)
    return total, slopes


def octave_weights(octaves: int, gain: float) -> list[float]:
    """Of each octave of a fractal sum; they add up to 1."""
    weights = [gain**octave for octave in range(octaves)]
    return [weight / sum(weights) for weight in weights]


def steepest_fbm(octaves: int, lacunarity: float, gain: float) -> float:
    """A bound on |∇fbm|, so on the change of fbm per unit of distance (Lipschitz)."""
    octave = range(octaves)
    return STEEPEST_NOISE * sum((gain * lacunarity)**i for i in octave) / sum(gain**i for i in octave)


def sharpest_fbm(octaves: int, lacunarity: float, gain: float) -> float:
    """A bound on fbm's second derivative along any straight line."""
    octave = range(octaves)
    return SHARPEST_NOISE * sum((gain * lacunarity**2)**i for i in octave) / sum(gain**i for i in octave)
