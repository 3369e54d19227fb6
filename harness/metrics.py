"""Image metrics: linear errors against a noisy reference, and display metrics at a fixed exposure."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from harness.errors import HarnessError
from harness.samples.estimate import luminance
from harness.samples.tone import encode_srgb
from harness.stats.bias import error_scale

# Side of SSIM's Gaussian window: sigma 1.5 pixels (Wang et al. 2004) cut at 3.5 sigma.
SSIM_WINDOW = 11
SSIM_SIGMA = 1.5
# FLIP's default viewing distance: 0.7 m from a 3840-pixel, 0.7 m wide monitor (Andersson et al. 2020).
PIXELS_PER_DEGREE = 67.02
# Relative differences are shown against at least this part of the reference's mean luminance, lest black pixels shout.
DARK_PIXEL = 0.01


def mean_error(test: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Signed error of the image means of red, green, blue and luminance, (4,), relative to the reference's.

    A channel that is black in the reference is measured against its mean luminance; see `stats.bias.error_scale`.
    """
    test_means, reference_means = (_image_means(image) for image in _pair(test, reference))
    return (test_means - reference_means) / error_scale(reference_means)


def rmse(test: ArrayLike, reference: ArrayLike, noise: ArrayLike | None = None) -> float:
    """Root of the mean squared error over pixels and channels, in radiance.

    `noise` (H, W, 3): variance of the reference's mean, subtracted from the squared errors, so that the result is the
    error against the truth and not against a noisy witness of it; give the sum of both variances to keep the bias
    alone. What remains may be negative by chance and is then zero. NaN where the noise is NaN (unknown).
    """
    test, reference = _pair(test, reference)
    squares = _less_noise((test - reference)**2, noise)
    return _root(squares.mean())


def relmse(test: ArrayLike, reference: ArrayLike, noise: ArrayLike | None = None, *, epsilon: float = 0.01,
           outliers: float = 0.001) -> float:
    """Relative mean squared error (Rousselle et al. 2011): the mean of (test - reference)² / (reference² + epsilon).

    `epsilon`, in squared radiance, keeps black pixels in the score at a finite weight. The pixels with the largest
    errors, a fraction `outliers` of all (rounded down), are left out, lest a few fireflies be all that is measured.
    `noise` as in `rmse`.
    """
    test, reference = _pair(test, reference)
    errors = (_less_noise((test - reference)**2, noise) / (reference**2 + epsilon)).mean(axis=-1).ravel()
    kept = errors.size - int(outliers * errors.size)
    return max(float(np.partition(errors, kept - 1)[:kept].mean()), 0.0) if not np.isnan(errors).any() else np.nan


def ssim(test: ArrayLike, reference: ArrayLike, exposure: float = 0.0) -> float:
    """Structural similarity (Wang et al. 2004) of the images as displayed: fixed exposure, clipped, sRGB-encoded.

    Gaussian window, data range 1, mean over channels. HarnessError for images smaller than the window, 11 pixels.
    """
    from skimage.metrics import structural_similarity

    test, reference = _pair(test, reference)
    require_ssim_size(*reference.shape[:2])
    # In float32 the score moves by less than 1e-6, and a curve's many points take a fifth less time.
    shown = (encode_srgb(image, exposure).astype(np.float32) for image in (test, reference))
    return float(structural_similarity(  # type: ignore[no-untyped-call]
        *shown, data_range=1.0, channel_axis=-1, gaussian_weights=True, sigma=SSIM_SIGMA,
        use_sample_covariance=False))


def require_ssim_size(height: int, width: int) -> None:
    """HarnessError for images smaller than SSIM's window, 11 pixels; called before a render that would be in vain."""
    if min(height, width) < SSIM_WINDOW:
        raise HarnessError(f"SSIM needs images of at least {SSIM_WINDOW} x {SSIM_WINDOW} pixels, found "
                           f"{width} x {height}; render a larger image")


def flip_map(test: ArrayLike, reference: ArrayLike, exposure: float = 0.0,
             pixels_per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """LDR-FLIP (Andersson et al. 2020) of the images as displayed: perceived difference in [0, 1], (H, W).

    NaN where either image is.
    """
    import flip_evaluator

    test, reference = _pair(test, reference)
    # The evaluator decodes sRGB itself and computes in float32.
    shown = [np.ascontiguousarray(encode_srgb(image, exposure), dtype=np.float32) for image in (reference, test)]
    error, _, _ = flip_evaluator.evaluate(*shown, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False,
                                          parameters={"ppd": pixels_per_degree})
    return np.where(np.isnan(test + reference).any(axis=-1), np.nan, error[..., 0].astype(np.float64))


def flip(test: ArrayLike, reference: ArrayLike, exposure: float = 0.0) -> float:
    """The mean of `flip_map` at the default viewing distance."""
    return float(flip_map(test, reference, exposure).mean())


def delta_e2000(test: ArrayLike, reference: ArrayLike, exposure: float = 0.0) -> float:
    """Mean over pixels of the CIEDE2000 colour difference (CIE 142-2001) of the images as displayed, D65.

    About 1 is just noticeable. By scikit-image; the tests hold it against colour-science, whose import takes
    seconds.
    """
    from skimage.color import deltaE_ciede2000, rgb2lab

    shown = (rgb2lab(encode_srgb(image, exposure)) for image in _pair(test, reference))
    return float(deltaE_ciede2000(*shown).mean())  # type: ignore[no-untyped-call]


def signed_relative_difference(test: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """(test - reference) / reference in luminance, (H, W), positive where the test is too bright: a picture, no score.

    Pixels darker than 1 % of the reference's mean luminance are divided by that instead.
    """
    test_luminance, reference_luminance = (luminance(image) for image in _pair(test, reference))
    floor = DARK_PIXEL * reference_luminance.mean()
    return (test_luminance - reference_luminance) / np.maximum(reference_luminance, floor if floor > 0 else 1.0)


def _pair(test: ArrayLike, reference: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Both images as float64; HarnessError unless they are (H, W, 3) of one size."""
    images = np.asarray(test, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    for name, image in zip(("test", "reference"), images, strict=True):
        if image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise HarnessError(f"the {name} image must have shape (height, width, 3), found {image.shape}")
    sizes = [f"{image.shape[1]} x {image.shape[0]}" for image in images]
    if sizes[0] != sizes[1]:
        raise HarnessError(f"images differ in size: test {sizes[0]}, reference {sizes[1]}; render both at one size")
    return images


def _image_means(image: np.ndarray) -> np.ndarray:
    means = image.mean(axis=(0, 1))
    return np.append(means, luminance(means))


def _less_noise(squares: np.ndarray, noise: ArrayLike | None) -> np.ndarray:
    return squares if noise is None else squares - np.asarray(noise, dtype=np.float64)


def _root(mean_square: float) -> float:
    return float(np.sqrt(np.maximum(mean_square, 0.0)))
