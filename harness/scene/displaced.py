"""Displaced spheres: their place in scene files, their exact surface, and how far it can rise, slope and bend.

The surface is p = d r(d) over the unit directions d of canonical object space, r(d) = 1 + amplitude · h(d), where h is
the red channel of a procedural texture at d.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.scene.model import Bitmap, Checkerboard, Displacement, Material, Procedural, Texture, peak
from harness.scene.nodes import Node
from harness.scene.noise import NUMPY, sharpest_fbm, steepest_fbm
from harness.scene.procedural import KINDS, evaluate, load_procedural, ramp, transformed

# Why the other textures are refused.
REASONS = {
    "checkerboard": "jumps, so the surface would be torn",
    "bitmap": "has one value for each direction only where its poles and its seam are uniform",
}

# Steps of the grid along an edge of the cube: 10^5 directions, a tenth of a second for each octave.
GRID = 128


@dataclass(frozen=True)
class Bounds:
    """What the radius r(d) of a displaced sphere never exceeds, so that a ray can be marched without stepping through.

    With t(d) the texture before its colour ramp, and φ the angle along any great circle:
    `lowest` <= r <= `highest`; `least` <= dr/dt <= `greatest` on every piece of the ramp; |dr/dφ| <= `slope`; and
    |d²r/dφ²| <= `bend` + `axis_bend` / (angle from the axis of the wood's rings) on every piece of the ramp, with
    dr/dt anywhere between `least` and `greatest`.
    """

    lowest: float
    highest: float
    least: float
    greatest: float
    slope: float
    bend: float
    axis_bend: float


def load_displacement(node: Node, radius: float) -> Displacement:
    """The properties `amplitude` (in the units of `radius`) and `displacement` (a procedural texture) of a shape."""
    amplitude = node.number("amplitude")
    nested = node.nested("displacement")
    if nested is None:
        raise node.error(f"a displacedsphere needs a texture named 'displacement'; supported: {', '.join(KINDS)}")
    if nested.plugin in REASONS:
        raise nested.error(f"a {nested.plugin} cannot displace: it {REASONS[nested.plugin]}; "
                           f"supported: {', '.join(KINDS)}")
    if nested.plugin not in KINDS:
        raise nested.refuse(KINDS)
    texture = load_procedural(nested)
    farthest = abs(amplitude) * peak(texture)[0]
    if farthest >= radius:
        raise node.error(f"the displacement reaches {farthest:g} (amplitude times the texture's largest red), not less "
                         f"than the radius, {radius:g}; lower 'amplitude' or darken the texture")
    return Displacement(texture, amplitude / radius)


def refuse_surface_textures(node: Node, material: Material, emission: Texture | None) -> None:
    """Refuse textures that look at (u, v), which a displaced sphere does not have."""
    for texture in (material.kd, material.ks, material.alpha, emission):
        if isinstance(texture, Bitmap | Checkerboard):
            raise node.error("a displacedsphere has no surface coordinates for a bitmap or a checkerboard; "
                             f"supported on it: {', '.join(KINDS)}, colours and numbers")


def radius(displacement: Displacement, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """r, (N,), and its gradient along d, (N, 3), at unit directions d of object space, (N, 3) float64."""
    texture = displacement.texture
    assert isinstance(texture, Procedural)
    x, y, z = directions.T
    t, gradient = evaluate(NUMPY, texture, transformed(texture.to_texture, (x, y, z)))
    height, slope = ramp(NUMPY, t, _reds(texture))
    to_texture = np.array(texture.to_texture)[:3, :3]
    return (1 + displacement.amplitude * height,
            (displacement.amplitude * slope)[:, None] * (np.stack(gradient, axis=-1) @ to_texture))


def normal(directions: np.ndarray, r: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """The outward unit normals, (N, 3), from directions and what `radius` says of them.

    The surface is the zero set of |p| - r(p/|p|), whose gradient at p = d r is d - (∇r - (∇r·d) d) / r.
    """
    tangential = gradient - (gradient * directions).sum(axis=1, keepdims=True) * directions
    outward = directions - tangential / r[:, None]
    return np.asarray(outward / np.linalg.norm(outward, axis=1, keepdims=True))


@functools.cache
def bounds(displacement: Displacement) -> Bounds:
    """Bounds on a displaced sphere.

    `lowest`, `highest` and `slope` from values on a grid of directions, and what the bend allows between them.
    """
    certain = certain_bounds(displacement)
    directions, apart = _grid()
    r, gradient = radius(displacement, directions)
    steepness = np.linalg.norm(gradient - (gradient * directions).sum(axis=1, keepdims=True) * directions, axis=1)
    between: Any = certain.slope * apart
    slope = certain.slope
    if certain.least == certain.greatest and not certain.axis_bend:  # a ramp's corners and rings' axes bend without end
        between = np.minimum(between, steepness * apart + 0.5 * certain.bend * apart**2)
        slope = min(slope, float(steepness.max()) + certain.bend * apart)
    return dataclasses.replace(certain, slope=slope, lowest=max(certain.lowest, float((r - between).min())),
                               highest=min(certain.highest, float((r + between).max())))


def certain_bounds(displacement: Displacement) -> Bounds:
    """Bounds from the texture's parameters alone, whatever values its lattice holds."""
    texture = displacement.texture
    assert isinstance(texture, Procedural)
    reds = displacement.amplitude * np.array(_reds(texture))
    slopes = np.diff(reds) * (len(reds) - 1)
    largest = float(np.abs(slopes).max())
    # Cells of noise, or waves, per radian at most: the largest stretch of the map from directions to the texture.
    scale = texture.frequency * float(np.linalg.norm(np.array(texture.to_texture)[:3, :3], ord=2))
    steep = scale * steepest_fbm(texture.octaves, texture.lacunarity, texture.gain)
    bend = scale**2 * sharpest_fbm(texture.octaves, texture.lacunarity, texture.gain)
    kind = KINDS[texture.kind]
    axis_bend = 0.0
    if kind.distortion is not None:  # t = wave(x + distortion · fbm), or wave(√(x² + y²) + distortion · fbm)
        grain, side = max(kind.grain), min(kind.rise, 1 - kind.rise)
        wave_slope, wave_bend = 1.5 / side, 6 / side**2  # of 3x² - 2x³: 6x (1 - x) and 6 - 12x, in x = s / side
        steep = scale + abs(texture.distortion) * grain * steep
        bend = wave_bend * steep**2 + wave_slope * abs(texture.distortion) * grain**2 * bend
        steep *= wave_slope
        if kind.rings:  # √(x² + y²) bends by the inverse of itself
            axis_bend = wave_slope * scale
    # Along a great circle, d² t/dφ² = u·Hu - ∇t·d with the Hessian H and unit u: hence the slope adds to the bend.
    return Bounds(1 + float(reds.min()), 1 + float(reds.max()), float(slopes.min()), float(slopes.max()),
                  largest * steep, largest * (bend + steep), largest * axis_bend)


@functools.cache
def _grid() -> tuple[np.ndarray, float]:
    """Directions over a cube's faces at equal angles, (N, 3), and the angle from any direction to the nearest of them.

    Where u and v are the two angles on a face, neither moves the direction (1, tan u, tan v) by more than its own size.
    """
    tangents = np.tan(np.linspace(-np.pi / 4, np.pi / 4, GRID + 1))
    u, v = (side.ravel() for side in np.meshgrid(tangents, tangents))
    directions = np.concatenate([np.roll(np.column_stack([np.full_like(u, side), u, v]), axis, axis=1)
                                 for axis in range(3) for side in (1.0, -1.0)])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), 2 * np.pi / 4 / GRID


def _reds(texture: Procedural) -> tuple[float, ...]:
    return tuple(color[0] for color in texture.colors)
