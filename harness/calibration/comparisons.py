"""How often verdicts err on pairs of estimates: made-up estimators and renders, with light tails and heavy ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.progress import Advance, Progress, quiet
from harness.samples.estimate import with_luminance
from harness.scene import SceneFile
from harness.stats.calibration import (
    NO_TOLERANCE,
    FalseAlarms,
    Pair,
    Power,
    false_alarms,
    power,
    together,
)
from harness.stats.levels import Looks
from harness.stats.sequential import Looking
from harness.stats.synthetic import NOISES, Plan, draw
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size

# Side of the images in pixels; tiles of 3 and 12 pixels divide it.
SIDE = 60
# Each estimate of a comparison: so many batches of so many samples per pixel. Few: tails are heaviest then.
BATCHES, SPP = 32, 4
LOOKS = Looks((BATCHES * SPP // 4, BATCHES * SPP // 2, BATCHES * SPP))
# Samples per pixel of a batch with which normal samples decide at the default tolerances.
DECIDING_SPP = 256
# Comparisons that power is measured on, of those that false alarms are.
POWER_SHARE = 5
# First replica of the reference's side: strategies seed by replica alone, so the two sides must not share any.
REFERENCE_REPLICAS = 1 << 30
ALL = "all cases"

# Strategy of test and of reference, on scenes without and with rare bright samples.
RENDERED = (("diffuse", "uniform", "cosine"), ("spheres", "uniform", "mixture"), ("cornell", "uniform", "mixture"))
SYNTHETIC = (("normal", "normal"), ("fireflies", "normal"), ("fireflies", "fireflies"), ("lognormal", "normal"),
             ("lognormal", "lognormal"))

Measured = tuple[dict[str, str], tuple[FalseAlarms, ...], tuple[Power, ...]]


def compare(comparisons: int, progress: Progress = quiet) -> Measured:
    """Measure false alarms over so many independent null comparisons of each case, and power over a fifth of them.

    The tracer renders both sides of `RENDERED` anew, with two strategies that have the same mean if both are right.
    Returns cases, false alarms and power as `stats.calibration.Calibration` has them.
    """
    cases: dict[str, str] = {}
    alarms: list[FalseAlarms] = []
    powers: list[Power] = []
    samples = BATCHES * SPP
    with progress((len(SYNTHETIC) + 4 * len(RENDERED) + 2) * comparisons, "calibration") as advance:
        for number, (ours, theirs) in enumerate(SYNTHETIC):
            case = f"{ours} / {theirs}"
            cases[case] = f"synthetic, {samples} samples per pixel"
            pairs = synthetic_pairs(ours, theirs, SPP, comparisons, number, advance)
            alarms += false_alarms(case, pairs, LOOKS)
        for scene, test, reference in RENDERED:
            case = f"{scene}: {test} / {reference}"
            cases[case] = f"rendered, {samples} samples per pixel"
            held: list[Pair] = []
            pairs = _keeping(rendered_pairs(scene, test, reference, comparisons, advance), held, _subset(comparisons))
            alarms += false_alarms(case, pairs, LOOKS)
            powers += power(case, held, Looking(Looks((samples,)), NO_TOLERANCE), np.random.default_rng(0))
            advance(2 * comparisons)
        case = "normal / normal, to a decision"
        cases[case] = f"synthetic, up to {BATCHES * DECIDING_SPP} samples per pixel"
        deciding = Looks(tuple(count * DECIDING_SPP // SPP for count in LOOKS.samples))
        held = list(synthetic_pairs("normal", "normal", DECIDING_SPP, _subset(comparisons), len(SYNTHETIC)))
        powers += power(case, held, Looking(deciding), np.random.default_rng(1))
        advance(2 * comparisons)
    return cases, (*alarms, *together(alarms, ALL)), tuple(powers)


def synthetic_pairs(ours: str, theirs: str, spp: int, comparisons: int, seed: int,
                    advance: Advance = lambda n: None) -> Iterator[Pair]:
    """Independent estimates of one image by the estimators `ours` and `theirs` of `synthetic.NOISES`."""
    rng, plan = np.random.default_rng(seed), Plan(SIDE, BATCHES, spp)
    for _ in range(comparisons):
        yield draw(NOISES[ours], plan, rng), draw(NOISES[theirs], plan, rng)
        advance(1)


def rendered_pairs(name: str, ours: str, theirs: str, comparisons: int,
                   advance: Advance = lambda n: None) -> Iterator[Pair]:
    """Independent estimates of a bundled scene by two strategies of the tracer; every replica is drawn once."""
    scene = SceneFile.bundled(name, (SIDE, SIDE))
    with Tracer(ours).open(scene) as test, Tracer(theirs).open(scene) as reference:
        for number in range(comparisons):
            first = number * BATCHES
            yield _estimate(test, first), _estimate(reference, REFERENCE_REPLICAS + first)
            advance(2)


def _estimate(renderer: Renderer, first: int) -> TileSamples:
    tiles = TileAccumulator(tile_size(SIDE, SIDE))
    for replica in range(first, first + BATCHES):
        batch = renderer.render_batch(replica, 0, SPP)
        tiles.add(with_luminance(batch.mean), batch.samples)
    return tiles.samples()


def _keeping(pairs: Iterator[Pair], kept: list[Pair], count: int) -> Iterator[Pair]:
    """The pairs as they come; the first `count` stay in `kept`, for all of them would take a quarter of a gigabyte."""
    for pair in pairs:
        if len(kept) < count:
            kept.append(pair)
        yield pair


def _subset(comparisons: int) -> int:
    return max(1, comparisons // POWER_SHARE)
