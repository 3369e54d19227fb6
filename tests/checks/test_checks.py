"""The checks themselves: what is right passes, what is wrong fails, and the docstring's three lines do as they are."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from harness import checks
from harness.checks.chi2 import pearson, tabulate
from harness.checks.domains import UP, midpoints
from harness.checks.frame import axes
from harness.checks.shader import lobe_albedo
from tests.support.scenes import mi

__all__ = ["mi"]
TILTED = (0.36, -0.48, 0.8)
DOMAINS: dict[str, checks.Domain] = {"sphere": checks.Sphere(TILTED), "crowded": checks.Crowded(TILTED),
                                     "hemisphere": checks.Lobe(TILTED), "lobe": checks.Lobe(TILTED, 50.0)}


def cosine_sample(u: np.ndarray) -> np.ndarray:
    """Malley's method: a disk, lifted to the hemisphere about z."""
    r, turn = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    return np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(np.maximum(1 - u[:, 0], 0))], axis=-1)


def cosine_pdf(d: np.ndarray) -> np.ndarray:
    """cos θ / π above the horizon."""
    return np.asarray(np.maximum(d[:, 2], 0) / np.pi)


def turned(u: np.ndarray) -> np.ndarray:
    """The classic slip: a radius that is not a square root crowds the pole."""
    return cosine_sample(np.stack([u[:, 0]**2, u[:, 1]], axis=-1))


@pytest.mark.parametrize(("sample", "passes"), [(cosine_sample, True), (turned, False)])
def test_a_stranger_needs_three_lines(sample: Callable[..., np.ndarray], passes: bool) -> None:
    """Those of the package's docstring, run as they stand."""
    lines = re.findall(r"^    (.*)$", checks.__doc__ or "", re.MULTILINE)
    assert len(lines) == 3
    names: dict[str, Any] = {"sample": sample, "pdf": cosine_pdf}
    if passes:
        exec("\n".join(lines), names)
    else:
        with pytest.raises(AssertionError, match=r"χ² of 262,144 directions .* the worst cell, about \("):
            exec("\n".join(lines), names)
    assert names["found"].passed == passes


class TestDomains:
    """The maps of the unit square."""

    @pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
    def test_there_and_back(self, domain: checks.Domain) -> None:
        at = midpoints(40, 30)
        directions = domain.forward(at)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
        np.testing.assert_allclose(domain.backward(directions), at, atol=1e-9)

    @pytest.mark.parametrize(("name", "steradians"), [("sphere", 4), ("crowded", 4), ("hemisphere", 2)])
    def test_a_domain_has_its_solid_angle(self, name: str, steradians: float) -> None:
        """And a cell that of its corners: the integral of a direction's height to the fourth is a fifth of it."""
        domain = DOMAINS[name]
        height = checks.quadrature(lambda d: np.stack([d[:, 0]**0, (d @ np.array(TILTED))**4], axis=-1), domain)
        np.testing.assert_allclose(height, np.pi * steradians * np.array([1, 0.2]), rtol=1e-5)

    def test_a_lobe_is_even_in_its_domain(self) -> None:
        at = midpoints(50, 10)
        domain = DOMAINS["lobe"]
        density = (domain.forward(at) @ np.array(TILTED))**50 * 51 / (2 * np.pi)
        np.testing.assert_allclose(density * domain.jacobian(at), 1, rtol=1e-9)

    def test_below_the_horizon_is_outside_a_hemisphere(self) -> None:
        below = -np.array([TILTED])
        assert (DOMAINS["hemisphere"].backward(below) < 0).any() and (DOMAINS["sphere"].backward(below) <= 1).all()


class TestChi2:
    """Directions against their pdf."""

    @pytest.mark.parametrize("domain", [checks.Sphere(TILTED), checks.Crowded(UP), checks.Lobe(UP, 1.0)])
    def test_passes_a_right_pair_in_every_domain(self, domain: checks.Domain) -> None:
        found = checks.chi2(cosine_sample, cosine_pdf, domain)
        assert found.passed and found.value == pytest.approx(1, abs=0.3), found.sentence

    def test_p_is_uniform_for_a_right_pair(self) -> None:
        """So that LEVEL is the rate of false alarms: 60 seeds."""
        found = [checks.chi2(cosine_sample, cosine_pdf, count=20_000, cells=(11, 7), seed=seed).p for seed in range(60)]
        assert 0.35 < np.mean(np.array(found, dtype=float)) < 0.65 and min(p for p in found if p is not None) > 1e-4

    @pytest.mark.parametrize(("pdf", "says"), [
        (lambda d: 1.05 * cosine_pdf(d), "p = "),
        (lambda d: np.where(d[:, 0] > 0.6, 0, cosine_pdf(d)), "lie where the pdf is zero"),
        (lambda d: cosine_pdf(d) - 0.01, "the pdf is negative or not a number somewhere"),
        (lambda d: np.full(len(d), np.nan), "the pdf is negative or not a number somewhere"),
    ])
    def test_fails_a_wrong_pdf(self, pdf: Callable[..., np.ndarray], says: str) -> None:
        found = checks.chi2(cosine_sample, pdf)
        assert not found.passed and says in found.sentence

    def test_fails_directions_that_are_not_finite(self) -> None:
        def broken(u: np.ndarray) -> np.ndarray:
            return np.where(np.arange(len(u))[:, None] < 3, np.nan, cosine_sample(u))

        found = checks.chi2(broken, cosine_pdf)
        assert not found.passed and "; 3 directions are not finite or outside the domain" in found.sentence

    def test_refuses_another_shape(self) -> None:
        with pytest.raises(ValueError, match=r"sample must return \(100, 3\) directions, found \(100, 2\)"):
            checks.chi2(lambda u: u, cosine_pdf, count=100)

    @pytest.mark.parametrize("domain", [checks.Lobe(UP, 1.0), checks.Crowded(UP)])
    def test_the_statistic_is_mitsubas(self, mi: Any, domain: checks.Domain) -> None:
        """On the same tables: to rounding where no cell expects little, else but for a group that Mitsuba drops."""
        table = tabulate(cosine_sample(np.random.default_rng(3).random((20_000, 2))), cosine_pdf, domain, (15, 25), 10)
        observed, expected = table.observed.ravel(), table.expected.ravel()
        order = np.argsort(expected)
        theirs, dof, joined, _ = mi.math.chi2(mi.Float64(observed[order]), mi.Float64(expected[order]), 5)
        crowded = isinstance(domain, checks.Crowded)
        assert (joined > 20) == crowded
        assert pearson(observed, expected) == (pytest.approx(theirs, abs=5 if crowded else 1e-6), dof)

    def test_a_failure_leaves_a_picture(self, tmp_path: Path) -> None:
        """Red where there are too many: about the pole, which is the upper edge of Crowded."""
        found = checks.chi2(turned, cosine_pdf, checks.Crowded(UP))
        assert found.histogram is not None
        found.histogram.write(tmp_path / "where.png")
        picture = np.asarray(Image.open(tmp_path / "where.png"), dtype=float)
        assert picture.shape == (8 * 51, 8 * 25, 3)
        rows = picture.reshape(51, -1, 3).mean(axis=1)
        assert rows[15, 0] > rows[15, 2] + 100  # red
        assert rows[36, 2] > rows[36, 0] + 100  # blue


def test_integrals_of_pdfs() -> None:
    """A right one on any domain that holds it, and one over π² where 2π belongs."""
    assert checks.integral(cosine_pdf, checks.Lobe(UP)).passed and checks.integral(cosine_pdf).passed
    wrong = checks.integral(lambda d: 2 / np.pi * cosine_pdf(d))
    assert not wrong.passed and wrong.value == pytest.approx(2 / np.pi, rel=1e-5)
    assert wrong.sentence == "the pdf integrates to 0.63662, expected 1 ± 0.001"


class TestWeight:
    """The mean of f cos / pdf."""

    def test_passes_and_fails(self) -> None:
        """A lobe's half, sampled by its cosine: constant for f = 1/π, not for f = cos."""
        assert checks.weight(lambda u: np.full(len(u), 1.0), 1.0).passed
        exact = checks.quadrature(lambda d: np.maximum(d[:, 2], 0)**2, checks.Lobe(UP))
        assert float(exact) == pytest.approx(2 * np.pi / 3, rel=1e-5)
        assert checks.weight(lambda u: np.pi * cosine_sample(u)[:, 2], exact).passed
        wrong = checks.weight(lambda u: 1.01 * np.pi * cosine_sample(u)[:, 2], exact)
        assert not wrong.passed and wrong.value / wrong.expected == pytest.approx(1.01, abs=2e-3)

    def test_one_channel_of_three_fails_them(self) -> None:
        noise = np.random.default_rng(1).normal([1, 1.02, 1], 0.1, (10_000, 3))
        found = checks.weight(lambda u: noise, [1, 1, 1])
        assert not found.passed and "of channel 1" in found.sentence

    def test_a_weight_that_is_not_finite_fails(self) -> None:
        found = checks.weight(lambda u: np.where(np.arange(len(u)) == 7, np.inf, 1.0), 1.0)
        assert not found.passed and found.sentence == "1 of 262,144 weights are not finite"


def test_the_albedo_of_a_lobe_knows_its_closed_forms() -> None:
    """(α+1)/(α+2) at normal incidence; for α = 0, half a hemisphere about the mirror direction: (1 + cos θ) / 4."""
    for alpha in (0.0, 1.0, 10.0, 1000.0):
        assert lobe_albedo(alpha, 0.0) == pytest.approx((alpha + 1) / (alpha + 2), rel=1e-5)
    for angle in (0.5, 1.22):
        assert lobe_albedo(0.0, angle) == pytest.approx((1 + np.cos(angle)) / 4, rel=1e-5)


def test_frames() -> None:
    """Householder's frame exists everywhere; one by a cross product with x does not about x, and is NaN there."""
    def householder(z: np.ndarray) -> np.ndarray:
        v = z + np.where(z[:, 2:] >= 0, 1, -1) * [0, 0, 1]
        return np.asarray(np.eye(3) - 2 * v[:, :, None] * v[:, None, :] / (v * v).sum(axis=1)[:, None, None])

    def crossed(z: np.ndarray) -> np.ndarray:
        x = np.cross(z, [1.0, 0.0, 0.0])
        with np.errstate(invalid="ignore"):
            x /= np.linalg.norm(x, axis=1, keepdims=True)
        return np.stack([x, np.cross(z, x), z], axis=1)

    unit = axes() / np.linalg.norm(axes(), axis=1, keepdims=True)
    assert checks.frame(householder, unit).passed
    wrong = checks.frame(crossed)
    assert not wrong.passed and wrong.value == 2
    assert "2 of 10,026 axes have no orthonormal frame" in wrong.sentence and "by inf" in wrong.sentence


@pytest.mark.parametrize("bits", [8, 12, 24])
def test_distinct_values_are_counted_against_chance(bits: int) -> None:
    values = np.random.default_rng(6).integers(0, 2**bits, 1 << 18) / 2.0**bits
    assert checks.distinct(values).passed == (bits == 24)
    assert checks.distinct(values, bits=bits).passed


def test_neighbours_that_share_a_number_correlate() -> None:
    white = np.random.default_rng(5).normal(size=20_000)
    assert checks.independent(white[1:], white[:-1]).passed
    smooth = white + np.roll(white, 1)
    found = checks.independent(smooth[1:], smooth[:-1])
    assert not found.passed and found.value == pytest.approx(0.5, abs=0.03)
    assert checks.independent(smooth[1:], smooth[:-1], pairs=10).passed


def test_a_level_is_shared_among_tests() -> None:
    """So that one of them fails as often as the whole was to."""
    assert 1 - (1 - checks.shared_level(0.01, 30))**30 == pytest.approx(0.01, rel=1e-9)
