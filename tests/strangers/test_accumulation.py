"""How a loop averages its frames: from its result and the frames alone."""

from __future__ import annotations

import numpy as np
import pytest

from harness.shader.contract import Law
from harness.strangers.accumulation import judge_accumulation, radiance_of

FRAMES = 24
SINGLES = np.random.default_rng(1).random((FRAMES, 8, 8, 3))


def loop(weights: np.ndarray, more: float = 0.0) -> np.ndarray:
    """The result with these weights of the frames."""
    return np.tensordot(weights, SINGLES, 1) + more


FAIR = np.full(FRAMES, 1 / FRAMES)


def thrown(count: int, divisor: int) -> np.ndarray:
    return np.where(np.arange(FRAMES) < count, 0.0, 1 / divisor)


@pytest.mark.parametrize(("weights", "told"), [
    (FAIR, "is the mean of its 24 frames, exactly"),
    (thrown(1, 23), "throws its first frame away"),
    (thrown(3, 21), "throws its first 3 frames away")])
def test_averages_pass(weights: np.ndarray, told: str) -> None:
    verdict = judge_accumulation(loop(weights), SINGLES, Law("mean"))
    assert verdict.outcome == "pass" and verdict.exact
    assert told in verdict.told


@pytest.mark.parametrize(("weights", "more", "told"), [
    (np.full(FRAMES, 1 / (FRAMES + 1)), 0.0, "all frames count alike, but 0.96 together"),
    (thrown(3, 24), 0.0, "throws its first 3 frames away but counts them"),
    (0.5**np.arange(FRAMES, 0, -1), 0.0, "keeps the noise of about 3 frames"),
    (np.where(np.arange(FRAMES) == FRAMES - 1, 1.0, 0.0), 0.0, "only the last frame is left"),
    (np.where(np.arange(FRAMES) == 0, 2.0, 1.0) / (FRAMES + 1), 0.0, "frame 0 counts 2 times as much"),
    (FAIR, 0.05, "+0.05 is in the result besides its 24 frames")])
def test_others_fail_and_are_told_apart(weights: np.ndarray, more: float, told: str) -> None:
    verdict = judge_accumulation(loop(weights, more), SINGLES, Law("mean"))
    assert verdict.outcome == "fail"
    assert told in verdict.told


def test_other_random_numbers_alone_than_in_the_loop_are_judged_by_their_means() -> None:
    other = np.random.default_rng(2).random(SINGLES.shape).mean(axis=0)
    assert judge_accumulation(other, SINGLES, Law("mean")).outcome == "pass"
    assert judge_accumulation(1.2 * other, SINGLES, Law("mean")).outcome == "fail"


def test_what_is_not_joined_is_not_judged() -> None:
    assert judge_accumulation(loop(FAIR), SINGLES, Law("none")).outcome == "none"


@pytest.mark.parametrize(("law", "pixels"), [
    (Law("sum", count="alpha"), (12.0, 12.0, 12.0, 6.0)), (Law("sum"), (12.0, 12.0, 12.0, 1.0)),
    (Law("mean", encoding="sqrt"), (2.0**0.5, 2.0**0.5, 2.0**0.5, 1.0))])
def test_what_is_left_is_turned_into_radiance(law: Law, pixels: tuple[float, ...]) -> None:
    assert radiance_of(np.broadcast_to(pixels, (2, 2, 4)), law, 6) == pytest.approx(2.0)
