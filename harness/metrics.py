"""Image metrics: linear errors against a noisy reference, and display metrics at a fixed exposure.

To add one: a function here, and an entry of `METRICS` below it, which comparisons, studies, their files and tables, and
the report walk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from harness.errors import HarnessError
from harness.samples.estimate import Estimate, luminance, pixel_mean
from harness.samples.spent import spent
from harness.samples.tone import encode_srgb
from harness.stats.bias import error_scale
from harness.stats.channels import Channel

# Side of SSIM's Gaussian window: sigma 1.5 pixels (Wang et al. 2004) cut at 3.5 sigma.
SSIM_WINDOW = 11
SSIM_SIGMA = 1.5
SSIM_TRUNCATE = 3.5
# The constants that keep its fractions finite (ibid., section III.B).
SSIM_K1, SSIM_K2 = 0.01, 0.03
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
    test, reference = _pair(test, reference)
    require_ssim_size(*reference.shape[:2])
    return _SsimReference.last(reference, exposure).of(test)


class _SsimReference:
    """What SSIM needs of the reference alone, two of its five filters: the points of a study's curves share it.

    The steps and their order are those of `skimage.metrics.structural_similarity` (with gaussian_weights, sigma 1.5,
    data range 1, and use_sample_covariance off), so that the scores are the same bit for bit. In float32 a score moves
    by less than 1e-6, and takes a fifth less time.
    """

    _kept: _SsimReference | None = None

    def __init__(self, reference: np.ndarray, exposure: float) -> None:
        self.reference, self.exposure = reference.copy(), exposure
        self.shown = _shown(reference, exposure)
        self.mean = [_blurred(channel) for channel in self.shown]
        self.variance = [_blurred(channel * channel) - mean * mean
                         for channel, mean in zip(self.shown, self.mean, strict=True)]

    @classmethod
    def last(cls, reference: np.ndarray, exposure: float) -> _SsimReference:
        """That of the last call, where it was for the same numbers."""
        kept = cls._kept
        if kept is None or kept.exposure != exposure or not np.array_equal(kept.reference, reference):
            kept = cls._kept = cls(reference, exposure)
        return kept

    def of(self, test: np.ndarray) -> float:
        """The score of an image."""
        c1, c2 = SSIM_K1**2, SSIM_K2**2
        pad = SSIM_WINDOW // 2
        scores = np.empty(3, dtype=np.float32)
        for index, x in enumerate(_shown(test, self.exposure)):
            y, uy, vy = self.shown[index], self.mean[index], self.variance[index]
            ux = _blurred(x)
            vx = _blurred(x * x) - ux * ux
            vxy = _blurred(x * y) - ux * uy
            a1, a2, b1, b2 = 2 * ux * uy + c1, 2 * vxy + c2, ux**2 + uy**2 + c1, vx + vy + c2
            similarity = (a1 * a2) / (b1 * b2)
            scores[index] = similarity[pad:-pad, pad:-pad].mean(dtype=np.float64)
        return float(scores.mean())


def _shown(image: np.ndarray, exposure: float) -> list[np.ndarray]:
    """Red, green and blue as displayed, each (H, W) float32."""
    shown = encode_srgb(image, exposure).astype(np.float32)
    return [np.ascontiguousarray(shown[..., channel]) for channel in range(3)]


def _blurred(channel: np.ndarray) -> np.ndarray:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(channel, SSIM_SIGMA, mode="reflect", truncate=SSIM_TRUNCATE))


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


# Image under test and reference (H, W, 3), the variance of the reference's mean (H, W, 3) or None, exposure in stops.
Measure = Callable[[np.ndarray, np.ndarray, np.ndarray | None, float], float]
Place = Literal["compare", "study", "report"]


@dataclass(frozen=True)
class Metric:
    """One number that tells how far an image is from its reference, and what its readers need to show it.

    `name`: in JSON and CSV. `heading`: of its column. `sentence`: what it is, in one line without a full stop; the
    report's list of terms adds the `explanation`, whole sentences, and which way is `better`. `unit`: empty for pure
    numbers. `decimals` in tables; None: three significant digits. `channel`: the one that it looks at, empty for all
    three colours. `at_prefixes`: studies measure it along each replica's curve, otherwise once, of all replicas merged.
    `shown`: whose tables have it; JSON and CSV always do.
    """

    name: str
    measure: Measure
    heading: str
    sentence: str
    better: Literal["lower", "higher", "nearer to zero"] = "lower"
    explanation: str = ""
    unit: str = ""
    decimals: int | None = None
    channel: str = ""
    at_prefixes: bool = False
    shown: tuple[Place, ...] = ("compare", "study", "report")

    def text(self, value: float) -> str:
        """The value as a table on a terminal shows it."""
        return f"{value:.3g}" if self.decimals is None else f"{value:.{self.decimals}f}"


METRICS: tuple[Metric, ...] = (
    Metric("rmse", lambda test, reference, noise, exposure: rmse(test, reference, noise), "RMSE",
           "root of the mean squared error, reference noise taken off", unit="radiance", at_prefixes=True,
           shown=("compare", "study")),  # the report draws it
    Metric("relmse", lambda test, reference, noise, exposure: relmse(test, reference, noise), "relMSE",
           "mean squared error relative to the reference, worst 0.1 % left out", shown=("compare",)),
    Metric("mean_error", lambda test, reference, noise, exposure: float(mean_error(test, reference)[Channel.LUMINANCE]),
           "mean error", "signed error of the image's mean luminance, relative to the reference's",
           better="nearer to zero", channel="luminance", at_prefixes=True,
           shown=()),  # verdicts tell it, with its interval
    Metric("ssim", lambda test, reference, noise, exposure: ssim(test, reference, exposure), "SSIM",
           "structural similarity on sRGB-encoded images; 1 is identical", better="higher", decimals=4,
           at_prefixes=True),
    Metric("flip", lambda test, reference, noise, exposure: flip(test, reference, exposure), "FLIP",
           "mean FLIP error on sRGB-encoded images; 0 is identical", decimals=4, shown=("compare", "report"),
           explanation="It estimates the difference that a viewer notices when the two images alternate on a screen, "
                       "0 to 1 for each pixel."),
    Metric("delta_e2000", lambda test, reference, noise, exposure: delta_e2000(test, reference, exposure), "ΔE",
           "mean colour difference; 1 is about just noticeable", decimals=3, shown=("compare", "report"),
           explanation="By the formula of CIE 2000, on sRGB-encoded images, side by side."),
)


@spent("metrics")
def measure(test: np.ndarray, reference: Estimate, exposure: float, *, at_prefixes: bool | None = None,
            ) -> dict[str, float]:
    """All metrics of an image (H, W, 3) by name; those that are measured along curves, or the others, where asked.

    Where the reference's variance is not known (files of other renderers) its noise stays in. Raises as they do.
    """
    noise = None if np.isnan(reference.variance).any() else reference.variance
    return {metric.name: metric.measure(test, reference.mean, noise, exposure) for metric in METRICS
            if at_prefixes in (None, metric.at_prefixes)}


def shown_in(place: Place) -> tuple[Metric, ...]:
    """The metrics that the tables of a command or of the report show, in their order."""
    return tuple(metric for metric in METRICS if place in metric.shown)


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
    means = pixel_mean(image)
    return np.append(means, luminance(means))


def _less_noise(squares: np.ndarray, noise: ArrayLike | None) -> np.ndarray:
    return squares if noise is None else squares - np.asarray(noise, dtype=np.float64)


def _root(mean_square: float) -> float:
    return float(np.sqrt(np.maximum(mean_square, 0.0)))
