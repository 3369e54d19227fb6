"""Whether random numbers are as many as chance has them, and unrelated to their neighbours."""

from __future__ import annotations

import numpy as np
from scipy import special

from harness.checks.finding import LEVEL, Finding

# A generator of 24-bit numbers repeats itself as often as chance has it: of 2^18 numbers the share has a standard
# deviation of 5e-4.
ENOUGH_VALUES = 0.99


def distinct(numbers: np.ndarray, *, bits: int = 24, least: float = ENOUGH_VALUES) -> Finding:
    """Judge how many distinct values there are among numbers of any shape, against chance for so many bits."""
    share = distinct_share(numbers, bits)
    sentence = (f"{numbers.size:,} numbers hold {share:.2%} of the distinct values that {bits} random bits would have, "
                f"expected at least {least:.0%}")
    return Finding("distinct", share, 1.0, share > least, sentence, error=1 - least)


def distinct_share(numbers: np.ndarray, bits: int = 24) -> float:
    """How many distinct values there are, as a share of what as many uniform numbers of so many bits would have."""
    expected = 2.0**bits * -np.expm1(numbers.size * np.log1p(-(2.0**-bits)))
    return float(len(np.unique(numbers)) / expected)


def independent(a: np.ndarray, b: np.ndarray, *, pairs: int | None = None, level: float = LEVEL) -> Finding:
    """Judge the correlation of two arrays of one shape and mean zero; `pairs`: how many are independent, else all."""
    value, count = correlation(a, b), a.size if pairs is None else pairs
    p = float(2 * special.ndtr(-abs(value) * np.sqrt(count)))
    return Finding("independent", value, 0.0, p > level, f"{count:,} pairs correlate by {value:.3g}, p = {p:.2g}", p=p)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two arrays whose mean is zero: Σ a b / √(Σ a² Σ b²)."""
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum()))
