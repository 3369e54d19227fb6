"""Products of studies made by hand: power laws whose slopes, errors and seconds a test knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.results import StrategyResult, StudyResult
from harness.samples.estimate import Estimate
from harness.stats.bias import mean_error_verdict
from harness.stats.convergence import fit_slope
from harness.stats.findings import judge_tiles
from harness.stats.tiles import tile_size
from harness.stats.verdicts import Tolerance
from harness.studies.parameters import Axes
from harness.studies.product import StudyProduct
from harness.studies.table import measured
from harness.work.run import tiles_of

SIDE, SPP = 12, 2 ** np.arange(7)
DEVICE = "llvmpipe (LLVM 15.0.6, 256 bits)"


def line(name: str, *, error: float = 1.0, slope: float = -0.5, bias: float = 0.0, seconds: float = 0.01,
         spread: float = 0.02, replicas: int = 8, seed: int = 0, scene: str = "ball",
         parameters: tuple[tuple[str, str], ...] = (), device: str = DEVICE,
         spp: np.ndarray = SPP) -> StrategyResult:
    """An estimator whose RMSE is `error` × samples^`slope`, each replica's off by `spread`, relative, as its seconds
    are; the mean is off by `bias` with a standard error of 0.0002."""
    random = np.random.default_rng([seed, len(name)])
    each = 1 + spread * random.standard_normal((replicas, 1))
    rmse = error * spp.astype(float) ** slope * each
    curves = {"rmse": rmse, "mean_error": bias + 0.001 * random.standard_normal(rmse.shape),
              "ssim": 1 - np.minimum(0.9, rmse)}
    truth = np.full((SIDE, SIDE, 3), 0.5)
    means = np.full(4, 0.5)
    verdict = mean_error_verdict(means * (1 + bias), np.full(4, 1e-8), max(replicas - 1, 1), means, np.zeros(4), np.inf)
    estimate = replace(Estimate.exact(truth * (1 + bias)), samples=int(spp[-1]) * replicas)
    exact = tiles_of(Estimate.exact(truth), tile_size(SIDE, SIDE))
    taken = seconds * (1 + spread * random.standard_normal(replicas))
    return StrategyResult(
        name, True, "", measured(scene, parameters, name, samples=estimate.samples, spp=spp, curves=curves,
                                 scores={"relmse": 0.1, "flip": 0.1, "delta_e2000": 0.1},
                                 seconds_per_spp=seconds, replica_seconds=list(taken), rejected=0, device=device),
        estimate, verdict, judge_tiles(exact, exact, Tolerance(), fail_level=0.01, pass_level=0.05),
        fit_slope(spp, rmse) if len(spp) > 2 else None)


def study(*lines: StrategyResult, error: float | None = None) -> StudyResult:
    """A study of these lines, which share scene and parameters."""
    first = lines[0].measured[0]
    name = " ".join([first.scene, *(f"{name}={value}" for name, value in first.parameters)])
    return StudyResult(name, "", "0" * 16, 0.0, Estimate.exact(np.full((SIDE, SIDE, 3), 0.5)), "closed form", lines,
                       error=error)


def product(*, seed: int = 0, axes: Axes = (("alpha", ("1", "10", "100")), ("lens", ("none", "thin"))),
            **options: float) -> StudyProduct:
    """Two estimators over two parameters, one of numbers and one of words; `options`: of the second one's `line`."""
    studies = []
    for alpha in dict(axes)["alpha"]:
        for lens in dict(axes)["lens"]:
            given = (("alpha", alpha), ("lens", lens))
            size = float(alpha) ** 0.25
            studies.append(study(
                line("uniform", error=size, parameters=given, seed=seed),
                line("myrt", parameters=given, seed=seed + 100, **{"error": 0.5, **options})))  # type: ignore[arg-type]
    return StudyProduct(axes, tuple(studies))
