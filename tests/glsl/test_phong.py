"""The BRDF and its five strategies: values against the formula, weights against f·cos/pdf and against quadrature."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from harness.checks import shared_level, weight
from harness.checks.shader import lobe_albedo
from harness.scene import Material
from harness.scene.strategies import DRAWS
from harness.shader.scene.materials import glossy_probability
from tests.support.tracer import evaluate

DIFFUSE = Material((0.8, 0.5, 0.2), (0, 0, 0), 1.0)
MATERIALS = {
    "diffuse": DIFFUSE,
    **{f"lobe {alpha:g}": Material((0, 0, 0), (0.9, 0.6, 0.3), alpha) for alpha in (0.0, 1.0, 10.0, 1000.0)},
    "plastic": Material((0.15, 0.45, 0.18), (0.4, 0.4, 0.4), 20.0),
    "coloured": Material((0.6, 0.0, 0.1), (0.05, 0.5, 0.3), 3.0),
    "mostly diffuse": Material((0.6, 0.55, 0.1), (0.02, 0.02, 0.02), 200.0),
}
# Lobe-only sampling never draws most directions of a diffuse term: only where there is none.
CASES = [(strategy, name) for strategy in DRAWS for name, material in MATERIALS.items()
         if strategy != "phong" or max(material.kd) == 0]
ANGLES = (0.0, 40.0, 70.0, 88.0)  # of v to the normal, in degrees
SAMPLES = 1 << 16


def tolerance(material: Material) -> float:
    """Relative error of a float32 value: a pow is as precise as its logarithm times the exponent."""
    return 1e-5 + 2 * np.finfo(np.float32).eps * material.alpha


def probe(material: Material, n: np.ndarray, v: np.ndarray, l: np.ndarray, strategy: str = "mixture",  # noqa: E741
          specialised: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f(l, v), a drawn direction and its weight, each (N, 3), for directions (N, 3).

    `specialised` leaves out the code of a term that the material lacks, as the generated scene does.
    """
    defines = {"STRATEGY": DRAWS.index(strategy)}
    if specialised:
        defines |= {"HAS_DIFFUSE": int(max(material.kd) > 0), "HAS_GLOSSY": int(max(material.ks) > 0)}
    uniforms = {"kd": material.kd, "ks": material.ks, "alpha": material.alpha,
                "p_glossy": glossy_probability(material), "replica": 1}
    rows = [np.c_[np.float32(a), np.zeros(len(a))] for a in (n, v, l)]
    found = evaluate("phong.frag", *rows, outputs=3, uniforms=uniforms, defines=defines).astype(np.float64)
    return found[:, 0:3], found[:, 4:7], found[:, 8:11]


def lobe(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """(α+1)/(2π) max(cosine, 0)^α, and 0 at and below 0."""
    return np.where(cosine > 0, (alpha + 1) / (2 * np.pi) * np.maximum(cosine, 1e-300) ** alpha, 0)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise dot products, (N,)."""
    return np.sum(a * b, axis=1)


def mirror(d: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Mirror images of directions about normals, (N, 3)."""
    return 2 * dot(d, n)[:, None] * n - d


def formula(material: Material, n: np.ndarray, v: np.ndarray, l: np.ndarray) -> np.ndarray:  # noqa: E741
    """The course's BRDF in float64, with r the mirror image of l, as the course writes it; (N, 3)."""
    return np.array(material.kd) / np.pi + np.array(material.ks) * lobe(dot(mirror(l, n), v), material.alpha)[:, None]


@functools.cache
def interactions(seed: int, angle: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random normals, and v at `angle` (degrees) to each, rounded to float32; (count, 3) both."""
    rng = np.random.default_rng([seed, int(angle)])
    n, tangent = rng.normal(size=(2, count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    tangent -= dot(tangent, n)[:, None] * n
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    v = np.cos(np.radians(angle)) * n + np.sin(np.radians(angle)) * tangent
    return np.float32(n).astype(np.float64), np.float32(v).astype(np.float64)


@pytest.mark.parametrize("name", MATERIALS)
def test_values_equal_the_formula(name: str) -> None:
    """Random directions over both hemispheres, and l near the mirror direction, where the lobe is."""
    material, rng = MATERIALS[name], np.random.default_rng(11)
    n, v = interactions(1, 50.0, 4000)
    l = rng.normal(size=(4000, 3))  # noqa: E741
    l[2000:] = mirror(v, n)[2000:] + 0.05 * l[2000:]
    l = np.float32(l / np.linalg.norm(l, axis=1, keepdims=True)).astype(np.float64)  # noqa: E741
    for specialised in (True, False):
        value, _, _ = probe(material, n, v, l, specialised=specialised)
        # Rounding of the float32 cosine to the mirror direction is magnified by the exponent where the lobe falls.
        cosine = np.maximum(dot(mirror(l, n), v), 1e-2)[:, None]
        bound = (tolerance(material) + 3e-7 * material.alpha / cosine) * formula(material, n, v, l) + 1e-7
        np.testing.assert_array_less(np.abs(value - formula(material, n, v, l)), bound)


def test_the_brdf_is_reciprocal() -> None:
    """f(l, v) = f(v, l): the lobe about the mirror image of v is the lobe about the mirror image of l."""
    material, rng = MATERIALS["plastic"], np.random.default_rng(12)
    n, v = interactions(2, 35.0, 4000)
    l = mirror(v, n) + 0.3 * rng.normal(size=v.shape)  # noqa: E741
    l /= np.linalg.norm(l, axis=1, keepdims=True)  # noqa: E741
    np.testing.assert_allclose(probe(material, n, v, l)[0], probe(material, n, l, v)[0], rtol=2e-5)


@pytest.mark.parametrize(("strategy", "name"), CASES)
def test_weights_are_value_times_cosine_over_pdf(strategy: str, name: str) -> None:
    """Sample by sample, for every strategy whose pdf is known from the direction alone; never under the surface."""
    material = MATERIALS[name]
    n, v = interactions(3, 88.0, 20_000)
    _, l, weight = probe(material, n, v, v, strategy)  # noqa: E741
    np.testing.assert_allclose(np.linalg.norm(l, axis=1), 1, atol=1e-6)
    cosine, share = dot(n, l), glossy_probability(material)
    below = cosine < -1e-6
    assert (weight[below] == 0).all()
    assert below.any() == (max(material.ks) > 0 and strategy in ("phong", "lobes", "mixture"))
    lobe_pdf = lobe(dot(mirror(v, n), l), material.alpha)
    diffuse_pdf = np.maximum(cosine, 0) / np.pi
    if strategy == "lobes":  # each draw's pdf is that of the term it came from: one of two weights
        expected = np.stack([np.array(material.kd) / max(1 - share, 1e-9) * np.ones((len(l), 1)),
                             np.array(material.ks) * cosine[:, None] / max(share, 1e-9)])
        error = np.abs(weight - expected).max(axis=2).min(axis=0)
        assert error[cosine > 1e-6].max() < 1e-6
        return
    pdf = {"uniform": np.full(len(l), 1 / (2 * np.pi)), "cosine": diffuse_pdf, "phong": lobe_pdf,
           "mixture": (1 - share) * diffuse_pdf + share * lobe_pdf}[strategy]
    seen = (cosine > 1e-3) & (pdf > 1e-4)  # elsewhere rounding of the cosine decides
    expected = formula(material, n, v, l)[seen] * cosine[seen, None] / pdf[seen, None]
    assert seen.mean() > 0.4
    np.testing.assert_allclose(weight[seen], expected, rtol=5e-4 + 1e-5 * material.alpha, atol=1e-5)


@pytest.mark.parametrize(("strategy", "name"), CASES)
def test_expected_weight_is_the_albedo(strategy: str, name: str) -> None:
    """E[weight] = ∫ f (n·l) dl for every strategy, material and angle, within its standard error.

    It joins sampling and pdf: a pdf that is wrong by a factor, or directions that do not follow it, move the mean.
    """
    material = MATERIALS[name]
    # 31 pairs of strategy and material, 4 angles: together a false alarm in 1000 changes of the seed.
    level = shared_level(1e-3, len(CASES) * len(ANGLES))
    for angle in ANGLES:
        n, v = interactions(4, angle, SAMPLES)
        expected = np.array(material.kd) + np.array(material.ks) * lobe_albedo(material.alpha, np.radians(angle).item())
        weights = probe(material, n, v, v, strategy)[2]
        found = weight(lambda _, drawn=weights: drawn, expected, level=level)
        assert found.passed, f"{angle} degrees: {found.sentence}"


@pytest.mark.parametrize(("strategy", "name"), CASES)
def test_weights_are_bounded(strategy: str, name: str) -> None:
    """No draw weighs more than its strategy allows, so the variance is finite, grazing directions included.

    A mixture's weight lies between those of its two terms, each over its own probability.
    """
    material = MATERIALS[name]
    kd, ks, share = np.array(material.kd), np.array(material.ks), glossy_probability(material)
    bound = {
        "uniform": 2 * kd + ks * (material.alpha + 1),
        "cosine": kd + ks * (material.alpha + 1) / 2,
        "phong": ks,
        "lobes": np.maximum(kd / max(1 - share, 1e-9), ks / max(share, 1e-9)),
        "mixture": np.maximum(kd / max(1 - share, 1e-9), ks / max(share, 1e-9)),
    }[strategy]
    for angle in (0.0, 89.9):
        n, v = interactions(5, angle, SAMPLES)
        _, _, weight = probe(material, n, v, v, strategy)
        assert (weight.max(axis=0) <= bound * (1 + 1e-3) + 1e-6).all()
        assert weight.min() >= 0
