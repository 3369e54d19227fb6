"""The direction samplers: drawn directions follow their pdfs, pdfs integrate to 1, and the basis is orthonormal."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.support.tracer import evaluate

SAMPLERS = {"uniform": 0, "cosine": 1, "lobe": 2}
ALPHAS = (0.0, 0.5, 1.0, 10.0, 100.0, 1000.0)
AXES = {
    "+z": (0, 0, 1), "-z": (0, 0, -1), "x": (1, 0, 0), "-y": (0, -1, 0),
    "111": np.ones(3) / np.sqrt(3),  # where the handout's tangent vanishes
    "near -z": np.array([3e-4, -2e-4, -1]) / np.linalg.norm([3e-4, -2e-4, -1]),
    "tilted": np.array([-0.4, 0.5, -0.2]) / np.linalg.norm([-0.4, 0.5, -0.2]),
}
SAMPLES = 1 << 17
RINGS, SECTORS = 24, 17  # an odd number of sectors, so that none falls together with a symmetry of the basis
# Of the 56 chi² tests here, none may reject by chance more often than once in 10,000 changes of the seeds.
LEVEL = 1e-4 / 56


def draw(sampler: str, axis: np.ndarray, alpha: float, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) and their pdfs (N,) for uniform numbers (N, 2)."""
    frame = np.tile([*axis, alpha], (len(u), 1))
    found = evaluate("sampling.frag", frame, np.c_[u, np.zeros((len(u), 2))], defines={"SAMPLER": SAMPLERS[sampler]})
    return found[:, :3].astype(np.float64), found[:, 3].astype(np.float64)


def pdf(sampler: str, cosine: np.ndarray, alpha: float) -> np.ndarray:
    """A sampler's pdf at cosines (N,) to its axis."""
    at = np.c_[cosine, np.full(len(cosine), alpha), np.zeros((len(cosine), 2))]
    return evaluate("pdf.frag", at)[:, SAMPLERS[sampler]].astype(np.float64)


def ring_edges(alpha: float) -> np.ndarray:
    """Cosines that cut the sphere into rings, finely where cos^α is large; the lower half is one ring."""
    return np.concatenate([[-1.0], np.linspace(0, 1, RINGS) ** (1 / (alpha + 1))])


def integrate(sampler: str, alpha: float) -> np.ndarray:
    """The pdf's integral over each ring, (RINGS,), by the midpoint rule with 400 steps a ring.

    The steps are of cos^(α+1), over which even cos^1000 is spread evenly; below the horizon they are of the cosine.
    """
    steps = 400
    power = (np.arange((RINGS - 1) * steps) + 0.5) / ((RINGS - 1) * steps)
    upper = power ** (1 / (alpha + 1))
    widths = upper / ((alpha + 1) * power) / len(power)
    cosines = np.concatenate([np.linspace(-1, -1 / steps, steps), upper])
    widths = np.concatenate([np.full(steps, 1 / steps), widths])
    return 2 * np.pi * (widths * pdf(sampler, cosines, alpha)).reshape(RINGS, steps).sum(axis=1)


def own_azimuth(directions: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Angles about the axis in a frame of the test's own, within [0, 1) turns."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(axis, helper)
    x /= np.linalg.norm(x)
    return np.arctan2(directions @ np.cross(axis, x), directions @ x) / (2 * np.pi) % 1


# The exponent of each sampler's own distribution: that of the hemisphere is 0, of the cosine 1.
CASES = [("uniform", 0.0), ("cosine", 1.0), *(("lobe", alpha) for alpha in ALPHAS)]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("sampler", "alpha"), CASES)
def test_directions_follow_the_pdf(sampler: str, alpha: float, axis: str) -> None:
    """A chi² test of the drawn directions, in cells all round the axis, against the integral of the pdf."""
    rng = np.random.default_rng([SAMPLERS[sampler], int(10 * alpha), list(AXES).index(axis)])
    about = np.float32(AXES[axis]).astype(np.float64)
    directions, pdfs = draw(sampler, about, alpha, rng.random((SAMPLES, 2), dtype=np.float32))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=1e-6)
    assert pdfs.min() > 0
    # A cosine is measured as the distance from the axis, which keeps its precision where the cosine is nearly 1.
    cosine = 1 - np.sum((directions - about) ** 2, axis=1) / 2
    ring = np.clip(np.searchsorted(ring_edges(alpha), cosine) - 1, 0, RINGS - 1)
    sector = (own_azimuth(directions, about) * SECTORS).astype(int)
    observed = np.bincount(ring * SECTORS + sector, minlength=RINGS * SECTORS).reshape(RINGS, SECTORS)[1:]
    expected = np.tile(integrate(sampler, alpha)[1:, None] / SECTORS * SAMPLES, SECTORS)
    assert observed.sum() == SAMPLES  # none below the horizon of the axis
    chi2 = np.sum((observed - expected) ** 2 / expected)
    assert stats.chi2.sf(chi2, expected.size - 1) > LEVEL


@pytest.mark.parametrize(("sampler", "alpha"), CASES)
def test_pdfs_integrate_to_one(sampler: str, alpha: float) -> None:
    """Over the whole sphere; the directions below the horizon count, and hold nothing."""
    rings = integrate(sampler, alpha)
    assert rings[0] == 0
    assert rings.sum() == pytest.approx(1, abs=2e-5)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_lobe_pdf_equals_its_formula(alpha: float) -> None:
    """(α+1)/(2π) max(cos, 0)^α in float64, at cosines from −1 to 1; zero, not NaN, at and below 0."""
    cosine = np.float32(np.concatenate([np.linspace(-1, 1, 401), 1 - np.geomspace(1e-6, 0.1, 100)])).astype(np.float64)
    expected = np.where(cosine > 0, (alpha + 1) / (2 * np.pi) * np.maximum(cosine, 1e-300) ** alpha, 0)
    # A float32 pow is as precise as its logarithm times α: one spacing of that, and 1e-6 for the rest.
    tolerance = 1e-6 + np.finfo(np.float32).eps * alpha
    np.testing.assert_allclose(pdf("lobe", cosine, alpha), expected, rtol=tolerance, atol=1e-30)


@pytest.mark.parametrize("sampler", list(SAMPLERS))
def test_samplers_are_finite_at_the_ends_of_their_range(sampler: str) -> None:
    """0 and the largest number below 1, in every combination, give unit directions: no NaN from roots or powers."""
    ends = np.float32([0, 1 - 2**-24])
    u = np.stack(np.meshgrid(ends, ends), axis=-1).reshape(-1, 2)
    for alpha in ALPHAS:
        for axis in AXES.values():
            directions, pdfs = draw(sampler, np.asarray(axis), alpha, u)
            np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=1e-6)
            assert np.isfinite(pdfs).all()


def test_the_lobe_with_exponent_one_is_the_cosine_hemisphere() -> None:
    """The mixture draws both of its terms with one call and relies on it."""
    u = np.random.default_rng(3).random((1000, 2), dtype=np.float32)
    axis = AXES["tilted"]
    for lobe, cosine in zip(draw("lobe", axis, 1.0, u), draw("cosine", axis, 1.0, u), strict=True):
        np.testing.assert_allclose(lobe, cosine, rtol=1e-5, atol=1e-6)


def test_the_basis_is_orthonormal_and_right_handed_everywhere() -> None:
    """Random axes, all octants' corners, and axes as near to ±z and to the plane z = 0 as float32 allows."""
    rng = np.random.default_rng(4)
    tiny = np.geomspace(1e-7, 1e-2, 200)[:, None] * rng.normal(size=(200, 3))
    corners = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    axes = np.concatenate([rng.normal(size=(50_000, 3)), corners[np.any(corners != 0, axis=1)],
                           *(np.array(near) + tiny for near in ([0, 0, -1], [0, 0, 1], [1, -1, 0])), [[0, 1, -0.0]]])
    axes = np.float32(axes / np.linalg.norm(axes, axis=1, keepdims=True)).astype(np.float64)
    found = evaluate("basis.frag", np.c_[axes, np.zeros(len(axes))], outputs=3).reshape(-1, 3, 4)[..., :3]
    basis = found.astype(np.float64)
    gram = np.einsum("nij,nkj->nik", basis, basis)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), rtol=0, atol=1e-6)
    np.testing.assert_allclose(basis[:, 2], axes, rtol=0, atol=1e-7)
    assert (np.linalg.det(basis) > 0).all()


def test_rounding_does_not_turn_the_frames_of_upright_faces() -> None:
    """Faces along the axes, their z a rounding error to either side of 0: one frame."""
    upright = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [0.6, 0.8]])
    frames = [evaluate("basis.frag", np.c_[upright, np.full(5, z), np.zeros(5)], outputs=3) for z in (-4e-8, 0, 4e-8)]
    for frame in frames:
        np.testing.assert_allclose(frame, frames[1], rtol=0, atol=3e-7)
