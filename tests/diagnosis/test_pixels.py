"""Which way up a picture is and how its rays fill their pixels, whatever else is wrong with it."""

from __future__ import annotations

import numpy as np
import pytest

from harness.diagnosis.pixels import TURNS, View, find_spread, find_turn, known
from harness.samples.estimate import Batch, Estimate, merge
from harness.scene.footprint import BOX, Footprint

SIZE, FINE = 24, 16
RNG = np.random.default_rng(3)
# A disk, a bar and a slope, in FINE x FINE parts of each pixel.
Y, X = (np.mgrid[0:SIZE * FINE, 0:SIZE * FINE] + 0.5) / FINE
PARTS = 0.2 + 0.03 * Y + 4.0 * (np.hypot(X - 8.3, Y - 9.4) < 5.2) + 1.5 * (np.abs(X + 0.4 * Y - 25.0) < 1.3)


def seen(footprint: Footprint, change: float = 1.0) -> np.ndarray:
    """The picture, (H, W, 3), as these rays see it: by its definition, ray by ray on a fine grid."""
    count = 256
    one, other = RNG.random((2, count, 2))
    place = (one + other) / 2 if footprint.tent else one
    place = footprint.width * (place - 0.5) + 0.5 + np.array([footprint.right, footprint.down])
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    total = np.zeros((SIZE, SIZE))
    for dx, dy in place:
        y, x = (np.clip(((at + d) * FINE).astype(int), 0, SIZE * FINE - 1) for at, d in ((rows, dy), (columns, dx)))
        total += PARTS[y, x]**change
    return np.repeat((total / count)[..., None], 3, axis=2)


def estimate(mean: np.ndarray, noise: float = 0.01) -> Estimate:
    return merge(Batch((mean * (1 + noise * RNG.standard_normal(mean.shape))).astype(np.float32), 1) for _ in range(8))


@pytest.mark.parametrize("wrong", [1.0, 0.8, 1.3])
@pytest.mark.parametrize("name", ["jitter-missing", "half-pixel-up-right", "half-pixel-down-left",
                                  "filter-two-pixels-wide"])
def test_names_the_footprint_of_pictures_that_are_wrong_besides(name: str, wrong: float) -> None:
    defect = next(one for one in known() if one.id == name)
    assert defect.footprint is not None
    found = find_spread(estimate(seen(defect.footprint) * wrong), estimate(seen(BOX)), lambda one: estimate(seen(one)))
    assert found is not None and found.defect.id == name


@pytest.mark.parametrize("wrong", [1.0, 0.9, 1.2])
def test_a_box_is_not_accused(wrong: float) -> None:
    picture = estimate(seen(BOX, wrong))
    assert find_spread(picture, estimate(seen(BOX)), lambda one: estimate(seen(one))) is None


def test_nothing_is_said_of_a_picture_without_edges() -> None:
    flat = estimate(np.full((SIZE, SIZE, 3), 0.5))
    assert find_spread(flat, flat, lambda one: flat) is None


@pytest.mark.parametrize("says", TURNS)
def test_tells_which_way_up_a_wrong_picture_is(says: str) -> None:
    truth = seen(BOX)
    turned = TURNS[says](0.7 * truth**1.4 + 0.1 * truth)
    assert find_turn(turned, truth) == says
    assert np.array_equal(View(says).turned(TURNS[says](truth)), truth)
    assert not View(says).is_usual and View().is_usual


def test_no_turn_is_told_of_what_is_the_right_way_up_or_symmetrical() -> None:
    truth = seen(BOX)
    assert find_turn(0.5 * truth**2, truth) == ""
    both = truth + truth[:, ::-1]
    assert find_turn(both[:, ::-1] * 0.8, both) == ""
    assert find_turn(RNG.random(truth.shape), truth) == ""


def test_a_picture_that_is_the_same_everywhere_is_turned_by_nothing() -> None:
    """A black one, say, which has no order of bright and dark to compare."""
    assert find_turn(np.zeros((SIZE, SIZE, 3)), seen(BOX)) == ""
