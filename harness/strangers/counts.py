"""Samples a frame varied: one, four, sixteen or sixty-four of them must give one mean, and less noise.

Whatever is done to a frame before it is averaged, and is not linear (a clamp, an encoding, a tone curve), gives another
mean with every number of samples; random numbers that the samples of a frame share leave its noise as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.samples.estimate import luminance
from harness.shader.contract import Contract
from harness.shader.hosts.written import sample_counts
from harness.strangers.law import radiance_pass
from harness.strangers.lines import places, with_text

# Samples a frame that are tried besides the author's, and frames of each.
COUNTS, FRAMES = (1, 4, 16, 64), 48
# Means differ from this many standard errors on, and this part of the mean.
CERTAIN, MATTERS = 6.0, 0.01
# So much of what so many samples should be worth, in noise, they must be.
WORTH = 0.5
# A pixel whose noise is less than this part of its mean tells nothing, and so many it takes.
CONSTANT, LEAST_PIXELS = 1e-3, 16


@dataclass(frozen=True)
class Varied:
    """A contract with another number of samples a frame; `where`: 'file:line' of the number."""

    contract: Contract
    samples: int
    where: str


def varied(contract: Contract) -> list[Varied]:
    """The contract with each of COUNTS samples a frame, where its text says the number in one place; else nothing."""
    source = radiance_pass(contract).source
    found = sample_counts(source.text)
    if len(found) != 1:
        return []
    start, end, own = found[0]
    where = places(source)[source.text.count("\n", 0, start)]
    return [Varied(with_text(contract, f"{source.text[:start]}{count}{source.text[end:]}"), count, where)
            for count in sorted({*COUNTS, own})] if where else []


@dataclass(frozen=True)
class CountsRead:
    """What stacks of frames with so many samples each say. `means`: of each; `linear`: they agree, or are as the number
    of samples: a frame that is the sum of its samples. `worth`: of the largest number, in samples of one by one."""

    samples: tuple[int, ...]
    means: tuple[float, ...]
    linear: bool
    summed: bool
    worth: float

    @property
    def told(self) -> str:
        """The means in words."""
        return ", ".join(f"{mean:.4g} with {count}" for count, mean in zip(self.samples, self.means, strict=True))


def read_counts(samples: Sequence[int], stacks: Sequence[np.ndarray]) -> CountsRead:
    """From samples of single frames, (F, H, W, 3) for each number of samples a frame."""
    images = [np.nan_to_num(luminance(stack)).mean(axis=(1, 2)) for stack in stacks]
    means = [float(image.mean()) for image in images]
    errors = [float(image.std(ddof=1) / np.sqrt(len(image))) for image in images]
    summed = _agree([mean / count for mean, count in zip(means, samples, strict=True)],
                    [error / count for error, count in zip(errors, samples, strict=True)])
    linear = _agree(means, errors)
    return CountsRead(tuple(samples), tuple(means), linear or summed, summed and not linear,
                      _worth(samples, stacks, summed=summed and not linear))


def _agree(means: Sequence[float], errors: Sequence[float]) -> bool:
    """Whether all are one: the largest difference against its own error, and against the mean."""
    size = max(abs(mean) for mean in means)
    pairs = [(abs(a - b), np.hypot(e, f)) for a, e in zip(means, errors, strict=True)
             for b, f in zip(means, errors, strict=True)]
    return all(away <= max(CERTAIN * error, MATTERS * size) for away, error in pairs)


def _worth(samples: Sequence[int], stacks: Sequence[np.ndarray], *, summed: bool) -> float:
    """How many times less the noise's variance is with the most samples than with the fewest, times those: the median
    over pixels, since rare bright samples upset means of squares. NaN where few pixels have noise."""
    few, most = (np.nan_to_num(luminance(stack)) for stack in (stacks[0], stacks[-1]))
    if summed:
        few, most = few / samples[0], most / samples[-1]
    noisy = (few.std(axis=0) > CONSTANT * np.abs(few.mean(axis=0))) & (most.std(axis=0) > 0)
    if noisy.sum() < LEAST_PIXELS:
        return float("nan")
    return samples[0] * float(np.median(few.var(axis=0)[noisy] / most.var(axis=0)[noisy]))
