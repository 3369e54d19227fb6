"""Random numbers that repeat, found by the structure of the noise alone: between frames, between pixels. Arrays only.

Values are clipped at each pixel's 95 % quantile: rare bright samples would hide what all others show. What is told is
both large and certain: a correlation's certainty comes from its scatter from frame to frame, whatever joins the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

QUANTILE = 0.95
# A pixel whose noise is less than this part of its mean is taken for constant: rounding is no noise.
CONSTANT = 1e-3
# Values that are the same but for rounding; and by what part of the mean noise differs from its neighbours.
ROUNDING, ROUGH = 1e-4, 0.02
# A correlation that is told: so many standard errors, and so large. Calibrated in tests/strangers/test_seeds.py: of
# right shaders the largest of some hundred lags and a thousand offsets reaches 5 standard errors.
CERTAIN, LAG, NEIGHBOUR = 8.0, 0.004, 0.02
# Pixels with as much of their noise in common, or more, are a fault. Each pixel's own mean is right whoever else has
# its numbers: sequences that pixels share, each begun at a place of its own, have a tenth in common at some offset.
SHARED = 0.25
# Frames whose means scatter by less than this part of what independent ones would are spread on purpose.
SPREAD = 0.8
# Two pixels with as much of their noise in common have the same numbers.
SAME = 0.9
# Frames that it takes for correlations between frames to mean anything.
LEAST_FRAMES = 32
# Noisy pixels that it takes for anything.
LEAST_PIXELS = 16
# Pairs of pixels are compared among so many at the most.
MOST_PIXELS = 1024
# What two pixels' noise must exceed by chance alone never: standard deviations of a correlation.
CHANCE = 8.0


@dataclass(frozen=True)
class Repeat:
    """Random numbers that repeat. `kind`: frames_equal, period, lag, neighbours or pixels. `told`: how. `size`: the
    correlation; `certain`: its standard errors. `harmless`: means of pixels are as good as those of independent
    numbers, or better."""

    kind: str
    told: str
    size: float
    certain: float
    harmless: bool = False


def find_repeats(frames: np.ndarray) -> list[Repeat]:
    """What repeats in the samples of consecutive frames, (F, H, W), luminance."""
    frames = np.asarray(frames, dtype=np.float64)
    count = len(frames)
    if count < 2:
        return []
    equal = _equal(frames)
    if equal:
        return [equal]
    noise, noisy = standardised(frames)
    if noisy.sum() < LEAST_PIXELS or count < LEAST_FRAMES:
        return []
    return [found for found in (_lag(noise[:, noisy]), _offset(noise, noisy), _pairs(noise[:, noisy])) if found]


def standardised(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The noise of each pixel, clipped, with mean 0 and variance 1, (F, H, W), and which pixels have any, (H, W)."""
    finite = np.isfinite(frames).all(axis=0)
    values = np.where(finite, frames, 0.0)
    values = np.minimum(values, np.quantile(values, QUANTILE, axis=0))
    mean, sigma = values.mean(axis=0), values.std(axis=0)
    noisy = finite & (sigma > CONSTANT * np.abs(mean)) & (sigma > 0)
    noise = np.divide(values - mean, sigma, out=np.zeros_like(values), where=noisy)
    return noise * noisy, noisy


def _equal(frames: np.ndarray) -> Repeat | None:
    """Frames that are the same, but for the rounding of what undid a weight."""
    values = np.nan_to_num(frames)
    size = np.abs(values).max(axis=0) + 1e-30
    if (np.ptp(values, axis=0) <= ROUNDING * size).all():
        if not _rough(values[0]):
            return None
        return Repeat("frames_equal", "every frame is the same, noise and all: however many are averaged, they are one",
                      1.0, np.inf)
    for start in {0, 1, len(values) // 2}:
        away = (np.abs(values - values[start]) <= ROUNDING * size).all(axis=(1, 2))
        away[start] = False
        if away.any():
            apart = abs(int(np.argmax(away)) - start)
            return Repeat("period", f"frames {apart} apart are the same: the random numbers start anew", 1.0, np.inf)
    return None


def _rough(image: np.ndarray) -> bool:
    """Whether an image looks like noise: many pixels are far from what their neighbours say, or some very far."""
    if min(image.shape) < 3:
        return False
    around = (image[1:-1, :-2] + image[1:-1, 2:] + image[:-2, 1:-1] + image[2:, 1:-1]) / 4
    away = np.abs(image[1:-1, 1:-1] - around)
    size = np.abs(image).mean()
    return bool((away > ROUGH * size).mean() > 0.25 or away.mean() > 0.25 * size)


def _lag(noise: np.ndarray) -> Repeat | None:
    """The lag at which frames have most in common, (F, P). Taking off each pixel's mean makes frames differ by
    1 / (F - 1), which is added."""
    count = len(noise)
    best: tuple[float, float, int] = (0.0, 0.0, 0)
    for lag in range(1, count // 2 + 1):
        each = (noise[lag:] * noise[:-lag]).mean(axis=1) + 1 / (count - 1)
        error = _error(each, lag)
        size = float(each.mean())
        if error > 0 and size > LAG and size / error > best[1]:
            best = size, size / error, lag
    size, certain, lag = best
    if certain < CERTAIN:
        return None
    told = f"the noise of frames {lag} apart correlates ({size:+.3f}, {certain:.0f} standard errors)"
    if (scatter := _scatter(noise)) < SPREAD:
        return Repeat("lag", f"{told}, but means of frames have {scatter:.2g} times the variance that independent ones "
                      "would: a sequence that is spread evenly", size, certain, harmless=True)
    return Repeat("lag", f"{told}: their random numbers overlap", size, certain)


def _scatter(noise: np.ndarray) -> float:
    """The variance of the mean of half of the frames, (F, P), over what it were if they were independent; at no lag of
    `_lag` can they overlap without adding to it."""
    half = len(noise) // 2
    apart = noise[:half].mean(axis=0) - noise[-half:].mean(axis=0)
    return float((apart**2).mean() * half / 2)


def _error(each: np.ndarray, lag: int) -> float:
    """The standard error of a mean over frames whose products at a lag share a frame with those a lag on."""
    away = each - each.mean()
    variance = float((away**2).mean()) + 2 * max(float((away[lag:] * away[:-lag]).sum()) / len(away), 0.0)
    return float(np.sqrt(variance / len(each)))


def _offset(noise: np.ndarray, noisy: np.ndarray) -> Repeat | None:
    """The offset in the image at which pixels of one frame have most in common."""
    count, height, width = noise.shape
    padded = (2 * height, 2 * width)
    spectrum = np.fft.rfft2(noise, padded)
    products = np.fft.irfft2((spectrum * spectrum.conj()), padded)
    mask = np.fft.rfft2(noisy.astype(np.float64), padded)
    pairs = np.fft.irfft2(mask * mask.conj(), padded)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = products / pairs
        size = each.mean(axis=0)
        certain = size / (each.std(axis=0) / np.sqrt(count))
    bad = (pairs < max(LEAST_PIXELS, noisy.sum() / 8)) | ~np.isfinite(certain) | (size < NEIGHBOUR)
    certain[bad] = 0.0
    certain[0, 0] = 0.0
    y, x = (int(v) for v in np.unravel_index(int(np.argmax(certain)), certain.shape))
    if certain[y, x] < CERTAIN:
        return None
    dy, dx = (y + height) % (2 * height) - height, (x + width) % (2 * width) - width
    found = float(size[y, x])
    return Repeat("neighbours", f"the noise of pixels ({abs(dx)}, {abs(dy)}) apart correlates ({found:+.2f}, "
                  f"{certain[y, x]:.0f} standard errors): they share random numbers", found, float(certain[y, x]),
                  harmless=found < SHARED)


def _pairs(noise: np.ndarray) -> Repeat | None:
    """Pixels, wherever they lie, that have the same noise."""
    count = len(noise)
    chosen = noise[:, ::-(-noise.shape[1] // MOST_PIXELS)]
    if SAME * np.sqrt(count) < CHANCE:
        return None
    correlation = chosen.T @ chosen / count
    np.fill_diagonal(correlation, 0.0)
    share = float((correlation.max(axis=1) > SAME).mean())
    if share < 0.1:
        return None
    return Repeat("pixels", f"{share:.0%} of the pixels have the noise of another, though they see something else: the "
                  "seed does not tell them apart", float(correlation.max()), np.inf)
