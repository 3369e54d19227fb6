"""Exhibits of numbers: random numbers and noise out of a sine, and the wording about convergence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.estimate import Accumulator, Estimate, luminance
from harness.exhibits import checks
from harness.exhibits.estimators import HEIGHT, WIDTH, image_finding
from harness.exhibits.variants import NOISE, OURS, RANDOM, Variant
from harness.files import data_dir
from harness.metrics import rmse
from harness.reference.sine import sine
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.runs import batches, judge, render_reference
from harness.scene import Scene, load_scene
from harness.scene.noise import NUMPY, value_noise
from harness.stats.convergence import band
from harness.store import Store
from harness.studies import study

BOTH = (("handout", RANDOM), ("ours", OURS))
# Passes from which random numbers are looked at: the first, and those that a picture of 20,000 rays per pixel, or one
# left running over night, gets to.
LATE, LATEST = 100_000, 1_000_000
NOISE_SPP = 256
CURVE_SPP, TRUTH_SPP = 4096, 8192


def random_numbers(store: Store | None) -> Exhibit:
    """The seed in a float32, and the generator that is a sine."""
    scene = load_scene(data_dir("mitsuba_scenes") / "spheres.xml", width=96, height=72)
    first = {name: checks.random_numbers(variant, 0)[..., :4] for name, variant in BOTH}
    late = {name: checks.random_numbers(variant, LATE)[..., 0] for name, variant in BOTH}
    shares = [checks.distinct_share(first[name]) for name, _ in BOTH]
    coarse = [float((first[name] * 256 % 1 == 0).mean()) for name, _ in BOTH]
    rows = [checks.correlation(late[name][1:] - 0.5, late[name][:-1] - 0.5) for name, _ in BOTH]
    truth = OURS.render(scene, "mixture", TRUTH_SPP, store)
    runs = {name: _run(variant, scene, truth, store) for name, variant in BOTH}
    # The truth has white noise of its own, so much of the variance of the difference.
    dilution = 1 + CURVE_SPP / TRUTH_SPP
    early = [dilution * checks.correlation(runs[name][1][:, 1:], runs[name][1][:, :-1]) for name, _ in BOTH]
    noise = {name: _late_noise(variant, scene, truth) for name, variant in BOTH}
    columns = [checks.correlation(noise[name][:, 1:], noise[name][:, :-1]) for name, _ in BOTH]
    below = [checks.correlation(noise[name][1:], noise[name][:-1]) for name, _ in BOTH]
    reference = render_reference(scene, 4 * NOISE_SPP, store=store)
    verdicts = [judge(variant.render(scene, "mixture", 2 * NOISE_SPP, store), reference) for _, variant in BOTH]
    pairs = late["ours"][1:].size

    def correlated(values: list[float], of: int, measures: str) -> Finding:
        return Finding("neighbour correlation", measures, values[0], values[1], "number",
                       checks.correlates(values[0], of), not checks.correlates(values[1], of))

    last = [runs[name][0].y[-1] for name, _ in BOTH]
    return Exhibit(
        "sine-random", "Random numbers from a sine", "course/random.glsl",
        "seed = (numpass*0.9610356 + 1024*texcoord.x + texcoord.y)*1.51269341231\n"
        "rand() = fract(sin(seed++)*43758.5453123)",
        "an integer hash of (pixel, pass, replica): lib/random.glsl",
        f"No dramatic failure: the RMSE falls as it should (at {CURVE_SPP:,} passes it is "
        f"{100 * (last[0] / last[1] - 1):+.1f} % off ours) and the image's mean is right within ±0.2 %. But the float32 "
        "seed and the sine have few values, and the larger the pass, the fewer: rows of the image then share their random "
        f"numbers, so that their noise is alike ({below[0]:.2f} correlation between rows, {columns[0]:.2f} between columns, at "
        "pass 1,000,000) and no longer averages out over the picture. What sine a GPU has decides the rest; these are the "
        "numbers of this driver.",
        "Seed an integer hash with the integer pixel, pass and replica. It is no slower, the same on every GPU, and no two "
        "pixels share a stream.",
        (Finding("distinct values", f"among {first['ours'].size:,} numbers of pass 0, of those expected", *shares, "share",
                 shares[0] < 0.99, shares[1] > 0.99),
         Finding("distinct values", "whole multiples of 1/256 among them; expected 0.0015 %", *coarse, "share",
                 coarse[0] > 1e-3, coarse[1] < 1e-3),
         correlated(rows, pairs, "numbers of pixels one above the other at pass 100,000"),
         correlated(early, noise["ours"][:, 1:].size, f"noise of x-neighbours after the first {CURVE_SPP:,} passes"),
         correlated(columns, noise["ours"][:, 1:].size, f"noise of x-neighbours, {NOISE_SPP} passes from 1,000,000"),
         correlated(below, noise["ours"][1:].size, "noise of y-neighbours, the same passes"),
         image_finding(*verdicts, f"spheres, the first {2 * NOISE_SPP} passes")),
        tuple(ExhibitImage(f"Noise at pass 1,000,000, {name}", noise[name]) for name, _ in BOTH),
        (_value_plot(first), _row_plot(), Plot("RMSE (radiance)", "passes", "xy", tuple(run[0] for run in runs.values()))))


def _run(variant: Variant, scene: Scene, truth: Estimate, store: Store | None) -> tuple[Series, np.ndarray]:
    """RMSE of one run at the powers of two up to CURVE_SPP passes, and the relative noise (H, W) at its end."""
    renderer = variant.renderer(scene, "mixture")
    total, done, x, y = Accumulator(), 0, [], []
    try:
        for batch in batches(renderer, CURVE_SPP, replica=3, store=store):
            total.add(batch)
            done += batch.samples
            if done & (done - 1) == 0:
                x.append(done)
                y.append(rmse(total.mean, truth.mean, noise=truth.variance))
    finally:
        renderer.release()
    line = Series("ours" if variant is OURS else "handout", variant is OURS, np.array(x), np.array(y))
    return line, _relative_noise(total.mean, truth)


def _late_noise(variant: Variant, scene: Scene, truth: Estimate) -> np.ndarray:
    """Relative noise of luminance (H, W) of NOISE_SPP passes from pass LATEST on."""
    renderer = variant.renderer(scene, "mixture")
    try:
        return _relative_noise(renderer.render_batch(3, LATEST, NOISE_SPP).mean, truth)
    finally:
        renderer.release()


def _relative_noise(image: np.ndarray, truth: Estimate) -> np.ndarray:
    relative = luminance(image) / luminance(truth.mean) - 1
    return np.asarray(relative - relative.mean())


def _value_plot(numbers: dict[str, np.ndarray]) -> Plot:
    """How often each of the values k/4096 is drawn within a 64th of the range, per 1000 draws in there."""
    series = []
    for name, _ in BOTH:
        values = numbers[name].ravel()
        inside = values[(values >= 0.5) & (values < 0.5 + 1 / 64)]
        counts = np.bincount(((inside - 0.5) * 4096).astype(int), minlength=64)
        series.append(Series(name, name == "ours", 0.5 + np.arange(64) / 4096, 1000 * counts / len(inside)))
    return Plot("Draws per 1000 in steps of 1/4096", "value of rand()", "", tuple(series))


def _row_plot() -> Plot:
    """Correlation of the first numbers of pixels one above the other against the pass."""
    passes = np.unique(np.geomspace(100, LATEST, 13).astype(int))
    series = []
    for name, variant in BOTH:
        found = [checks.random_numbers(variant, int(number), side=128)[..., 0] - 0.5 for number in passes]
        series.append(Series(name, name == "ours", passes, np.array([checks.correlation(n[1:], n[:-1]) for n in found])))
    return Plot("Correlation of rand() between rows", "pass", "x", tuple(series))


# The marble of the noise's exhibit: 96² points of a patch this many units wide and this far from the origin, and the
# fractal noise in it. Nothing unusual: the floor of a large room.
PATCH, DISTANCE, POINTS = 6.0, 94.0, 96
FREQUENCY, OCTAVES, LACUNARITY, GAIN, SEED = 4.0, 5, 2.0, 0.5, 0


def sine_noise(store: Store | None) -> Exhibit:
    """A lattice hash out of a sine: another texture in each renderer."""
    x, y = np.meshgrid((np.arange(POINTS) + 0.5) / POINTS * PATCH + DISTANCE, (np.arange(POINTS) + 0.5) / POINTS * PATCH
                       + DISTANCE)
    points = np.float32(np.stack([x, y, np.full_like(x, 10.0)], axis=-1).reshape(-1, 3) * FREQUENCY)
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
    return Exhibit(
        "sine-noise", "Value noise on a sine", "course/noise.glsl",
        "hash(n) = fract(sin(n)*43758.5453123)", "an integer hash of the lattice point: lib/noise.glsl",
        "The factor 43758.5 magnifies the last digits of the sine until they are the first digits of the hash, and those "
        "digits are each compiler's own. Mitsuba's compiler reduces large arguments less carefully than this GL driver, so "
        "far from the origin, where the lattice points have large numbers, the two draw different textures from the same "
        f"formula: marble differs by up to {largest[0]:.2f} of the range from black to white. So would two GPUs.",
        "Hash the lattice point with integer arithmetic: the same bits on every machine, and points that happen to share "
        "x + 57 y + 113 z no longer share their value.",
        (Finding("renderers agree", "largest difference of marble between GLSL and Mitsuba", *largest, "number",
                 largest[0] > 1e-3, largest[1] < 1e-3),
         Finding("renderers agree", "mean difference of the hash about lattice point (1,000,000, 0, 0); of unrelated values: 0.33",
                 apart[-1], ours, "number", apart[-1] > 1e-3, ours < 1e-3)),
        tuple(images),
        (Plot("Mean difference of hash(n), GLSL against Mitsuba", "lattice number n", "xy", (
            Series("handout", False, numbers, np.maximum(apart, 1e-6)),)),))


def _shader_fbm(variant: Variant, points: np.ndarray) -> np.ndarray:
    """fbm (N,) of the shader at points (N, 3)."""
    count = len(points)
    found = variant.probe("noise.frag", np.c_[points, np.full(count, OCTAVES)],
                          np.tile([LACUNARITY, GAIN, SEED >> 16, SEED & 0xFFFF], (count, 1)), outputs=3)
    return found[:, 9]


def _fbm(points: np.ndarray, noise: Callable[[np.ndarray, int], np.ndarray]) -> np.ndarray:
    """The same sum over a noise of points (N, 3) and a seed; as lib/noise.glsl adds it up."""
    total, weights, weight, seed, at = 0.0, 0.0, 1.0, SEED, points.astype(np.float64)
    for _ in range(OCTAVES):
        total = total + weight * noise(at, seed)
        weights, weight, at = weights + weight, weight * GAIN, at * LACUNARITY
        seed = seed + 0x9E3779B9 & 0xFFFFFFFF
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
                          np.tile([LACUNARITY, GAIN, 0, 0], (256, 1)), outputs=3)
    return float(np.abs(found[:, 8] - mitsuba(n)).mean())


def _marble(points: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Veins: a wave along x, bent by the noise; (POINTS, POINTS) within [0, 1]."""
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * (points[:, 0] / FREQUENCY / 2 + 4 * field))
    return np.asarray(wave.reshape(POINTS, POINTS))


def _grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[..., None], 3, axis=2)


def convergence(store: Store | None) -> Exhibit:
    """Importance sampling reduces what the handout says it augments."""
    scene = load_scene(data_dir("mitsuba_scenes") / "spheres.xml", width=WIDTH // 2, height=HEIGHT // 2)
    result = study(scene, ("uniform", "mixture"), spp=256, replicas=4, max_replicas=4, reference_spp=2048, store=store)
    slow, fast = result.strategies
    ratios = (slow.rmse[:, -1] / fast.rmse[:, -1]) ** 2
    mean, low, high = (float(bound[0]) for bound in band(ratios[:, None], 0.95, geometric=True))
    time = mean * slow.cpu_seconds_per_spp / fast.cpu_seconds_per_spp
    series = tuple(Series(s.strategy, s is fast, s.spp.astype(float), s.rmse.mean(axis=0)) for s in (slow, fast))
    return Exhibit(
        "convergence", "Importance sampling and convergence time", "",
        "“importance sampling augments convergence time”", "importance sampling reduces convergence time",
        f"The opposite was meant. On the course's scene uniform sampling takes {mean:.0f} times the samples of mixture "
        f"(95 % interval {low:.0f} to {high:.0f}) to the same RMSE, and {time:.0f} times the CPU time.",
        "Say what is compared: samples, or time, to the same error. Both estimators fall as 1/√N; importance sampling "
        "lowers the line and does not tilt it.",
        (Finding("equal error", "samples that the strategy needs over those of uniform, to the same RMSE", "more than 1",
                 f"{1 / mean:.2g}", "words", low > 1, high > 1),),
        (), (Plot("RMSE (radiance)", "samples per pixel", "xy", series),))
