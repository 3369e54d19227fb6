"""How often verdicts on differences err: on made-up pairs with the same random numbers, of which some samples part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.calibration.comparisons import POWER_SHARE, SIDE
from harness.progress import Progress, quiet
from harness.stats.calibration import FalseAlarms, Pair, Power, coupled, coupled_power, false_alarms
from harness.stats.levels import Looks
from harness.stats.paired import COUPLED, TIGHT, PairedLooking
from harness.stats.partings import PARTINGS, bias, draw_pair
from harness.stats.synthetic import Plan
from harness.stats.verdicts import Tolerance

# A replica of a coupled gate, in samples per pixel, and the replicas of its budget.
SPP, REPLICAS = 64, 64
# Samples that are expected to part in all of an image's samples. Tails are heaviest around one.
EXPECTED = (0.3, 3.0, 50.0)
# Jumps to both sides have mean zero: without tolerance, an alarm is false.
NULL = ("even", "lamps")
# Power is measured with so many replicas of a budget, of whose samples this share parts, as in most scenes.
POWER_REPLICAS = (16, 32, 64)
PARTING = 2e-6
# What is tolerated, and a replica's samples per pixel: 16 of the one and 32 of the other are 3 s and 10 s of two cores.
PLANS: dict[str, tuple[Tolerance, int]] = {"coupled": (COUPLED, SPP), "tight": (TIGHT, 4 * SPP)}
# By so many fine tolerances all samples of a silhouette's tiles drift, where partings make up for it.
DRIFT = 1.5

Coupled = tuple[dict[str, str], tuple[FalseAlarms, ...], tuple[Power, ...]]


def compare_coupled(comparisons: int, progress: Progress = quiet) -> Coupled:
    """Measure false alarms of paired verdicts over so many comparisons of each case, and power over a fifth of them.

    Returns cases, false alarms and power as `stats.calibration.Calibration` has them.
    """
    cases: dict[str, str] = {}
    alarms: list[FalseAlarms] = []
    powers: list[Power] = []
    number = len(NULL) * len(EXPECTED) + len(PLANS) * (1 + len(POWER_REPLICAS))
    with progress(number, "calibration of differences") as advance:
        for kind in NULL:
            for expected in EXPECTED:
                case = f"coupled: {expected:g} part, {kind}"
                cases[case] = f"synthetic, {SPP * REPLICAS} samples per pixel"
                alarms += false_alarms(case, pairs(kind, expected, REPLICAS, comparisons), looks(REPLICAS), coupled())
                advance(1)
        for name, (tolerance, spp) in PLANS.items():
            case = f"coupled: drift, {name}"
            cases[case] = f"synthetic, {SPP * REPLICAS} samples per pixel"
            alarms += false_alarms(case, drifting(tolerance, REPLICAS, comparisons), looks(REPLICAS),
                                   coupled(tolerance))
            advance(1)
            for replicas in POWER_REPLICAS:
                case = f"coupled: {replicas} replicas, {name}"
                cases[case] = f"synthetic, up to {spp * replicas} samples per pixel"
                expected = PARTING * SIDE**2 * spp * replicas
                held = list(pairs("even", expected, replicas, max(1, comparisons // POWER_SHARE), spp))
                powers += coupled_power(case, held, PairedLooking(looks(replicas, spp), tolerance),
                                        np.random.default_rng(replicas))
                advance(1)
    return cases, tuple(alarms), tuple(powers)


def looks(replicas: int, spp: int = SPP) -> Looks:
    """At a quarter, a half and all of a budget."""
    return Looks((replicas * spp // 4, replicas * spp // 2, replicas * spp))


def pairs(kind: str, expected: float, replicas: int, comparisons: int, spp: int = SPP) -> Iterator[Pair]:
    """Coupled estimates of one image, so many samples of which part."""
    rng, plan = np.random.default_rng([replicas, spp, round(10 * expected)]), Plan(SIDE, replicas, spp)
    for _ in range(comparisons):
        yield draw_pair(PARTINGS[kind], plan, expected, rng)


def drifting(tolerance: Tolerance, replicas: int, comparisons: int) -> Iterator[Pair]:
    """Coupled estimates without a bias, though nearly all samples of some tiles are off to one side by more than is
    tolerated: the few that part make up for it, and a tile that has seen none of these knows nothing of it."""
    plan, bright = Plan(SIDE, replicas, SPP), PARTINGS["bright"]
    rng = np.random.default_rng(replicas)
    expected = DRIFT * tolerance.fine / float(bias(bright, plan, 1.0)[1].max())
    for _ in range(comparisons):
        yield draw_pair(bright, plan, expected, rng, drift=-bias(bright, plan, expected)[1])
