"""Are runs independent? Two that share their random numbers are noticed by their pixels."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from harness.errors import HarnessError
from harness.samples.estimate import luminance

# What correlation of two runs' noise is said: eight standard deviations of chance, and no less than a tenth.
CHANCE, NOTABLE = 8.0, 0.1
# From here on the runs have most of their samples in common, and no interval means anything.
SAME = 0.5
# Pixels that the correlations are taken over at the most; more see no smaller ones that matter.
MAX_PIXELS = 1 << 16


def require_independent(names: Sequence[str], images: Sequence[np.ndarray]) -> list[str]:
    """HarnessError, naming two of them, where runs (H, W, 3) have the same pixels or the same noise; else warnings.

    Four or more can be held against each other, see `_correlations`; of fewer only the same pixels are noticed.
    """
    if twins := duplicate(names, images):
        raise HarnessError(f"{twins[0]} and {twins[1]} hold the same pixels, so they are not two runs: give each a "
                           "seed of its own (a render without noise needs one file only)")
    if len(images) < 4:
        return []
    correlations, pixels = _correlations(images)
    if not pixels:
        return []
    first, second = divmod(int(np.argmax(correlations)), len(images))
    largest, pair = float(correlations[first, second]), f"{names[first]} and {names[second]}"
    if largest > max(SAME, CHANCE / np.sqrt(pixels)):
        raise HarnessError(f"{pair} share most of their noise (its correlation is {largest:.2f}): "
                           "give each a seed of its own")
    if largest > max(NOTABLE, CHANCE / np.sqrt(pixels)):
        return [f"{pair} share some of their noise (its correlation is {largest:.2f}): "
                "intervals are too narrow; give each run a seed of its own"]
    return []


def duplicate(names: Sequence[str], images: Sequence[np.ndarray], split: int = 0) -> tuple[str, str] | None:
    """The first two with the same pixels, one from before and one from after `split` if that is not 0."""
    seen: dict[bytes, int] = {}
    for k, image in enumerate(images):
        digest = hashlib.sha256(np.ascontiguousarray(image, dtype=np.float32).tobytes()).digest()
        twin = seen.get(digest)
        if twin is not None and (not split or twin < split <= k):
            return names[twin], names[k]
        seen.setdefault(digest, k)
    return None


def _correlations(images: Sequence[np.ndarray]) -> tuple[np.ndarray, int]:
    """(n, n) correlations of the runs' noise, those of a run with itself left out; and of how many pixels.

    For independent runs the mean square of a difference is the sum of two variances, v_i + v_j, whatever the runs'
    lengths; these follow from all differences by least squares, and what a pair lacks is twice its covariance. Each
    pixel counts by its own variance between the runs, so that bright ones are not all that is seen.
    """
    values = np.stack([luminance(image).ravel() for image in images])
    values = values[:, ::-(-values.shape[1] // MAX_PIXELS)]
    with np.errstate(invalid="ignore"):  # of pixels that are not finite, which are left out
        away = values - values.mean(axis=0)
        spread = away.std(axis=0)
        noisy = np.isfinite(spread) & (spread > 1e-6 * np.abs(values).mean(axis=0))
    noise = away[:, noisy] / spread[noisy]
    count, pixels = noise.shape
    products = noise @ noise.T / max(pixels, 1)
    squares = np.diag(products)[:, None] + np.diag(products)[None] - 2 * products
    rows = squares.sum(axis=1)
    variances = (rows - rows.sum() / (2 * (count - 1))) / (count - 2)
    sums = variances[:, None] + variances[None]
    # Beside noisier runs a quiet one's variance is a small difference of large numbers.
    correlations = (sums - squares) / np.maximum(sums, max(rows.sum() / (count * (count - 1)), 1e-12))
    np.fill_diagonal(correlations, -np.inf)
    return correlations, pixels
