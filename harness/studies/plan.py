"""How much a study draws, and of which strategies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.samples.estimate import Estimate
from harness.scene import Scene, present
from harness.scene.model import is_black
from harness.scene.strategies import DRAWS, STRATEGIES, check_strategy, suitable_strategies
from harness.shader.samplers import EVEN
from harness.stats.bias import error_scale
from harness.stats.verdicts import Tolerance

# A reference of this many times the samples of one replica adds little to what is compared with it.
REFERENCE_FACTOR = 4
# Replicas that a study may add to those asked for, as a multiple of them, where its verdict needs them.
MAX_REPLICA_FACTOR = 16
# Samples that Mitsuba's reference may grow to, as a multiple of those asked for, where the verdicts need them.
MAX_REFERENCE_FACTOR = 16
# The half-width of the error's interval that a study aims at, as a part of the tolerance: an unbiased strategy whose
# standard error is a fifth of the tolerance leaves its interval inside with probability 0.997 a channel.
PRECISION = 0.4
# How often a study may add replicas, and by what part those that it has may be too few for that: the first of a
# heavy-tailed estimator see too small a variance, and others need a second look.
STAGES, ENOUGH = 3, 1.3
STUDENT = 2.0  # two-sided 95 % quantile of Student's t at about 60 degrees of freedom


@dataclass(frozen=True)
class Profile:
    """How many samples a report spends on each scene and strategy; `every_sampler`: on each strategy with each sampler,
    and not on the best alone by the one that spreads numbers evenly."""

    spp: int
    replicas: int
    reference_spp: int
    every_sampler: bool = False


PROFILES = {
    "quick": Profile(spp=64, replicas=8, reference_spp=256),
    "full": Profile(spp=8192, replicas=12, reference_spp=65536, every_sampler=True),
}


@dataclass(frozen=True)
class Plan:
    """The settings of one study that its strategies share."""

    spp: int
    replicas: int
    max_replicas: int
    tolerance: Tolerance
    confidence: float
    fail_level: float


def exhibited_strategies(scene: Scene) -> tuple[str, ...]:
    """The strategies that a report shows: those that the scene names, else all that suit and, as a warning, lobe-only
    sampling wherever a lobe is; `nee` and `mis` where there are lights to sample, and not a sky of one radiance alone.

    HarnessError where the scene names an unknown one.
    """
    named = present(scene.file).strategies if scene.path else ()
    for name in named:
        try:
            check_strategy(scene, name)
        except HarnessError as error:
            raise HarnessError(f"{scene.path or scene.name}: integrator property 'strategies': {error}") from None
    if named:
        return named
    has_lobe = any(not is_black(shape.material.ks) for shape in scene.shapes)
    suited = suitable_strategies(scene)
    return tuple(name for name in STRATEGIES if name in suited or (name in DRAWS and has_lobe))


def exhibited(scene: Scene, profile: Profile) -> tuple[Tracer, ...]:
    """What a report shows of a scene: those strategies by the usual sampler, then by evenly spread numbers all that
    suit, where the profile has every sampler, or else one of them: `mis`, or the last that suits. Errors as above."""
    names = exhibited_strategies(scene)
    suited = [name for name in names if check_strategy(scene, name).suits]
    best = ["mis"] if "mis" in suited else suited[-1:]
    even = [Tracer(name, sampler=EVEN) for name in (suited if profile.every_sampler else best)]
    return (*map(Tracer, names), *even)


def judged(scenes: Sequence[Scene], profile: Profile) -> int:
    """How many verdicts a report on these scenes gives: one for each line that it shows and that suits."""
    return sum(check_strategy(scene, line.strategy).suits for scene in scenes for line in exhibited(scene, profile))


def replicas_needed(pilot: Estimate, reference: Estimate, replicas: int, tolerance: float) -> int:
    """How many replicas like the `replicas` of the pilot make an equivalence verdict decide, if there is no bias.

    Stein's (1945) two-stage sample size: chosen from the variance alone, never from the error; also where it is asked
    again of all that was drawn since (Chow and Robbins 1965). The intervals then take the variance of all replicas, and
    degrees of freedom that know of the first ones (`deviates.staged`). No fewer than `replicas`; without bound where
    the reference itself is too noisy.
    """
    target = (tolerance * PRECISION / STUDENT) ** 2
    scale = error_scale(reference.image_mean)
    ours, theirs = pilot.image_variance / scale**2, reference.image_variance / scale**2
    if not np.isfinite(ours).all() or not np.isfinite(theirs).all():
        return replicas
    room = target - theirs
    if (room <= 0).any():
        return 2**31
    return max(replicas, math.ceil(float((replicas * ours / room).max())))


def prefix_sizes(spp: int) -> list[int]:
    """The prefixes of a run at which curves are measured: powers of two, and the whole run."""
    powers = [2**k for k in range(int(math.log2(spp)) + 1)]
    return powers if powers[-1] == spp else [*powers, spp]
