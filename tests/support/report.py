"""Study results made up from noise of known size: RMSE falls as N^(-1/2), one strategy does not suit, one is exact."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from harness import metrics
from harness.policy import fail_level
from harness.results import StrategyResult, StudyResult
from harness.samples.cost import Cost
from harness.samples.estimate import Accumulator, Batch, Estimate
from harness.stats.bias import mean_error_verdict
from harness.stats.convergence import fit_slope
from harness.stats.findings import judge_tiles
from harness.stats.tiles import tile_size
from harness.stats.verdicts import Tolerance
from harness.studies.table import measured
from harness.work.run import tiles_of

# Standard deviation of one sample, relative to the pixel's radiance, and CPU seconds for one sample per pixel.
STRATEGIES = {"uniform": (1.6, 0.010), "cosine": (0.9, 0.011), "lobes": (0.5, 0.013), "mixture": (0.35, 0.014)}
BATCHES = 8
DEVICE = "llvmpipe (LLVM 15.0.6, 256 bits)"


def scene_image(size: int, seed: int) -> np.ndarray:
    """A picture with spheres before a wall, (size, size, 3), radiance between about 0.02 and 1.5."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[0:size, 0:size] / size
    image = np.stack([0.25 + 0.3 * y, 0.3 + 0.2 * y, 0.4 + 0.1 * (1 - y)], axis=-1)
    for _ in range(6):
        cx, cy, radius = random.uniform(0.15, 0.85), random.uniform(0.25, 0.85), random.uniform(0.07, 0.2)
        inside = (x - cx) ** 2 + (y - cy) ** 2 < radius**2
        height = np.sqrt(np.maximum(radius**2 - (x - cx) ** 2 - (y - cy) ** 2, 0)) / radius
        shade = 0.1 + height + 0.8 * np.maximum(height - 0.9, 0) * 10
        image = np.where(inside[..., None], shade[..., None] * random.uniform(0.2, 0.9, 3), image)
    return np.maximum(image, 0.02)


def noisy(truth: np.ndarray, spp: int, sigma: float, random: np.random.Generator, bias: float = 0.0,
          batches: int = BATCHES, seconds: float = 0.01) -> Estimate:
    """An estimate of `truth * (1 + bias)` merged from equal batches whose samples scatter by `sigma * truth`."""
    accumulator = Accumulator()
    per_batch = max(spp // batches, 1)
    for _ in range(batches):
        noise = random.standard_normal(truth.shape) * sigma / np.sqrt(per_batch)
        accumulator.add(Batch((truth * (1 + bias + noise)).astype(np.float32), per_batch, 0,
                              Cost(seconds * per_batch, seconds * per_batch, None, DEVICE, "cpu")))
    return accumulator.estimate()


def strategy_result(name: str, truth: np.ndarray, reference: Estimate, *, sigma: float, seconds: float, spp: int,
                    replicas: int, seed: int, bias: float = 0.0, exposure: float = 0.0,
                    scene: str = "spheres") -> StrategyResult:
    """One strategy whose samples have the relative standard deviation `sigma` and the relative bias `bias`."""
    random = np.random.default_rng(seed)
    prefixes = 2 ** np.arange(int(np.log2(spp)) + 1)
    curves = {metric.name: np.empty((replicas, prefixes.size)) for metric in metrics.METRICS if metric.at_prefixes}
    for replica in range(replicas):
        total = np.zeros_like(truth)
        for index, prefix in enumerate(prefixes):
            more = prefix - (prefixes[index - 1] if index else 0)
            total += truth * (more * (1 + bias) + np.sqrt(more) * sigma * random.standard_normal(truth.shape))
            mean = total / prefix
            for metric, value in metrics.measure(mean, reference, exposure, at_prefixes=True).items():
                curves[metric][replica, index] = value
    merged = noisy(truth, spp * replicas, sigma, random, bias, seconds=seconds)
    verdict = mean_error_verdict(merged.image_mean, merged.image_variance, merged.batches - 1, reference.image_mean,
                                 reference.image_variance, max(reference.batches - 1, 0) or np.inf)
    tile = tile_size(*truth.shape[:2])
    tiles = judge_tiles(tiles_of(merged, tile), tiles_of(reference, tile), Tolerance(), fail_level=fail_level(5),
                        pass_level=0.05)
    return StrategyResult(
        strategy=name, suits=True, warning="", measured=measured(
            scene, (), name, samples=merged.samples, spp=prefixes, curves=curves, seconds_per_spp=seconds,
            replica_seconds=[seconds] * replicas,
            scores=metrics.measure(merged.mean, reference, exposure, at_prefixes=False), rejected=merged.rejected,
            device=DEVICE),
        estimate=merged, verdict=verdict, tiles=tiles, slope=fit_slope(prefixes, curves["rmse"]) if sigma else None)


def with_measured(strategy: StrategyResult, **others: Any) -> StrategyResult:
    """The strategy with other measurements: `spp`, `curves`, `scores`, `seconds_per_spp` or `device`."""
    first = strategy.measured[0]
    held = {name: getattr(strategy, name) for name in ("spp", "curves", "scores", "seconds_per_spp", "device")}
    seconds = others.get("seconds_per_spp", strategy.seconds_per_spp)
    held["replica_seconds"] = [seconds] * len({**held, **others}["curves"]["rmse"])
    return replace(strategy, measured=measured(
        first.scene, first.parameters, strategy.strategy, samples=strategy.estimate.samples,
        rejected=strategy.estimate.rejected, **{**held, **others}))


def with_curves(strategy: StrategyResult, **curves: np.ndarray) -> StrategyResult:
    """The strategy with other curves of the metrics named."""
    return with_measured(strategy, curves={**strategy.curves, **curves})


def study_result(scene: str = "spheres", *, size: int = 32, spp: int = 64, replicas: int = 3, seed: int = 1,
                 unsuited: bool = True, biases: dict[str, float] | None = None) -> StudyResult:
    """A study against a noisy reference, with `phong` as the strategy that does not suit where `unsuited`."""
    truth = scene_image(size, seed)
    random = np.random.default_rng(seed + 1000)
    reference = noisy(truth, 4 * spp * replicas, 0.3, random)
    strategies = [
        strategy_result(name, truth, reference, sigma=sigma, seconds=seconds, spp=spp, replicas=replicas,
                        seed=seed + 10 + index, bias=(biases or {}).get(name, 0.0), scene=scene)
        for index, (name, (sigma, seconds)) in enumerate(STRATEGIES.items())]
    if unsuited:
        phong = strategy_result("phong", truth, reference, sigma=12.0, seconds=0.012, spp=spp, replicas=replicas,
                                seed=seed + 99, bias=-0.3, scene=scene)
        strategies.insert(2, replace(phong, suits=False, warning=(
            "draws from the glossy lobe only, but 4 of the 7 materials have a diffuse part (kd > 0), whose light it "
            "finds rarely and with enormous weights")))
    return StudyResult(
        scene=scene, description=(
            f"The course's scene {scene}: a plane, six spheres and a box under a constant environment. It proves that "
            "diffuse, glossy and specular Phong materials agree with the reference, each strategy on its own."),
        scene_hash=f"{seed:016x}", exposure=0.5, reference=reference, reference_kind="Mitsuba",
        strategies=tuple(strategies),
        notes=("the reconstruction filter 'gaussian' is replaced by box in both renderers",),
        provenance=_provenance(scene, size, spp, replicas))


def exact_study(scene: str = "furnace_convex", *, size: int = 32, spp: int = 64, replicas: int = 3) -> StudyResult:
    """A study against a closed form in which cosine sampling has no noise at all."""
    truth = np.full((size, size, 3), 0.5)
    truth[size // 4 : size // 2] = 1.0
    reference = Estimate.exact(truth)
    strategies = tuple(
        strategy_result(name, truth, reference, sigma=sigma, seconds=0.004, spp=spp, replicas=replicas, seed=index,
                        scene=scene)
        for index, (name, sigma) in enumerate((("uniform", 0.8), ("cosine", 0.0))))
    return StudyResult(
        scene=scene, description="A convex diffuse object under a constant environment: every pixel has a closed form.",
        scene_hash="f" * 16, exposure=0.0, reference=reference, reference_kind="closed form", strategies=strategies,
        provenance=_provenance(scene, size, spp, replicas))


def _provenance(scene: str, size: int, spp: int, replicas: int) -> dict[str, str]:
    return {"mitsuba": "3.9.1", "numpy": "2.4.6", "gl_renderer": "llvmpipe (LLVM 15.0.6, 256 bits)",
            "gl_version": "4.5", "scene file": f"{scene}.xml", "image size": f"{size} x {size}", "path vertices": "6",
            "samples per pixel of each replica": str(spp), "replicas (seeds)": f"{replicas} (0 to {replicas - 1})"}
