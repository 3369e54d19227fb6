"""What verdicts are held to unless somebody says otherwise: tolerances, confidence, the rate of false alarms."""

from __future__ import annotations

import dataclasses
import math

from harness.samples.estimate import Estimate
from harness.scene import Scene
from harness.stats.bias import MeanErrorVerdict, mean_error_verdict
from harness.stats.deviates import staged
from harness.stats.levels import family_level
from harness.stats.verdicts import TESTS, Tolerance

# The bias that an equivalence verdict tolerates, and its confidence, unless the caller says otherwise.
TOLERANCE = 0.002
CONFIDENCE = 0.95
# The same of the mean where the reference shows a mesh in place of a displaced sphere (harness/reference/displaced.py).
# Tiles are not given more: with 16,384 samples per pixel a side, those of `displaced` and `displaced_spheres` (of 1/21
# and 1/19 of the image's width) are nowhere off by more than 0.3 %, which is what noise makes of them (|z| <= 3.1).
MESH_TOLERANCE = 0.005
# The probability with which all verdicts of one study, comparison or report together fail good renders, at the most.
FALSE_ALARMS = 0.01


def judge(test: Estimate, reference: Estimate, *, tolerance: float = TOLERANCE, confidence: float = CONFIDENCE,
          fail_level: float | None = None, looked: tuple[int | None, int | None] = (None, None)) -> MeanErrorVerdict:
    """Is the test's image mean equivalent to the reference's, per channel and in luminance?

    `looked`: of test and reference, the first batches whose variance decided how many to draw; None where nothing did.
    """
    return mean_error_verdict(
        test.image_mean, test.image_variance, _degrees_of_freedom(test, looked[0]),
        reference.image_mean, reference.image_variance, _degrees_of_freedom(reference, looked[1]),
        test_third=test.image_third, reference_third=reference.image_third,
        tolerance=tolerance, confidence=confidence, fail_level=fail_level)


def fail_level(family: int) -> float:
    """The level at which each test of a strategy (image, larger tiles, smaller tiles) fails, so many strategies
    sharing `FALSE_ALARMS`."""
    return family_level(FALSE_ALARMS, TESTS * family)


def tolerances(mean: float) -> Tolerance:
    """The tolerances of the tiles that go with one of the mean: larger by what `Tolerance`'s own are, in balance."""
    usual = Tolerance()
    return Tolerance(mean, mean / usual.mean * usual.coarse, mean / usual.mean * usual.fine)


def tolerance_for(scene: Scene) -> tuple[Tolerance, str]:
    """The bias that verdicts on this scene tolerate, and a sentence that says why it is not the usual one."""
    usual = tolerances(TOLERANCE)
    if any(shape.displacement for shape in scene.shapes):
        return dataclasses.replace(usual, mean=MESH_TOLERANCE), (
            f"the tolerance of the mean is {MESH_TOLERANCE:.1%} instead of {TOLERANCE:.1%}: the reference shows meshes "
            "in place of the displaced spheres. Those of tiles are as usual, since meshes are measured to stay far "
            "within them")
    return usual, ""


def _degrees_of_freedom(estimate: Estimate, looked: int | None) -> float:
    if estimate.batches == 0:
        return math.inf
    dof = estimate.batches - 1
    return dof if looked is None else staged(looked - 1, dof)
