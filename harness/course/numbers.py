"""Exhibits of numbers: random numbers and noise out of a sine, and the wording about convergence."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness import checks
from harness.api import render_reference
from harness.checks.shader import random_numbers as numbers_of
from harness.course.pictures import HEIGHT, WIDTH, mean_error, percentage
from harness.course.texts import exhibit
from harness.course.variants import NOISE, OURS, RANDOM, Variant
from harness.estimators.tracer import Tracer
from harness.metrics import rmse
from harness.policy import judge
from harness.reference.sine import sine
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.samples.estimate import Accumulator, Estimate, luminance
from harness.samples.store import Store
from harness.scene import Scene, SceneFile, load
from harness.scene.noise import NUMPY, OCTAVE, UINT32, value_noise
from harness.stats.convergence import band
from harness.studies.study import study
from harness.work.batches import batches

BOTH = (("handout", RANDOM), ("ours", OURS))
# Passes from which random numbers are looked at besides the first: the last of the handout's own picture, and what a
# render left running over night gets to.
LATE, LATEST = (20_000, 100_000), 1_000_000
NOISE_SPP = 256
CURVE_SPP, TRUTH_SPP = 2048, 4096
# Of numbers of 24 bits, one in 65,536 is a multiple of 1/256.
TOO_COARSE = 1e-3
# Relative deviation below which a pixel has no noise but that of float32 sums.
ROUNDING = 1e-4
# Textures of two renderers agree to 1e-5 where they share their hash; a hundred times that is another hash.
SAME_TEXTURE = 1e-3


def random_numbers(store: Store | None) -> Exhibit:
    """The seed in a float32, and the generator that is a sine."""
    scene = load(SceneFile.bundled("spheres", (96, 72)))
    truth = OURS.render(scene, "mixture", TRUTH_SPP, store)
    reference = render_reference(scene, 4 * NOISE_SPP, store=store)
    verdicts = [judge(variant.render(scene, "mixture", 2 * NOISE_SPP, store), reference) for _, variant in BOTH]
    curves = [_rmse_curve(variant, scene, truth, store) for _, variant in BOTH]
    noise = [_noise(variant, scene, LATEST, truth) for _, variant in BOTH]
    findings = (*_number_findings(), _correlated(f"noise of x-neighbours, {NOISE_SPP} passes from 1,000,000", noise, 1),
                _correlated("noise of y-neighbours, the same passes", noise, 0),
                mean_error(f"spheres, the first {2 * NOISE_SPP} passes", *verdicts))
    columns, rows = (finding.handout for finding in findings[-3:-1])
    assert isinstance(columns, float) and isinstance(rows, float)
    images = [ExhibitImage(f"{name.capitalize()}, pass 1,000,000", picture, "deviations")
              for (name, _), picture in zip(BOTH, noise, strict=True)]
    return exhibit("sine-random", findings, images,
                   (_value_plot(), _row_plot(), Plot("RMSE (radiance)", "passes", "xy", tuple(curves))),
                   passes=CURVE_SPP, excess=100 * float(curves[0].y[-1] / curves[1].y[-1] - 1), rows=rows,
                   columns=columns, mean=percentage(findings[-1]), picture=percentage(findings[2]) / 100)


def _number_findings() -> tuple[Finding, ...]:
    """What the numbers themselves show, without a scene."""
    first = [numbers_of(variant.probe, 0)[..., :4].ravel() for _, variant in BOTH]
    late = {number: [numbers_of(variant.probe, number)[..., 0] - 0.5 for _, variant in BOTH] for number in LATE}
    few, enough = (checks.distinct(drawn) for drawn in first)
    coarse = [float((drawn * 256 % 1 == 0).mean()) for drawn in first]
    return (Finding("distinct values", f"among {first[0].size:,} numbers of pass 0, as a share of those expected",
                    few.value, enough.value, "share", not few.passed, enough.passed),
            Finding("distinct values", "whole multiples of 1/256 among them; expected 0.0015 %", coarse[0], coarse[1],
                    "share", coarse[0] > TOO_COARSE, coarse[1] < TOO_COARSE),
            *(_correlated(f"rand() in pixels one above the other, pass {number:,}", fields, 0)
              for number, fields in late.items()))


def _correlated(measures: str, fields: Sequence[np.ndarray], axis: int) -> Finding:
    """The correlation of neighbours along an axis of two fields (H, W) of mean zero, the handout's and ours."""
    wrong, right = (checks.independent(np.delete(field, 0, axis), np.delete(field, -1, axis),
                                       pairs=int(np.count_nonzero(fields[0]))) for field in fields)
    return Finding("neighbour correlation", measures, wrong.value, right.value, "number", not wrong.passed,
                   right.passed)


def _rmse_curve(variant: Variant, scene: Scene, truth: Estimate, store: Store | None) -> Series:
    """RMSE of one run at the powers of two up to CURVE_SPP passes, the truth's own noise taken off."""
    total, x, y = Accumulator(), [], []
    with Tracer("mixture", variant.library).open(scene.file) as renderer:
        for batch in batches(renderer, CURVE_SPP, replica=3, store=store):
            total.add(batch)
            if total.samples & (total.samples - 1) == 0:
                x.append(total.samples)
                y.append(rmse(total.mean, truth.mean, noise=truth.variance))
    return Series("ours" if variant is OURS else "handout", variant is OURS, np.array(x), np.array(y))


def _noise(variant: Variant, scene: Scene, start: int, truth: Estimate) -> np.ndarray:
    """Noise of luminance (H, W) of NOISE_SPP passes from `start` on, in standard deviations of each pixel.

    Its mean is taken off; it is 0 where there is nothing but sky.
    """
    with Tracer("mixture", variant.library).open(scene.file) as renderer:
        found = renderer.render_batch(3, start, NOISE_SPP).mean
    mean, deviation = luminance(truth.mean), np.sqrt(truth.luminance_variance * (TRUTH_SPP / NOISE_SPP))
    noisy = deviation > ROUNDING * mean
    standard = np.where(noisy, luminance(found) - mean, 0) / np.where(noisy, deviation, 1)
    return np.where(noisy, standard - standard[noisy].mean(), 0)


def _value_plot() -> Plot:
    """How often the steps of 1/4096 are hit within a 64th of the range at pass 0, per 1000 draws in there."""
    series = []
    for name, variant in BOTH:
        values = numbers_of(variant.probe, 0).ravel()
        inside = values[(values >= 0.5) & (values < 0.5 + 1 / 64)]
        counts = np.bincount(((inside - 0.5) * 4096).astype(int), minlength=64)
        series.append(Series(name, name == "ours", 0.5 + np.arange(64) / 4096, 1000 * counts / len(inside)))
    return Plot("Draws per 1000 in steps of 1/4096", "value of rand()", "", tuple(series))


def _row_plot() -> Plot:
    """Correlation of the first numbers of pixels one above the other against the pass."""
    passes = np.unique(np.geomspace(100, LATEST, 13).astype(int))
    series = []
    for name, variant in BOTH:
        found = [numbers_of(variant.probe, int(number), side=128)[..., 0] - 0.5 for number in passes]
        rows = np.array([checks.correlation(drawn[1:], drawn[:-1]) for drawn in found])
        series.append(Series(name, name == "ours", passes, rows))
    return Plot("Correlation of rand() between rows", "pass", "x", tuple(series))


# The marble of the noise's exhibit: points of a patch of ground this many units wide and this far from the origin along
# x and y, and the fractal noise in it.
PATCH, DISTANCE, POINTS = 2.0, 300.0, 160
FREQUENCY, OCTAVES, LACUNARITY, GAIN, SEED = 4.0, 5, 2.0, 0.5, 0


def sine_noise(store: Store | None) -> Exhibit:
    """A lattice hash out of a sine: another texture in each renderer."""
    x, y = np.meshgrid((np.arange(POINTS) + 0.5) / POINTS * PATCH + DISTANCE, (np.arange(POINTS) + 0.5) / POINTS * PATCH
                       + DISTANCE)
    points = (np.stack([x, y, np.full_like(x, 10.0)], axis=-1).reshape(-1, 3) * FREQUENCY).astype(np.float32)
    fields = {("handout", "GLSL"): _shader_fbm(NOISE, points), ("ours", "GLSL"): _shader_fbm(OURS, points),
              ("handout", "Mitsuba"): _fbm(points, _sine_lattice),
              ("ours", "Mitsuba"): _fbm(points, lambda p, seed: value_noise(NUMPY, tuple(p.T), seed)[0])}
    marble = {key: _marble(points, field) for key, field in fields.items()}
    largest = [float(np.abs(marble[name, "GLSL"] - marble[name, "Mitsuba"]).max()) for name in ("handout", "ours")]
    numbers = np.unique(np.geomspace(10, 1e6, 25).astype(int)).astype(float)
    apart = [_lattice_distance(NOISE, sine_hash, number) for number in numbers]
    ours = _lattice_distance(OURS, _integer_hash, numbers[-1])
    images = [ExhibitImage(f"{'Handout' if name == 'handout' else 'Ours'} in {where}", _grey(marble[name, where]))
              for name in ("handout", "ours") for where in ("GLSL", "Mitsuba")]
    findings = (
        Finding("renderers agree", "largest difference of marble between GLSL and Mitsuba", largest[0], largest[1],
                "number", largest[0] > SAME_TEXTURE, largest[1] < SAME_TEXTURE),
        Finding("renderers agree", "mean difference of lattice values near (1,000,000, 0, 0); of unrelated ones 0.33",
                apart[-1], ours, "number", apart[-1] > SAME_TEXTURE, ours < SAME_TEXTURE))
    plot = Plot("Mean difference of hash(n), GLSL and Mitsuba", "lattice number n", "xy", (
        Series("handout", False, numbers, np.maximum(apart, 1e-6)),))
    return exhibit("sine-noise", findings, images, [plot], largest=largest[0])


def _shader_fbm(variant: Variant, points: np.ndarray) -> np.ndarray:
    """fbm (N,) of the shader at points (N, 3)."""
    count = len(points)
    found = variant.probe("noise.frag", np.c_[points, np.full(count, OCTAVES)],
                          np.tile([LACUNARITY, GAIN, SEED >> 16, SEED & 0xFFFF], (count, 1)), outputs=2)
    return found[:, 5]


def _fbm(points: np.ndarray, noise: Callable[[np.ndarray, int], np.ndarray]) -> np.ndarray:
    """The same sum over a noise of points (N, 3) and a seed; as lib/noise.glsl adds it up."""
    total, weights, weight, seed, at = np.zeros(len(points)), 0.0, 1.0, SEED, points.astype(np.float64)
    for _ in range(OCTAVES):
        total += weight * noise(at, seed)
        weights, weight, at = weights + weight, weight * GAIN, at * LACUNARITY
        seed = seed + OCTAVE & UINT32
    return np.asarray(total / weights)


def sine_hash(n: np.ndarray) -> np.ndarray:
    """The handout's hash of lattice numbers with Mitsuba's sine, in float32 like the shader's."""
    scaled = sine(n) * np.float32(43758.5453123)
    return np.asarray(scaled - np.floor(scaled), dtype=np.float64)


def _sine_lattice(points: np.ndarray, seed: int) -> np.ndarray:
    """Value noise at points (N, 3) on `sine_hash`, interpolated as lib/noise.glsl does."""
    corner = np.floor(points)
    f = points - corner
    s = f**3 * (f * (f * 6 - 15) + 10)
    number = corner @ np.array([1.0, 57.0, 113.0])
    value = np.zeros(len(points))
    for k in range(8):
        offset = np.array([k & 1, k >> 1 & 1, k >> 2])
        weight = np.where(offset, s, 1 - s).prod(axis=1)
        value += weight * sine_hash(number + offset @ np.array([1.0, 57.0, 113.0]))
    return value


def _integer_hash(n: np.ndarray) -> np.ndarray:
    """The library's hash at lattice points (n, 0, 0) as Mitsuba has it."""
    return np.asarray(value_noise(NUMPY, (n, np.zeros_like(n), np.zeros_like(n)), SEED)[0])


def _lattice_distance(variant: Variant, mitsuba: Callable[[np.ndarray], np.ndarray], number: float) -> float:
    """The mean difference of the hash in GLSL from that in Mitsuba over 256 lattice points from (number, 0, 0) on."""
    n = number + np.arange(256.0)
    found = variant.probe("noise.frag", np.c_[n, np.zeros((256, 2)), np.ones(256)],
                          np.tile([LACUNARITY, GAIN, 0, 0], (256, 1)), outputs=2)
    return float(np.abs(found[:, 4] - mitsuba(n)).mean())


def _marble(points: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Veins: a wave along x, bent by the noise; (POINTS, POINTS) within [0, 1]."""
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * (points[:, 0] / FREQUENCY + 2 * field))
    return np.asarray(wave.reshape(POINTS, POINTS))


def _grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[..., None], 3, axis=2)


def convergence(store: Store | None) -> Exhibit:
    """Importance sampling reduces what the handout says it augments."""
    scene = load(SceneFile.bundled("spheres", (WIDTH // 2, HEIGHT // 2)))
    result = study(scene, ("uniform", "mixture"), spp=256, replicas=4, max_replicas=4, reference_spp=1024, store=store)
    slow, fast = result.strategies
    ratios = (slow.curves["rmse"][:, -1] / fast.curves["rmse"][:, -1]) ** 2
    mean, low, high = (float(bound[0]) for bound in band(ratios[:, None], 0.95, geometric=True))
    time = mean * slow.seconds_per_spp / fast.seconds_per_spp
    series = tuple(Series(s.strategy, s is fast, s.spp.astype(float), s.curves["rmse"].mean(axis=0))
                   for s in (slow, fast))
    finding = Finding("equal error", "samples to the same RMSE, over those of uniform sampling", "more than 1",
                      f"{1 / mean:.2g}", "words", low > 1, low > 1)
    return exhibit("convergence", [finding], (), [Plot("RMSE (radiance)", "samples per pixel", "xy", series)],
                   samples=mean, low=low, high=high, time=time)
