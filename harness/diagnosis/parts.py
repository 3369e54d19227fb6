"""Functions that a stage is made of, each by itself against its definition: which of them is wrong, if one is.

Asked only once a stage is accused that they are parts of, innermost first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from harness.errors import ShaderError
from harness.gpu.probes import evaluate
from harness.scene.noise import NUMPY, value_noise
from harness.scene.procedural import KINDS
from harness.shader.library import Library

_ROWS = 4096
# Of values of order one: float32, and a fast arc tangent's 4e-8 turns.
_ROUNDING = 2e-5
# Jumps and corners are left out this near.
_JUMP = 1e-4

# The noise and the distortion of probes/texture_parts.frag.
_NOISE, _DISTORTION = np.array([0.1, 0.2, -0.3, 0.4]), 2.0


def wrong_texture_parts(library: Library, names: tuple[str, ...]) -> list[str]:
    """Which of the functions `names` of lib/uv.glsl, noise.glsl, procedural.glsl and bitmaps.glsl are wrong."""
    found: list[str] = []
    if not names:
        return []
    for check in (_surface_parts, _noise_parts):
        try:
            found += [name for name in check(library) if name in names and name not in found]
        except ShaderError:
            continue  # a library that names its functions otherwise keeps its stage's name
    return [name for name in names if name in found]


def _surface_parts(library: Library) -> Iterator[str]:
    rng = np.random.default_rng(2)
    q, angle = rng.uniform(-3, 3, (_ROWS, 3)), rng.normal(size=(_ROWS, 2))
    t = rng.uniform(-2, 3, _ROWS)
    q, t, angle = (values.astype(np.float32).astype(np.float64) for values in (q, t, angle))
    out = evaluate("texture_parts.frag", np.c_[q, t], np.c_[angle, np.zeros((_ROWS, 2))], outputs=5,
                   library=library).astype(np.float64)
    turns = np.arctan2(angle[:, 0], angle[:, 1]) / (2 * np.pi)
    radius = np.hypot(q[:, 0], q[:, 1])
    wave, slope = _wave(t, 0.75)
    whole = np.where(turns < 0, turns + 1, turns)
    yield from unless(near(out[:, 0], turns), "turns")
    if near(out[:, 0], turns):
        yield from unless(near(out[:, 1], whole), "whole_turns")
    yield from unless(near(out[:, 2], radius), "wood_radius")
    yield from unless(near(out[:, 3], np.clip(2 * t - 1, 0, 1)), "ramp_step")
    clear = np.abs(t - np.rint(t)) > _JUMP
    yield from unless(near(out[clear, 4], wave[clear]) and near(out[clear, 5], slope[clear], 1e-3), "wave")
    yield from unless(near(out[:, 6:8], np.abs(q[:, :2] - 2 * np.floor(0.5 * q[:, :2] + 0.5))), "mirrored")
    marble, along = _wave(q[:, 0] + _DISTORTION * _NOISE[3], KINDS["marble"].rise)
    gradient = along[:, None] * (np.array([1.0, 0, 0]) + _DISTORTION * _NOISE[:3])
    yield from unless(near(out[:, 8:12], np.c_[gradient, marble], 5e-3), "marble")
    wood, along = _wave(radius + _DISTORTION * _NOISE[3], KINDS["wood"].rise)
    grain = np.array(KINDS["wood"].grain)
    outwards = np.c_[q[:, :2] / radius[:, None], np.zeros(_ROWS)]
    yield from unless(near(out[:, 12:16], np.c_[along[:, None] * (outwards + _DISTORTION * grain * _NOISE[:3]), wood],
                             5e-3), "wood")
    upper = q[:, :2] - np.floor(q[:, :2])
    sure = (np.abs(upper - 0.5) > _JUMP).all(axis=1) & (np.abs(upper - np.rint(upper)) > _JUMP).all(axis=1)
    first = (upper[:, 0] > 0.5) == (upper[:, 1] > 0.5)
    yield from unless(bool(np.mean((out[sure, 16] > 0.5) == first[sure]) == 1.0), "is_first_color")


def _noise_parts(library: Library) -> Iterator[str]:
    """At lattice points noise is the hash; between them it is the interpolation."""
    rng = np.random.default_rng(3)
    corners = rng.integers(-40, 40, (_ROWS, 3)).astype(np.float64)
    between = rng.uniform(-40, 40, (_ROWS, 3)).astype(np.float32).astype(np.float64)
    seed = 77
    right: dict[str, Callable[[np.ndarray], np.ndarray]] = {}
    of: dict[str, np.ndarray] = {}
    for name, places in (("corners", corners), ("between", between)):
        out = evaluate("noise.frag", np.c_[places, np.ones(_ROWS)], np.tile([2.0, 0.5, 0.0, float(seed)], (_ROWS, 1)),
                       outputs=2, library=library).astype(np.float64)
        value, gradient = value_noise(NUMPY, tuple(places.T), seed)
        of[name] = np.abs(out[:, 4] - value)
        of[f"{name} gradient"] = np.abs(out[:, :3] - np.stack(gradient, axis=-1)).max(axis=1)
        right[name] = lambda found: found < _ROUNDING
    good = of["corners"] < 1e-5
    # The first corner of a cell at the origin's side needs neither the other axes' factors nor signs.
    plain = (corners >= 0).all(axis=1) & (corners[:, 2] == 0)
    if not good.all():
        scaled = not good.any() or bool(np.median(of["corners"]) < 0.02)
        if scaled and bool((of["corners"] < 0.02).all()):
            yield "value_noise"  # nearly right everywhere: its unit
        elif good[plain].mean() < 0.5 and not good.any():
            yield "lattice_values"
        elif good.mean() > 0.01:
            yield "cell_values"
        else:
            yield "lattice_values"
    elif (of["between"] > 1e-4).any():
        yield "value_noise"
    elif (of["between gradient"] > 1e-2).any():
        yield "cell_noise_gradient"


def _wave(s: np.ndarray, rise: float) -> tuple[np.ndarray, np.ndarray]:
    """The wave of harness/scene/procedural.py and its slope."""
    f = s - np.floor(s)
    x = np.where(f < rise, f / rise, (1 - f) / (1 - rise))
    slope = np.where(f < rise, 1 / rise, -1 / (1 - rise))
    return x * x * (3 - 2 * x), slope * 6 * x * (1 - x)


def near(found: np.ndarray, wanted: np.ndarray, rounding: float = _ROUNDING) -> bool:
    """Nearly everywhere: a few places lie on a jump."""
    apart = np.abs(found - wanted)
    return bool(np.mean(np.nan_to_num(apart, nan=np.inf) < rounding * (1 + np.abs(wanted))) > 0.99)


def unless(right: bool, name: str) -> Iterator[str]:
    if not right:
        yield name
