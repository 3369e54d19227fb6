"""What the oracle shares with the shader, proved by itself: the generator bit for bit, directions by their moments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from harness.gpu.probes import evaluate
from harness.reference.draws import Draw, pixel_stream, rand, sample_cosine, sample_lobe, sample_uniform, seed_sample

PLACES = 1 << 20
# Of moments by quadrature: what float32 directions leave, on average over thousands of nodes.
MOMENT = 1e-7
AXES = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.6, 0.0, -0.8), (0.48, -0.64, -0.6),
        (2 / 3, 1 / 3, -2 / 3)]


def test_numbers_are_the_shaders_bit_for_bit(mi: Any) -> None:
    """Seeds and the first eight numbers of a million samples anywhere."""
    rng = np.random.default_rng(1)
    place = rng.integers([4096, 4096, 1024], size=(PLACES, 3))
    sample = rng.integers(1 << 32, size=PLACES)
    shader = evaluate("random.frag", np.column_stack([place, 0 * sample]),
                      np.column_stack([sample >> 16, sample & 0xFFFF, 0 * sample, 0 * sample]), outputs=3)
    x, y, replica = (mi.UInt32(column.astype(np.uint32)) for column in place.T)
    state = seed_sample(pixel_stream(x, y, replica), mi.UInt32(sample.astype(np.uint32)))
    seeds = shader[:, 8].astype(np.uint32) << 16 | shader[:, 9].astype(np.uint32)
    np.testing.assert_array_equal(np.array(state), seeds)
    for column in range(8):
        number, state = rand(state)
        np.testing.assert_array_equal(np.array(number), shader[:, column])


def nodes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tanh-sinh quadrature (Takahasi & Mori 1974) over u times the midpoint rule over v: u, v and weights.

    The former, because the lobe's cosine has a root at u = 1; the latter is exact for harmonics up to the 15th.
    """
    t = np.linspace(-4, 4, 2001)
    u = 1 / (1 + np.exp(-np.pi * np.sinh(t)))
    weight = np.pi * np.cosh(t) * u * (1 - u)
    inside = u < 1 - 2.0**-24  # numbers of the generator end there
    u, weight = u[inside], weight[inside] / weight.sum()
    v = (np.arange(16) + 0.5) / 16
    return (np.repeat(u, 16).astype(np.float32), np.tile(v, len(u)).astype(np.float32), np.repeat(weight, 16) / 16)


def moments(directions: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the components (3,) and of their products (3, 3)."""
    return weight @ directions, (directions * weight[:, None]).T @ directions


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("name", "alpha"), [
    ("uniform", 0.0), ("cosine", 1.0), ("lobe", 0.0), ("lobe", 1.0), ("lobe", 7.5), ("lobe", 80.0), ("lobe", 1000.0)])
def test_directions_have_the_moments_of_their_densities(mi: Any, name: str, alpha: float,
                                                        axis: tuple[float, float, float]) -> None:
    """All are cos^α lobes about the axis: E cos = (α+1)/(α+2), E cos² = (α+1)/(α+3), and nothing across."""
    u, v, weight = nodes()
    first, second = mi.Float(u), mi.Float(v)
    exponent = mi.Float(np.full(len(u), alpha))  # no constant of the kernel: each would be compiled anew
    about = mi.Vector3f(*(mi.Float(np.full(len(u), value)) for value in axis))
    drawn = (sample_lobe(about, exponent, first, second) if name == "lobe" else
             (sample_uniform if name == "uniform" else sample_cosine)(about, first, second))
    directions = np.array(drawn, dtype=np.float64).T
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=5e-7)
    mean, square = moments(directions, weight)
    a = np.array(axis)
    along, along2 = (alpha + 1) / (alpha + 2), (alpha + 1) / (alpha + 3)
    np.testing.assert_allclose(mean, along * a, rtol=0, atol=MOMENT)
    across = (1 - along2) / 2
    np.testing.assert_allclose(square, across * np.eye(3) + (along2 - across) * np.outer(a, a), rtol=0, atol=MOMENT)


@pytest.mark.parametrize(("strategy", "glossy", "numbers", "from_lobe"), [
    ("uniform", True, 2, 0.0), ("cosine", True, 2, 0.0), ("phong", True, 2, 1.0), ("lobes", True, 3, 0.25),
    ("mixture", True, 3, 0.25), ("lobes", False, 2, 0.0), ("mixture", False, 2, 0.0), ("phong", False, 2, 1.0)])
def test_strategies_spend_numbers_as_the_shader_does(mi: Any, strategy: str, glossy: bool, numbers: int,
                                                     from_lobe: float) -> None:
    """Without a lobe in the scene nothing is spent on a choice; the lobe has its share of the choices."""
    count = 1 << 16
    seeds = mi.UInt32(np.random.default_rng(2).integers(1 << 32, size=count).astype(np.uint32))
    n, v = mi.Vector3f(0, 0, 1), mi.Vector3f(0.6, 0, 0.8)
    _, lobe, after = Draw(strategy, glossy).direction(n, v, mi.Float(20), mi.Float(0.25), seeds)
    state = seeds
    for _ in range(numbers):
        _, state = rand(state)
    np.testing.assert_array_equal(np.array(after), np.array(state))
    share = np.broadcast_to(np.array(lobe), count).mean()
    assert abs(share - from_lobe) <= 4 * np.sqrt(from_lobe * (1 - from_lobe) / count)
