"""How surprising is a difference of means? Student's answer and Hall's for skewed batches, the milder of the two."""

from __future__ import annotations

import numpy as np
from scipy import special

# The |z| beyond which a normal tail probability is no longer representable; z-maps saturate there.
Z_LIMIT = 37.0


def skew_deviate(difference: np.ndarray, variance: np.ndarray, third: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """The difference over its standard error as a normal deviate, within ±`Z_LIMIT`; arrays of one shape.

    `variance`, `third`: second and third central moments *of the difference*. Student's t misleads where the batches
    are skewed, since mean and variance then err together: too few bright samples make a mean too low and too sure.
    Hall's transformation (1992, "On the removal of skewness by transformation", J. R. Statist. Soc. B 54, 221-228),
    t + g t²/3 + g² t³/27 + g/6 with g = third / variance^(3/2), takes that out to first order, and makes the tail on
    the other side longer. The deviate nearer to zero of the two is returned: neither tail then alarms more often than
    stated, which costs power only where the skewness is large. NaN where the variance is.
    """
    return _normal(skew_student(difference, variance, third), dof)


def skew_student(difference: np.ndarray, variance: np.ndarray, third: np.ndarray) -> np.ndarray:
    """The value whose normal deviate `skew_deviate` returns: Student's t, or Hall's where that is nearer to zero."""
    t, g = _studentized(difference, variance, third)
    transformed = t + g * t**2 / 3 + g**2 * t**3 / 27 + g / 6
    return _nearer_zero(t, transformed)


def largest_deviate(t: np.ndarray, dof: np.ndarray) -> float:
    """The largest of Student's t as normal deviates; at most 0 where none is above, and NaN counts as none.

    A positive t exceeds its deviate, so few can be the largest: only for those the tail probability is computed, which
    costs more than all the rest of a verdict.
    """
    t = np.nan_to_num(t, nan=-np.inf)
    first = np.unravel_index(int(np.argmax(t)), t.shape)
    if not t[first] > 0:
        return 0.0
    candidates = t >= _normal(t[first], dof[first])
    return float(_normal(t[candidates], dof[candidates]).max())


def all_exceed(t: np.ndarray, dof: np.ndarray, deviate: float) -> bool:
    """Is every Student's t, as a normal deviate, at least `deviate`, which is positive? False where one is NaN.

    What lies above the bound for the fewest degrees of freedom does; in detail only what lies between is looked at.
    """
    if not (t >= deviate).all():
        return False
    between = t < special.stdtrit(float(dof.min()), special.ndtr(deviate))
    return bool((_normal(t[between], dof[between]) >= deviate).all())


def skew_interval(difference: np.ndarray, variance: np.ndarray, third: np.ndarray, dof: np.ndarray,
                  alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """The interval at confidence 1 - `alpha` of those differences that `skew_deviate` does not reject."""
    sigma = np.sqrt(variance)
    _, g = _studentized(difference, variance, third)
    bound = special.stdtrit(dof, 1 - alpha / 2)
    return (difference - sigma * np.maximum(bound, _inverse_hall(bound, g)),
            difference + sigma * np.maximum(bound, -_inverse_hall(-bound, g)))


def half_width(sigma: np.ndarray, dof: np.ndarray, alpha: float) -> np.ndarray:
    """Half the two-sided Student interval at confidence 1 - `alpha` about a value with standard error `sigma`."""
    return sigma * special.stdtrit(dof, 1 - alpha / 2)


def satterthwaite(variance: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Degrees of freedom of a sum of variances (Satterthwaite 1946), given Σ variance² / dof; infinite if exact."""
    with np.errstate(invalid="ignore"):
        return np.where(squares == 0, np.inf, variance**2 / np.where(squares == 0, 1.0, squares))


def staged(looked: float, dof: float) -> float:
    """Degrees of freedom for an interval whose `dof` were drawn because the first `looked` of them asked for it.

    Where it is the variance that decides how much is drawn, runs stop on one that is too small by chance, and Student's
    interval of all that was drawn is too short. Stein (1945) takes the variance of the first stage, whose own degrees
    of freedom are exact; a variance of all is better where tails are heavy, and lies between. So does its interval: a
    quantile exceeds the normal one by a term in 1/ν, and the mean of both 1/ν is taken, their harmonic mean. Simulated:
    40,000 runs of 8 and of 16 normal batches that grew to up to 12 times as many, by 1 and by 3 stages, with
    `skew_interval`. A nominal 5 % missed in 3.5 to 5.1 %, 1 % in 0.4 to 1.0 %; with all degrees of freedom and
    Student's interval in up to 7.0 % and 1.7 %.
    """
    return 2 / (1 / looked + 1 / dof) if looked > 0 and dof > 0 else min(looked, dof)


def one_sided(z: float) -> float:
    """The probability that a normal deviate exceeds z."""
    return float(special.ndtr(-z))


def critical_deviate(level: float) -> float:
    """The normal deviate that is exceeded, on one side, with probability `level`."""
    return float(-special.ndtri(level))


def _studentized(difference: np.ndarray, variance: np.ndarray, third: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The statistic t, bounded so that its cube is finite, and the skewness of the difference."""
    sigma = np.sqrt(variance)
    known = sigma > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = np.where(sigma == 0, np.sign(difference) * _HUGE, np.clip(difference / sigma, -_HUGE, _HUGE))
        g = np.divide(third, sigma**3, out=np.zeros_like(sigma), where=known & (sigma**3 > 0))
    return t, g


def _inverse_hall(value: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The t that Hall's transformation takes to `value`; the cubic is monotone, so there is one."""
    small = np.abs(g) < _LINEAR
    steep = np.where(small, 1.0, g)
    return np.where(small, value, 3 / steep * (np.cbrt(1 + steep * (value - steep / 6)) - 1))


def _normal(t: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Student's t as the normal deviate with the same tail probability, within ±`Z_LIMIT`."""
    z = special.ndtri(special.stdtr(dof, -np.abs(t)))  # of the lower tail, where the upper one would round to one
    return np.where(np.isnan(t), np.nan, np.copysign(np.minimum(-z, Z_LIMIT), t))


def _nearer_zero(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where(np.abs(b) < np.abs(a), b, a)


_HUGE = 1e60  # a t beyond any table, with a cube that is still a number
_LINEAR = 1e-6  # below this skewness the transformation is the identity to all digits
