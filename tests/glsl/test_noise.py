"""The shader's noise against the same formulas in float64 and in drjit."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from harness.files import data_dir
from harness.reference.procedural import arithmetic
from harness.scene.noise import AXES, NUMPY, OCTAVE, OFFSET, SEED_FACTOR, UNIT, Arithmetic, fbm, value_noise
from tests.support.tracer import evaluate

COUNT = 4000
SEED = 3_000_000_019  # beyond 31 bits, and odd
SUMS = [(1, 2.0, 0.5), (4, 2.0, 0.5), (8, 1.9, 0.6), (16, 1.25, 0.9)]  # octaves, lacunarity, gain


def points() -> dict[str, np.ndarray]:
    """Points (N, 3), exact in float32: on both sides of the origin, far from it, on the lattice, and just beside it."""
    rng = np.random.default_rng(5)
    lattice = rng.integers(-30, 30, (COUNT, 3))
    found = {
        "near": rng.normal(size=(COUNT, 3)) * 3,
        "far": rng.uniform(-1000, 1000, (COUNT, 3)),
        "lattice": lattice,
        "below lattice points": np.nextafter(lattice.astype(np.float32), np.float32(-100)),
    }
    return {name: values.astype(np.float32).astype(np.float64) for name, values in found.items()}


def shader(p: np.ndarray, octaves: int, lacunarity: float, gain: float) -> np.ndarray:
    """The probe's answers (N, 6): gradient and value of the noise, the value by itself, and fbm."""
    how = np.tile([lacunarity, gain, SEED >> 16, SEED & 0xFFFF], (len(p), 1))
    return evaluate("noise.frag", np.c_[p, np.full(len(p), octaves)], how, outputs=2)[:, :6]


def twin(own: Arithmetic, number: Any, p: np.ndarray, octaves: int, lacunarity: float, gain: float) -> np.ndarray:
    """The same from `harness.scene.noise`; `number` makes its kind of array. Parameters are those of float32."""
    at = tuple(number(np.ascontiguousarray(c)) for c in p.T)
    noise, gradient = value_noise(own, (at[0], at[1], at[2]), SEED)
    total, _ = fbm(own, (at[0], at[1], at[2]), octaves, float(np.float32(lacunarity)), float(np.float32(gain)), SEED)
    return np.stack([np.array(c, dtype=np.float64) for c in (*gradient, noise, noise, total)], axis=-1)


@pytest.mark.parametrize("where", points())
@pytest.mark.parametrize(("octaves", "lacunarity", "gain"), SUMS)
def test_shader_and_drjit_agree(mi: Any, where: str, octaves: int, lacunarity: float, gain: float) -> None:
    """To a few units in the last place, wherever the point: both round alike, since the formulas run in one order."""
    p = points()[where]
    found = shader(p, octaves, lacunarity, gain)
    expected = twin(arithmetic(mi), mi.Float, p, octaves, lacunarity, gain)
    np.testing.assert_allclose(found, expected, atol=5e-7)


@pytest.mark.parametrize("where", ["near", "lattice", "below lattice points"])
def test_shader_agrees_with_float64(where: str) -> None:
    """To what float32 loses on the way."""
    p = points()[where]
    found, expected = shader(p, 4, 2.0, 0.5), twin(NUMPY, np.asarray, p, 4, 2.0, 0.5)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    if where == "lattice":  # the corners' own values, on which nothing is lost
        np.testing.assert_array_equal(found[:, :5], expected[:, :5])


def test_both_sides_hold_the_same_constants() -> None:
    """Each on its own: where one differs, the comparisons above say only that the noise is another."""
    text = (data_dir("glsl") / "lib" / "noise.glsl").read_text(encoding="utf-8")
    found = {name: int(value, 0) for name, value in re.findall(r"^const uint (\w+) = (\w+)u;", text, re.MULTILINE)}
    axes = dict(zip(("NOISE_X", "NOISE_Y", "NOISE_Z"), AXES, strict=True))
    assert found == axes | {"NOISE_SEED": SEED_FACTOR, "NOISE_OFFSET": OFFSET, "NOISE_OCTAVE": OCTAVE}
    assert f"const float NOISE_UNIT = 1.0 / {1 / UNIT};" in text
