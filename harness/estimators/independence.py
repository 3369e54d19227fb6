"""Are runs independent? Two that share their random numbers are noticed by their pixels."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from harness.errors import HarnessError
from harness.samples.estimate import luminance

# What correlation of two runs' noise is said: eight standard deviations of chance, and no less than a tenth.
CHANCE, NOTABLE = 8.0, 0.1
# From here on the runs have most of their samples in common, and no interval means anything.
SAME = 0.5
# Pixels that the correlations are taken over at the most; more see no smaller ones that matter.
MAX_PIXELS = 1 << 16
# Pixels darker than this part of the mean count as if they had it.
DARK = 0.01
# Pairs that are looked at: beside noisy runs a quiet pair's correlation may be large by chance.
CANDIDATES = 64
# Significant binary digits of a half float, and half a unit of the last.
HALF_DIGITS, HALF = 11, 2.0**-11


def require_independent(names: Sequence[str], images: Sequence[np.ndarray],
                        samples: Sequence[int | None] = ()) -> list[str]:
    """HarnessError, naming two of them, where runs (H, W, 3) have the same pixels or the same noise; else warnings.

    `samples`: per pixel of each run, None where that is not known. Four runs or more can be held against each other,
    whatever their lengths, see `_of_many`. Three cannot: two that share their noise look like two longer ones. If
    all are as long they can. Of two there is one difference, which says nothing but that they differ: told are the same
    pixels, also as half floats, and the same but for a factor.
    """
    if twins := duplicate(names, images):
        raise HarnessError(f"{twins[0]} and {twins[1]} hold the same pixels, so they are not two runs: give each a "
                           "seed of its own (a render without noise needs one file only)")
    if len(images) < 4 and (twins := _scaled(names, images)):
        raise HarnessError(f"{twins[0]} and {twins[1]} hold the same pixels but for a factor, so they are not two "
                           "runs: give each a seed of its own, and leave all as they were rendered")
    known = all(samples) and len(samples) == len(images)
    if len(images) < 3 or (len(images) == 3 and known and len(set(samples)) > 1):
        return []
    shared = _of_three(images) if len(images) == 3 else _of_many(images)
    if shared is None:
        return []
    unsure = len(images) == 3 and not known
    pair = f"{names[shared.one]} and {names[shared.other]}"
    if len(images) == 4:  # of which either both or the two others share noise
        pair += " (or the two others)"
    found = f"(its correlation is {shared.correlation:.2f}{', if all three are as long' if unsure else ''})"
    if shared.correlation > SAME and not unsure:
        raise HarnessError(f"{pair} share most of their noise {found}: give each a seed of its own")
    return [f"{pair} share {'most' if shared.correlation > SAME else 'some'} of their noise {found}: intervals are too "
            "narrow; give each run a seed of its own"]


def duplicate(names: Sequence[str], images: Sequence[np.ndarray], split: int = 0) -> tuple[str, str] | None:
    """The first two with the same pixels, one from before and one from after `split` if that is not 0.

    To the precision of half floats, for some copies are kept as such: noise that small in every pixel is none.
    """
    seen: dict[bytes, int] = {}
    for k, image in enumerate(images):
        digits, exponent = np.frexp(np.asarray(image, dtype=np.float32))
        rounded = np.ldexp(np.rint(digits * 2.0**HALF_DIGITS), exponent)
        digest = hashlib.sha256(np.ascontiguousarray(rounded, dtype=np.float64).tobytes()).digest()
        twin = seen.get(digest)
        if twin is not None and (not split or twin < split <= k):
            return names[twin], names[k]
        seen.setdefault(digest, k)
    return None


def _scaled(names: Sequence[str], images: Sequence[np.ndarray]) -> tuple[str, str] | None:
    """The first two that are the same but for a factor which is not 1, to the precision of half floats."""
    for (one, a), (other, b) in combinations(zip(names, images, strict=True), 2):
        lit = (a != 0) & np.isfinite(a) & np.isfinite(b)
        factors = b[lit].astype(np.float64) / a[lit]
        if not lit.any() or not np.isfinite(factors).all():
            continue
        factor = float(np.median(factors))
        if abs(factor - 1) > 4 * HALF and (np.abs(factors - factor) <= 2 * HALF * abs(factor)).all():
            return one, other
    return None


class _Shared(NamedTuple):
    """Two runs, by their numbers, and the correlation of their noise."""

    one: int
    other: int
    correlation: float


def _values(images: Sequence[np.ndarray]) -> np.ndarray:
    """(n, pixels) luminance less the mean of all runs; pixels that are finite in all, and not all of large images."""
    values = np.stack([luminance(image).ravel() for image in images])
    values = values[:, ::-(-values.shape[1] // MAX_PIXELS)]
    return np.asarray(values[:, np.isfinite(values).all(axis=0)])


def _of_three(images: Sequence[np.ndarray]) -> _Shared | None:
    """Of runs of one length: by how much the smallest mean square of a pair's difference is below the largest.

    Each pixel counts by its own scatter, so that bright ones are not all that is seen: for runs of one length that is
    fair to all pairs.
    """
    values = _values(images)
    away = values - values.mean(axis=0)
    spread = away.std(axis=0)
    noisy = spread > 1e-6 * np.abs(values).mean(axis=0)
    if not noisy.any():
        return None
    noise = away[:, noisy] / spread[noisy]
    pairs = [(0, 1), (0, 2), (1, 2)]
    squares = [float(((noise[i] - noise[j])**2).mean()) for i, j in pairs]
    correlation = 1 - min(squares) / max(squares)
    significant = correlation > max(NOTABLE, CHANCE / np.sqrt(noise.shape[1]))
    return _Shared(*pairs[int(np.argmin(squares))], correlation) if significant else None


def _of_many(images: Sequence[np.ndarray]) -> _Shared | None:
    """Of four runs or more, whatever their lengths: the pair of the largest correlation, if that is notable and beyond
    chance.

    For runs i, j and any two others k, l the products of differences (x_i - x_k)(x_j - x_l) have the mean
    cov(i, j) + cov(k, l), and (x_i - x_k)(x_i - x_l) have var(i) + cov(k, l): no run's own variance is in the way, nor
    skewness. Taken over all k and l at once, in units of each pixel's mean.
    """
    values = _values(images)
    mean = values.mean(axis=0)
    scale = np.maximum(np.abs(mean), DARK * np.abs(mean).mean()) if mean.size else mean
    if not scale.any():
        return None
    noise = (values - mean)[:, scale > 0] / scale[scale > 0]
    gram = noise @ noise.T / noise.shape[1]
    count, own, rows = len(gram), np.diag(gram), gram.sum(axis=1)
    first, second = np.triu_indices(count, 1)
    between = gram[first, second]
    to_others = [(rows[i] - own[i] - between) / (count - 2) for i in (first, second)]
    others = ((gram.sum() - 2 * (rows[first] + rows[second]) + 2 * between - own.sum())
              + 2 * (own[first] + own[second])) / ((count - 2) * (count - 3))
    covariance = between - to_others[0] - to_others[1] + others
    variances = [np.maximum(own[i] - 2 * far + others, 1e-6 * own.mean())
                 for i, far in zip((first, second), to_others, strict=True)]
    correlations = covariance / np.sqrt(variances[0] * variances[1])
    for pair in np.argsort(-correlations)[:CANDIDATES]:
        i, j, correlation = int(first[pair]), int(second[pair]), min(float(correlations[pair]), 1.0)
        if correlation > NOTABLE and _beyond_chance(noise, i, j):
            return _Shared(i, j, correlation)
    return None


def _beyond_chance(noise: np.ndarray, i: int, j: int) -> bool:
    """Is the covariance of two runs' noise (n, pixels) more than its scatter over pixels explains?"""
    others = np.delete(noise, (i, j), axis=0)
    mean, count = others.mean(axis=0), len(others)
    products = (noise[i] - mean) * (noise[j] - mean) - others.var(axis=0) / (count - 1)
    return bool(products.mean() > CHANCE * products.std() / np.sqrt(products.size))
