"""Procedural textures `fractal`, `marble` and `wood`: their formulas and their place in scene files.

A texture is a function of the surface point p in the shape's canonical object space (see `harness.scene.model.Shape`;
of a moving shape, at its place at time 0). With q = frequency · (to_texture p):

    fractal   t = fbm(q)
    marble    t = wave(q.x + distortion · fbm(q), 1/2)                    veins across the x axis
    wood      t = wave(√(q.x² + q.y²) + distortion · fbm(g q), 3/4)       rings about the z axis, g = (1/4, 1/4, 1/16)

fbm is that of `harness.scene.noise`, from octaves, lacunarity, gain and seed. wave(s, rise) has period 1: it climbs
from 0 to 1 over the part `rise` of the period and falls back over the rest, along 3x² - 2x³ both ways, so it is
continuous with its derivative. (For rise = 1/2 it is ½ - ½ cos 2πs to within 0.01, without the errors of float32
sines.) The colour is piecewise linear in t, through color0, color1, … at equal steps.

The functions below are for NumPy and drjit alike, as those of `harness.scene.noise`; glsl/lib/procedural.glsl has the
shader's. Constants stand on both sides, and tests/glsl hold them together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.scene.model import RGB, Matrix, Procedural, as_matrix
from harness.scene.nodes import Node
from harness.scene.noise import Arithmetic, Triple, fbm


@dataclass(frozen=True)
class Kind:
    """What tells one texture from the others; glsl/lib/procedural.glsl has a function of its name.

    `frequency`, `distortion`: the plugin's parameters where a file is silent; a kind without distortion is the noise
    itself. `rise`: the part of the period in which its wave climbs. `grain`: the factors of q at which it takes its
    noise. `rings`: whether its waves lie about the z axis, or across x.
    """

    frequency: float
    distortion: float | None = None
    rise: float = 0.5
    grain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rings: bool = False


KINDS = {
    "fractal": Kind(4.0),
    "marble": Kind(2.0, distortion=3.0),
    # Early wood grows slowly darker, late wood ends in a sharp edge. The noise that bends the rings is wider than they
    # are, and stretched along the trunk.
    "wood": Kind(8.0, distortion=2.0, rise=0.75, grain=(0.25, 0.25, 0.0625), rings=True),
}

# The plugins' other parameters where a file is silent.
DEFAULT_OCTAVES, DEFAULT_LACUNARITY, DEFAULT_GAIN = 4, 2.0, 0.5
DEFAULT_COLORS = (0.0, 1.0)  # color0 and color1: the texture is t itself

MAX_OCTAVES = 16
MIN_COLORS, MAX_COLORS = 2, 8
MAX_SEED = 2**32 - 1
# Cells of the finest octave between the origin and the surface, where float32 still tells eight places of a cell apart.
MAX_CELLS = 2**20


def load_procedural(node: Node) -> Procedural:
    """A texture node of one of these plugins; refuses parameters outside their range with file and line."""
    kind = KINDS[node.plugin]
    octaves = node.integer("octaves", DEFAULT_OCTAVES)
    if not 1 <= octaves <= MAX_OCTAVES:
        raise node.error(f"'octaves' must be between 1 and {MAX_OCTAVES}, found {octaves}")
    lacunarity = _positive(node, "lacunarity", DEFAULT_LACUNARITY)
    frequency = _positive(node, "frequency", kind.frequency)
    gain = node.number("gain", DEFAULT_GAIN)
    if not 0 < gain <= 1:
        raise node.error(f"'gain' must lie above 0 and at most at 1, found {gain:g}; it is an octave's amplitude "
                         "over that of the octave before")
    seed = node.integer("seed", 0)
    if not 0 <= seed <= MAX_SEED:
        raise node.error(f"'seed' must be between 0 and {MAX_SEED}, found {seed}")
    distortion = 0.0 if kind.distortion is None else node.number("distortion", kind.distortion)
    colors = _colors(node)
    matrix = node.transform("to_texture")
    # The coordinate farthest from the origin that any point of [-1, 1]³ comes to, in the finest octave or the first.
    farthest = frequency * float(np.abs(matrix[:3]).sum(axis=1).max())
    cells = max(farthest, farthest * math.prod([lacunarity] * (octaves - 1)))
    if not cells <= MAX_CELLS:
        raise node.error(f"the noise reaches {cells:.3g} cells from the origin (frequency · lacunarity^(octaves - 1), "
                         f"under 'to_texture'), allowed: {MAX_CELLS}, beyond which float32 does not resolve it; lower "
                         "'octaves', 'lacunarity' or 'frequency'")
    for _, child in node.children():
        raise child.refuse([f"numbers, colours and a transform in a {node.plugin}"])
    node.done(["color0 to color7", "octaves", "lacunarity", "gain", "frequency",
               *([] if kind.distortion is None else ["distortion"]), "seed", "to_texture"])
    return Procedural(node.plugin, colors, octaves, lacunarity, gain, frequency, distortion, seed, as_matrix(matrix))


def _positive(node: Node, name: str, default: float) -> float:
    value = node.number(name, default)
    if value <= 0:
        raise node.error(f"'{name}' must be positive, found {value:g}")
    return value


def _colors(node: Node) -> tuple[RGB, ...]:
    given = [name for name in (f"color{i}" for i in range(MAX_COLORS)) if name in node]
    count = max([MIN_COLORS, *(1 + int(name.removeprefix("color")) for name in given)])
    for index in range(MIN_COLORS, count):
        if f"color{index}" not in node:
            raise node.error(f"'color{count - 1}' is given but 'color{index}' is not; number the colours without "
                             f"a gap, color0 to at most color{MAX_COLORS - 1}")
    # A spectrum's colour depends on whether it is reflected or emitted, which the texture cannot know.
    return tuple(node.rgb(f"color{i}", dict(enumerate(DEFAULT_COLORS)).get(i), emission=True) for i in range(count))


def transformed(matrix: Matrix, p: Triple) -> Triple:
    """Points under an affine transform."""
    x, y, z = (row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3] for row in matrix[:3])
    return x, y, z


def evaluate(arithmetic: Arithmetic, texture: Procedural, p: Triple) -> tuple[Any, Triple]:
    """t at points p of texture space (object space after `to_texture`), within [0, 1], and its gradient along p."""
    kind = KINDS[texture.kind]
    q = x, y, z = (texture.frequency * p[0], texture.frequency * p[1], texture.frequency * p[2])
    noise, gradient = fbm(arithmetic, (x * kind.grain[0], y * kind.grain[1], z * kind.grain[2]),
                          texture.octaves, texture.lacunarity, texture.gain, texture.seed)
    t, slopes = noise, [grain * slope for grain, slope in zip(kind.grain, gradient, strict=True)]
    if kind.distortion is not None:
        along, ahead = _rings(arithmetic, q) if kind.rings else (x, (1.0, 0.0, 0.0))
        t, steep = wave(arithmetic, along + texture.distortion * noise, kind.rise)
        slopes = [steep * a + steep * texture.distortion * slope for a, slope in zip(ahead, slopes, strict=True)]
    return t, (texture.frequency * slopes[0], texture.frequency * slopes[1], texture.frequency * slopes[2])


def _rings(arithmetic: Arithmetic, q: Triple) -> tuple[Any, Triple]:
    """The distance from the z axis and its gradient; 0 on the axis, where there is none."""
    x, y, _ = q
    radius = arithmetic.sqrt(x * x + y * y)
    inverse = 1 / arithmetic.select(radius > 0, radius, 1.0)
    return radius, (x * inverse, y * inverse, 0.0)


def wave(arithmetic: Arithmetic, s: Any, rise: float) -> tuple[Any, Any]:
    """The wave of period 1 at s, within [0, 1], and its derivative."""
    f = s - arithmetic.floor(s)
    climbing = f < rise
    x = arithmetic.select(climbing, f * (1 / rise), (1 - f) * (1 / (1 - rise)))
    slope = arithmetic.select(climbing, 1 / rise, -1 / (1 - rise))
    return x * x * (3 - 2 * x), slope * 6 * x * (1 - x)


def ramp(arithmetic: Arithmetic, t: Any, stops: tuple[float, ...]) -> tuple[Any, Any]:
    """One channel of the colour at t, piecewise linear through `stops` at equal steps of t, and its derivative."""
    total, slope = stops[0] + 0 * t, 0 * t
    steps = len(stops) - 1
    for index in range(steps):
        x = t * steps - index
        inside = (x > 0) & (x < 1)
        step = stops[index + 1] - stops[index]
        total = total + step * arithmetic.select(inside, x, arithmetic.select(x > 0, 1.0, 0.0))
        slope = slope + arithmetic.select(inside, step * steps, 0.0)
    return total, slope
