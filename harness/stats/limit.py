"""Does an estimator converge to the reference, or to something near it? The error that no number of samples removes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.stats.bias import check_confidence
from harness.stats.deviates import skew_interval


@dataclass(frozen=True)
class LimitError:
    """Root mean square over pixels and channels of the bias, relative to the root mean square of the reference.

    `low`, `high`: its confidence interval; NaN where a variance is unknown. Unlike the errors of tiles it sees what
    averages out between neighbours: an image shifted by a pixel, a texture by a texel, a filter that is too wide.
    """

    value: float
    low: float
    high: float
    confidence: float


def limit_error(mean: np.ndarray, variance: np.ndarray, reference: np.ndarray, reference_variance: np.ndarray,
                confidence: float = 0.95) -> LimitError:
    """The error that is left of the RMSE when the noise of both sides is taken out; images (H, W, C) of one size.

    For estimates x of independent replicas and a reference r with noise of its own, the mean of (x_i - r)(x_j - r)
    over pairs of different replicas is unbiased for bias² + var(r), since the noise of two replicas does not
    correlate (a U-statistic, Hoeffding 1948). That mean equals (x̄ - r)² - var(x̄) with the replicas' own variance of
    their mean, so it takes the merged estimate alone; and compared with a fit of RMSE² = a/N + b² to the prefixes of a
    run it supposes no law and has the noise of all R replicas together, not of one: an interval smaller by √R.
    Noise is independent between pixels (box filter, a random stream for each), hence the interval, by `skew_interval`
    over pixels. An estimate of the square below zero, as chance makes it for an unbiased render in half of the cases,
    is a `value` of zero. HarnessError for a confidence outside (0, 1) or images that differ in size.
    """
    check_confidence(confidence)
    shapes = {np.shape(image) for image in (mean, variance, reference, reference_variance)}
    if len(shapes) != 1:
        raise HarnessError(f"expected images and variances of one size, found {sorted(shapes)}")
    squares = (((mean - reference)**2 - variance - reference_variance).mean(axis=-1)).ravel()
    scale = float((reference**2 - reference_variance).mean())
    scale = scale if scale > 0 else 1.0  # of a black reference, errors are absolute
    value, count = float(squares.mean()), squares.size
    away = squares - value
    second, third = (np.array((away**power).sum() / count**power) for power in (2, 3))
    low, high = skew_interval(np.array(value), second, third, np.array(count - 1.0), 1 - confidence)
    return LimitError(_root(value / scale), _root(float(low) / scale), _root(float(high) / scale), confidence)


def _root(square: float) -> float:
    return math.sqrt(max(square, 0.0)) if math.isfinite(square) else math.nan
