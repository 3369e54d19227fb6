"""Are runs independent? Two that share their random numbers are noticed by their pixels."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from harness.errors import HarnessError
from harness.samples.estimate import luminance

# By how much the correlation of two runs' noise may exceed what independence gives before it is said: eight standard
# deviations of chance, and no less than a tenth.
CHANCE, NOTABLE = 8.0, 0.1
# From here on the runs have most of their samples in common, and no interval means anything.
SAME = 0.5
# Pixels that the correlations are taken over at the most; more see no smaller ones that matter.
MAX_PIXELS = 1 << 16


def require_independent(names: Sequence[str], images: Sequence[np.ndarray]) -> list[str]:
    """HarnessError, naming two of them, where runs (H, W, 3) have the same pixels or the same noise; else warnings.

    Three or more can be held against each other. The noise of a run is its difference from the mean of all, over each
    pixel's own standard deviation; for n independent runs the noise of two correlates by -1 / (n - 1).
    """
    if twins := duplicate(names, images):
        raise HarnessError(f"{twins[0]} and {twins[1]} hold the same pixels, so they are not two runs: give each a "
                           "seed of its own (a render without noise needs one file only)")
    if len(images) < 3:
        return []
    correlations, pixels = _excess_correlations(images)
    if not pixels:
        return []
    first, second = divmod(int(np.argmax(correlations)), len(images))
    largest, pair = float(correlations[first, second]), f"{names[first]} and {names[second]}"
    if largest > max(SAME, CHANCE / np.sqrt(pixels)):
        raise HarnessError(f"{pair} share most of their noise (it correlates by {largest:.2f} more than that of "
                           "independent runs): give each a seed of its own")
    if largest > max(NOTABLE, CHANCE / np.sqrt(pixels)):
        return [f"{pair} share some of their noise (it correlates by {largest:.2f} more than that of independent "
                "runs): intervals are too narrow; give each run a seed of its own"]
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


def _excess_correlations(images: Sequence[np.ndarray]) -> tuple[np.ndarray, int]:
    """(n, n) correlations above those of independent runs, those of a run with itself left out; and of how many
    pixels."""
    values = np.stack([luminance(image).ravel() for image in images])
    values = values[:, ::-(-values.shape[1] // MAX_PIXELS)]
    with np.errstate(invalid="ignore"):  # of pixels that are not finite, which are left out
        away = values - values.mean(axis=0)
        spread = away.std(axis=0)
        noisy = np.isfinite(spread) & (spread > 1e-6 * np.abs(values).mean(axis=0))
    noise = away[:, noisy] / spread[noisy]
    count = len(images)
    excess = np.full((count, count), -np.inf)
    if noise.shape[1]:
        for i, j in combinations(range(count), 2):
            sizes = float(np.sqrt((noise[i]**2).sum() * (noise[j]**2).sum()))
            excess[i, j] = (noise[i] * noise[j]).sum() / sizes + 1 / (count - 1) if sizes else -np.inf
    return excess, int(noise.shape[1])
