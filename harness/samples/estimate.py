"""The batch, the harness's atom, and the estimate that batches merge into. Knows nothing of renderers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from harness.samples.cost import Cost

# Rec.709 luminance weights (ITU-R BT.709-6, section 3), for linear RGB.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Rec.709 luminance of linear RGB, (..., 3) -> (...), float64."""
    return np.asarray(rgb, dtype=np.float64) @ LUMINANCE


def pixel_mean(image: np.ndarray) -> np.ndarray:
    """The mean over all pixels of an image (H, W, C) float64, (C,): that of `image.mean((0, 1))` in a quarter of the
    time."""
    return np.asarray(np.einsum("ijk->k", image) / (image.shape[0] * image.shape[1]))


@dataclass(frozen=True, eq=False)
class Batch:
    """What one renderer produced for one contiguous range of samples of one replica: immutable, merged by addition.

    `mean` is (H, W, 3) float32, linear Rec.709 radiance, row 0 at the top; `samples` is per pixel. The sum of
    radiance is `mean * samples` in float64: rounding one batch's mean to float32 moves it by at most 6e-8 relative,
    far below the noise of any batch, and a batch read back from disk equals the batch that was rendered.
    `rejected` counts samples over the whole image that were not finite and so left out of the mean.
    `cost`: what it took, and on which device. `largest`: (H, W, 3) float32, of each pixel and channel the largest of
    its single samples; None where the renderer does not keep it.
    """

    mean: np.ndarray
    samples: int
    rejected: int = 0
    cost: Cost = field(default_factory=Cost.unknown)
    largest: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """Batches merged in float64: the mean, and the variance of that mean by batch means.

    `mean`, `variance`: (H, W, 3); `luminance_variance`: (H, W); variances are of the mean, not of one sample.
    `image_mean`, `image_variance`: (4,), the mean over all pixels of red, green, blue, luminance, and the variance
    of those four by batch means, which assumes nothing about correlation between pixels.
    Variances are NaN with fewer than two batches, and zero for an exact answer (`batches` = 0). `third`: (H, W, 3), the
    third central moment of the mean; `image_third`: (4,), those of `image_mean`. None where they are not known, as of
    fewer than three batches.
    """

    mean: np.ndarray
    variance: np.ndarray
    luminance_variance: np.ndarray
    image_mean: np.ndarray
    image_variance: np.ndarray
    samples: int
    batches: int
    rejected: int = 0
    cost: Cost = field(default_factory=Cost.unknown)
    third: np.ndarray | None = None
    image_third: np.ndarray | None = None

    @classmethod
    def exact(cls, mean: np.ndarray) -> Estimate:
        """A closed-form image (H, W, 3) as an estimate without variance."""
        mean = np.asarray(mean, dtype=np.float64)
        return cls(mean, np.zeros_like(mean), np.zeros(mean.shape[:2]), with_luminance(mean).mean((0, 1)),
                   np.zeros(4), samples=0, batches=0)


# Pixels that are merged at a time: what is computed on the way then stays in the processor's nearer memory, in a third
# of the time of whole images.
BLOCK = 4096


class Accumulator:
    """Merges batches one at a time without keeping them.

    Weighted Welford update (West 1979, CACM 22(9), doi:10.1145/359146.359153) with samples as weights. For a batch
    of n samples the batch mean has variance σ²/n, so Σ n (m - m̄)² / (B - 1) estimates σ² without bias even when
    batches differ in size, and the mean of all N samples has variance σ²/N.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.batches = 0
        self.rejected = 0
        self._cost: Cost | None = None
        # Planes, which take half the time of pixels: (4, H, W), red, green, blue, luminance; the last without it.
        self._mean = self._m2 = self._m3 = np.zeros(())
        self._image_m2 = np.zeros(4)
        self._image_m3 = np.zeros(4)

    def add(self, batch: Batch) -> None:
        """Merge one batch; ValueError when it holds no samples or its image size is not that of those before it."""
        if batch.samples < 1:
            raise ValueError(f"expected at least 1 sample, found {batch.samples}")
        shape = (4, *batch.mean.shape[:2])
        if self.batches == 0:
            self._mean, self._m2, self._m3 = np.zeros(shape), np.zeros(shape), np.zeros((3, *shape[1:]))
        elif shape != self._mean.shape:  # numpy would stretch an image one pixel high or wide
            raise ValueError(f"expected an image of shape {self.mean.shape}, found {batch.mean.shape}")
        self.samples += batch.samples
        self.batches += 1
        self.rejected += batch.rejected
        self._cost = batch.cost if self._cost is None else self._cost + batch.cost
        held, share = self.samples - batch.samples, batch.samples / self.samples
        image, moved = np.zeros(4), np.zeros(4)
        step = max(1, BLOCK // shape[2])
        for first in range(0, shape[1], step):
            before, after = self._add_rows(slice(first, first + step), batch, held, share)
            image += before
            moved += after
        image /= shape[1] * shape[2]
        moved /= shape[1] * shape[2]
        self._image_m3 += image * share * (image**2 * held * (1 - 2 * share) - 3 * self._image_m2)
        self._image_m2 += batch.samples * image * moved

    def _add_rows(self, rows: slice, batch: Batch, held: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Merge some rows; the sums, of each plane, of how far the batch is from the mean before and after."""
        pixels = batch.mean[rows]
        mean, m2, m3 = self._mean[:, rows], self._m2[:, rows], self._m3[:, rows]
        value = np.empty_like(mean)
        value[:3] = np.moveaxis(pixels, -1, 0)
        value[3] = luminance(pixels)
        before = value - mean
        third = before[:3]**2
        third *= held * (1 - 2 * share)
        third -= 3 * m2[:3]
        third *= before[:3] * share
        m3 += third
        mean += before * share
        value -= mean
        sums = before.sum((1, 2)), value.sum((1, 2))
        before *= batch.samples
        before *= value
        m2 += before
        return sums

    @property
    def mean(self) -> np.ndarray:
        """The mean so far, (H, W, 3) float64."""
        return _pixels(self._mean[:3])

    def estimate(self) -> Estimate:
        """The merged estimate of everything added so far; ValueError when nothing was."""
        if self.batches == 0:
            raise ValueError("no batch to estimate from")
        scale = 1.0 / ((self.batches - 1) * self.samples) if self.batches > 1 else np.nan
        variance = _pixels(self._m2 * scale)
        third = image_third = None
        if self.batches > 2:
            cubes = 1.0 / (self.samples * (self.batches - 1) * (self.batches - 2))
            third, image_third = _pixels(self._m3 * cubes), self._image_m3 * cubes
        return Estimate(self.mean, variance[..., :3], variance[..., 3], self._mean.mean((1, 2)),
                        self._image_m2 * scale, self.samples, self.batches, self.rejected,
                        self._cost or Cost.unknown(), third, image_third)


def _pixels(planes: np.ndarray) -> np.ndarray:
    """(C, H, W) -> (H, W, C), in one piece."""
    return np.ascontiguousarray(np.moveaxis(planes, 0, -1))


class RunningMean:
    """The mean of batches so far, as `Accumulator` has it to the last bit, and nothing else: a quarter of its work."""

    def __init__(self) -> None:
        self.samples = 0
        self.mean = np.zeros(())  # (H, W, 3) float64

    def add(self, batch: Batch) -> None:
        """Merge one batch, of the size of those before it."""
        value = np.asarray(batch.mean, dtype=np.float64)
        if self.samples == 0:
            self.mean = np.zeros_like(value)
        self.samples += batch.samples
        self.mean = self.mean + (value - self.mean) * (batch.samples / self.samples)


def merge(batches: Iterable[Batch]) -> Estimate:
    """Merge batches into one estimate; ValueError when there are none."""
    accumulator = Accumulator()
    for batch in batches:
        accumulator.add(batch)
    return accumulator.estimate()


def with_luminance(rgb: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 4) float64, luminance appended."""
    rgb = np.asarray(rgb, dtype=np.float64)
    return np.concatenate([rgb, luminance(rgb)[..., None]], axis=-1)
