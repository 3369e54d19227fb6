"""Runs that share their random numbers are noticed, as far as so few images can tell; independent ones never are."""

from __future__ import annotations

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.independence import duplicate, require_independent

SHAPE = (48, 64, 3)
LEVEL = np.linspace(0.01, 4.0, np.prod(SHAPE)).reshape(SHAPE)  # dark and bright pixels


def noise(seed: int) -> np.ndarray:
    """A sample's: in proportion to the pixel, heavy on the bright side."""
    return LEVEL * (np.random.default_rng(seed).lognormal(0.0, 1.0, SHAPE) - np.exp(0.5))


def runs(*samples: int, common: float = 0.0, seed: int = 0) -> list[np.ndarray]:
    """Of so many samples each; the last two have the correlation `common`."""
    noises = [noise(seed + k) for k in range(len(samples))]
    noises[-1] = common * noises[-2] + np.sqrt(1 - common**2) * noises[-1]
    return [(5 * LEVEL + each / np.sqrt(count)).astype(np.float32) for each, count in zip(noises, samples, strict=True)]


def names(count: int) -> list[str]:
    return [f"run {k}" for k in range(count)]


@pytest.mark.parametrize("samples", [
    (4, 4), (4, 4, 4), (1, 4, 64), (4,) * 4, (1, 4, 16, 64), (64, 64, 64, 1), (1, 1, 1, 1000),
    (64, 64, 1, 1), (1, 1, 1, 16, 64, 64), (2, 3) * 8])
@pytest.mark.parametrize("seed", [0, 100, 200])
def test_independent_runs_are_not_accused_whatever_their_lengths(samples: tuple[int, ...], seed: int) -> None:
    assert require_independent(names(len(samples)), runs(*samples, seed=seed), samples) == []


@pytest.mark.parametrize("samples", [(4,) * 3, (64, 1, 1, 1, 4), (4, 2, 4, 2, 4), (1, 64, 64, 16, 4, 4), (4,) * 12])
@pytest.mark.parametrize("seed", [0, 100])
def test_most_noise_in_common_is_refused_whatever_the_lengths(samples: tuple[int, ...], seed: int) -> None:
    last = len(samples) - 1
    with pytest.raises(HarnessError, match=rf"^run {last - 1} and run {last} share most of their noise \(its"):
        require_independent(names(len(samples)), runs(*samples, common=0.95, seed=seed), samples)


@pytest.mark.parametrize("common", [0.35, 0.95])
@pytest.mark.parametrize("samples", [(4,) * 4, (64, 1, 4, 4), (64, 64, 1, 1)])
def test_of_four_either_both_or_the_two_others_are_told_of(samples: tuple[int, ...], common: float) -> None:
    images = runs(*samples, common=common)
    try:
        said, = require_independent(names(4), images, samples)
    except HarnessError as error:
        said = str(error)
    assert said.startswith(("run 2 and run 3 (or the two others) share", "run 0 and run 1 (or the two others) share"))


@pytest.mark.parametrize(("samples", "common"), [((4,) * 5, 0.35), ((4,) * 5, 0.8), ((4, 2, 4, 2, 4), 0.35)])
def test_the_correlation_is_told(samples: tuple[int, ...], common: float) -> None:
    """And that is about what it is, however bright and heavy-tailed pixels are."""
    try:
        said, = require_independent(names(5), runs(*samples, common=common), samples)
        assert said.startswith("run 3 and run 4 share some of their noise")
    except HarnessError as error:
        said = str(error)
        assert common > 0.5
    assert float(said.split("correlation is ")[1].split(")")[0]) == pytest.approx(common, abs=0.1)


class TestThree:
    """Two that share their noise look like two longer ones."""

    def test_of_unknown_length_are_warned_of(self) -> None:
        warning, = require_independent(names(3), runs(4, 4, 4, common=0.95))
        assert warning.startswith("run 1 and run 2 share most of their noise (its correlation is 0.")
        assert "if all three are as long" in warning

    def test_of_unequal_length_tell_nothing(self) -> None:
        assert require_independent(names(3), runs(1, 4, 4, common=0.95), (1, 4, 4)) == []


class TestTwo:
    """Of one difference little is known."""

    def test_with_noise_in_common_are_not_told_from_longer_ones(self) -> None:
        assert require_independent(names(2), runs(4, 4, common=0.95), (4, 4)) == []

    @pytest.mark.parametrize("kind", [np.float16, np.float32])
    def test_with_the_same_pixels_are_refused_as_half_floats_too(self, kind: type[np.generic]) -> None:
        one, _ = runs(4, 4)
        with pytest.raises(HarnessError, match="run 0 and run 1 hold the same pixels, so they are not two runs"):
            require_independent(names(2), [one, one.astype(kind).astype(np.float32)])

    @pytest.mark.parametrize("factor", [0.5, 1.003, 2.2])
    @pytest.mark.parametrize("kind", [np.float16, np.float32])
    def test_with_the_same_but_for_a_factor_are_refused(self, factor: float, kind: type[np.generic]) -> None:
        one, _ = runs(4, 4)
        with pytest.raises(HarnessError, match="run 0 and run 1 hold the same pixels but for a factor, so they are"):
            require_independent(names(2), [one, (factor * one).astype(kind).astype(np.float32)])

    def test_that_have_converged_are_not_accused(self) -> None:
        """Noise of 1e-4 to 1e-3 of a pixel; and one of them with a bias that is a factor of nearly 1."""
        one, other = runs(10**6, 10**6)
        assert require_independent(names(2), [one, other]) == []
        assert require_independent(names(2), [one, 1.001 * other]) == []

    def test_that_are_dark_or_not_finite_are_looked_at_all_the_same(self) -> None:
        one, other = (1e-9 * image for image in runs(4, 4))
        one[0, 0], other[0, 0] = np.nan, np.inf
        assert require_independent(names(2), [one, other]) == []
        assert duplicate(names(2), [one, one]) == ("run 0", "run 1")
