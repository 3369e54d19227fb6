"""Does the author's loop average its frames rightly? Its result against the same frames drawn alone, exactly.

Both have the same random numbers, so the result must be a weighted sum of the frames, whose weights a least-squares fit
gives without noise: all alike, and 1 together. What a single frame computes is not judged here.
"""

from __future__ import annotations

import numpy as np

from harness.shader.contract import Law
from harness.strangers.findings import Accumulation
from harness.strangers.single import decoded

# Frames of the loop.
FRAMES = 24
# Part of a frame's fair weight by which it may be off: float32 sums of so many frames are exact to 1e-6.
UNEVEN = 0.02
# What the fit may leave of the result, relative to its size.
RESIDUAL = 1e-3
# Standard errors within which the means must agree where the frames cannot be told apart in the result.
NOISE = 5.0


def radiance_of(pixels: np.ndarray, law: Law, frames: int) -> np.ndarray:
    """What a loop of so many frames left, (H, W, 4), as radiance (H, W, 3): its display pass's division undone."""
    pixels = np.asarray(pixels, dtype=np.float64)
    colour = decoded(pixels[..., :3], law.encoding)
    if law.kind != "sum":
        return colour
    if law.count != "alpha":
        return colour / frames
    counted = pixels[..., 3:]
    return np.divide(colour, counted, out=np.zeros_like(colour), where=counted > 0)


def judge_accumulation(result: np.ndarray, singles: np.ndarray, law: Law) -> Accumulation:
    """The verdict on a loop's `result` (H, W, 3), as radiance, of frames that alone are `singles` (F, H, W, 3)."""
    frames = len(singles)
    if law.kind == "none":
        return Accumulation("none", "frames are not joined: each stands alone", frames, exact=True)
    good = np.isfinite(singles).all(axis=(0, 3)) & np.isfinite(result).all(axis=-1)
    if not good.any():
        return Accumulation("fail", "no pixel is finite in all frames", frames, exact=True)
    each = singles[:, good].reshape(frames, -1).astype(np.float64)
    whole = result[good].reshape(-1)
    mean = each.mean(axis=0)
    size = float(np.sqrt((mean**2).mean())) or 1.0
    factor = float(whole.mean() / mean.mean()) if mean.mean() else 1.0
    if float(np.sqrt(((whole - mean)**2).mean())) < RESIDUAL * size:
        return Accumulation("pass", f"the loop's result is the mean of its {frames} frames, exactly", frames, True,
                            np.full(frames, 1 / frames), factor)
    weights, _, rank, _ = np.linalg.lstsq(each.T, whole, rcond=1e-6)
    residual = float(np.sqrt(((whole - each.T @ weights)**2).mean())) / size
    if rank == frames and residual < RESIDUAL:
        return _of_weights(weights, factor)
    # What the past held before the first frame, perhaps: the same in all pixels.
    more = np.concatenate([each, np.ones((1, each.shape[1]))])
    weights, _, rank, _ = np.linalg.lstsq(more.T, whole, rcond=1e-6)
    if rank == frames + 1 and float(np.sqrt(((whole - more.T @ weights)**2).mean())) < RESIDUAL * size:
        return Accumulation("fail", f"{weights[-1]:+.3g} is in the result besides its {frames} frames: the past that "
                            "the first frame begins from is not empty", frames, True, weights[:-1], factor)
    return _of_noise(whole, each, factor, residual)


def _of_weights(weights: np.ndarray, factor: float) -> Accumulation:
    """From the weights of all frames."""
    frames = len(weights)
    fair = weights * frames
    total = float(weights.sum())
    thrown = int(np.argmax(np.abs(fair) > UNEVEN))
    kept = weights[thrown:]
    even = bool((np.abs(kept / kept.mean() - 1) < UNEVEN).all())
    if even and abs(total - 1) < RESIDUAL and thrown <= frames // 2:
        which = "its first frame" if thrown == 1 else f"its first {thrown} frames"
        return Accumulation("pass", f"the loop throws {which} away, and averages the rest exactly", frames, True,
                            weights, factor)
    if even and 0 < thrown <= frames // 2:
        told = (f"the loop throws its first {thrown} frame{'s' * (thrown > 1)} away but counts them: what is left "
                f"counts {total:.4g} together instead of 1")
    elif even and thrown == 0:
        told = (f"all frames count alike, but {total:.4g} together instead of 1: it is divided by another number of "
                "frames")
    elif abs(weights[-1]) > 0.95 and np.abs(weights[:-1]).max() < 0.05:
        told = "only the last frame is left: the past is lost"
    elif _fades(weights):
        effective = float(weights.sum()**2 / (weights**2).sum())
        told = f"old frames fade, so it never converges: it keeps the noise of about {effective:.3g} frames"
    else:
        worst = int(np.argmax(np.abs(fair - np.median(fair))))
        told = (f"frame {worst} counts {fair[worst] / float(np.median(fair)):.3g} times as much as the others, all "
                f"together {total:.4g} instead of 1")
    return Accumulation("fail", told, frames, True, weights, factor)


def _fades(weights: np.ndarray) -> bool:
    """Whether each frame counts the same part of the next."""
    if not (np.abs(weights) > 0).all() or len(weights) < 4:
        return False
    ratios = weights[1:-1] / weights[2:]
    return bool(np.ptp(ratios) < UNEVEN and ratios.max() < 1 - UNEVEN)


def _of_noise(whole: np.ndarray, each: np.ndarray, factor: float, residual: float) -> Accumulation:
    """From the means alone, where the result is no weighted sum of the frames: other random numbers in it, perhaps."""
    frames = len(each)
    means = each.mean(axis=1)
    error = float(means.std(ddof=1) / np.sqrt(frames)) * np.sqrt(2)
    scatter = float(each.std(axis=0).mean()) / np.sqrt(frames * each.shape[1])
    away = abs(float(whole.mean() - means.mean()))
    told = f"the loop's mean is {factor:.4g} times that of its frames"
    if away < NOISE * max(error, scatter):
        return Accumulation("pass", f"{told}, within the noise; its frames draw other numbers alone than in the loop",
                            frames, False, None, factor)
    return Accumulation("fail", f"{told}, and it is no weighted mean of them ({residual:.1%} is left): something else "
                        "is done to what is kept", frames, False, None, factor)
