"""Factors of bounces: an image as a sum of the reference's light by the number of its bounces, each times a factor.

1, 1, 1, … is right; 2^-k, π^k, or a last one missing are read off, for any scene and without knowing a shader.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from harness.diagnosis.causes.match import ROUNDING, Fit, Seen, fit, loglik
from harness.diagnosis.causes.transforms import FACTORS, PRICE
from harness.estimators.base import Estimator, Renderer
from harness.estimators.mitsuba import Mitsuba
from harness.progress import Advance
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.store import Store
from harness.scene import SceneFile

# Layers that are told apart; the deeper ones are one. A bounce has a tenth of the light of the one before, or a third.
LAYERS = 5
# Batches, and samples per pixel of each.
BATCHES, SPP = 8, 64
# Iterations until the weights, which depend on the factors, stand still.
ITERATIONS = 6


@dataclass(frozen=True, eq=False)
class Layers:
    """The reference's light by bounces: that seen directly, after one scattering, …, the rest, and last what longer
    paths than the scene allows would add. `depths`: the greatest number of vertices in each but the last."""

    light: tuple[Estimate, ...]
    depths: tuple[int, ...]


@dataclass(frozen=True)
class Factors:
    """What each layer of light is multiplied by, with standard errors; `fit` of the whole; NaN for a layer without
    light. `says`: what the factors are, as it goes on after "ours with"; `reading`: how well just that fits, `picture`:
    as what it was compared.
    """

    values: tuple[float, ...]
    errors: tuple[float, ...]
    fit: Fit
    says: str = ""
    reading: Fit | None = None
    picture: Seen | None = field(default=None, repr=False, compare=False)


def layers(scene: SceneFile, *, estimator: Estimator | None = None, store: Store | None = None, spp: int = SPP,
           advance: Advance = lambda n: None) -> Layers:
    """The light of each number of bounces: differences of images of increasing depth, which share their paths.

    `estimator`: Mitsuba unless given; any of which a replica of one depth begins with the paths of a smaller one.
    HarnessError where it takes no depth.
    """
    truth = estimator or Mitsuba()
    depth = scene.depth or LAYERS + 2
    cuts = [*range(1, min(depth, LAYERS)), depth, depth + 1]
    images: list[list[Batch]] = []
    for cut in cuts:
        with truth.open(scene.at_depth(cut)) as renderer:
            identity = dict(renderer.identity)

            images.append([_batch(renderer, identity, replica, spp, store) for replica in range(BATCHES)])
        advance(1.0 / len(cuts))
    light = [merge(images[0])]
    for less, more in itertools.pairwise(images):
        light.append(merge(Batch(b.mean.astype(np.float64) - a.mean, b.samples)
                           for a, b in zip(less, more, strict=True)))
    return Layers(tuple(light), tuple(cuts[:-1]))


def factors(found: Seen, of: Layers) -> Factors:
    """The factors of each layer by least squares, the noise of found and layers both weighed, and what they are.

    Noise of the layers, taken for none, would pull factors towards zero: its part of the normal equations is taken off
    (Fuller 1987, "Measurement Error Models", section 2.2).
    """
    light = [Seen.of(layer) for layer in of.light]
    lit = [index for index, layer in enumerate(light) if _has_light(layer)]
    mean = np.stack([light[index].mean for index in lit])
    noise = np.stack([light[index].variance for index in lit])
    solutions = [_solved(found, mean, noise, corrected=corrected) for corrected in (True, False)]
    whole_of = [_sum(light, _spread(values, lit, len(light), 0.0)) for values, _ in solutions]
    # Layers of the same paths err together, which the correction does not know: what fits better is taken.
    best = max(range(len(solutions)), key=lambda index: loglik(found, whole_of[index]))
    found_factors, normal = solutions[best]
    # Channels see the same paths: three of them tell little more than one.
    errors = np.sqrt(3.0 * np.diag(np.linalg.pinv(normal)))
    values, spread = (_spread(numbers, lit, len(light), np.nan) for numbers in (found_factors, errors))
    whole = fit(found, whole_of[best])
    says, reading, picture = _read(found, light, values)
    return Factors(tuple(map(float, values)), tuple(map(float, spread)), whole, says, reading, picture)


def _solved(found: Seen, mean: np.ndarray, noise: np.ndarray, *, corrected: bool) -> tuple[np.ndarray, np.ndarray]:
    """The factors of layers (K, H, W, 3), and the matrix of the normal equations, (K, K)."""
    values = np.ones(len(mean))
    normal = np.eye(len(mean))
    for _ in range(ITERATIONS):
        weight = 1.0 / (found.variance + np.tensordot(values**2, noise, 1) + (ROUNDING * found.mean) ** 2 + 1e-12)
        normal = np.einsum("ahwc,bhwc,hwc->ab", mean, mean, weight)
        taken = np.diag(np.einsum("ahwc,hwc->a", noise, weight)) if corrected else 0.0
        right = np.einsum("ahwc,hwc,hwc->a", mean, found.mean, weight)
        values = np.linalg.lstsq(normal - taken, right, rcond=1e-10)[0]
    return values, normal


def _spread(numbers: np.ndarray, lit: list[int], count: int, otherwise: float) -> np.ndarray:
    """Numbers of the layers that have light, among all."""
    whole = np.full(count, otherwise)
    whole[lit] = numbers
    return whole


def _batch(renderer: Renderer, identity: dict[str, str], replica: int, spp: int, store: Store | None) -> Batch:
    def render() -> Batch:
        return renderer.render_batch(replica, 0, spp)

    return store.get_or_render(identity, replica, 0, spp, render) if store else render()


def _has_light(layer: Seen) -> bool:
    total, noise = float(layer.mean.sum()), math.sqrt(float(layer.variance.sum()))
    return total > 4 * noise


def _sum(light: list[Seen], values: np.ndarray) -> Seen:
    mean = sum((f * layer.mean for f, layer in zip(values, light, strict=True)), start=np.zeros_like(light[0].mean))
    variance = sum((f**2 * layer.variance for f, layer in zip(values, light, strict=True)),
                   start=np.zeros_like(light[0].variance))
    return Seen(mean, variance, 1.0, light[0].dof)


def _read(found: Seen, light: list[Seen], values: np.ndarray) -> tuple[str, Fit | None, Seen | None]:
    """The rule of factors that fits best, if any fits; the price of what is fitted taken off."""
    best: tuple[float, str, Fit | None, Seen | None] = (-math.inf, "", None, None)
    for says, rule, price in _rules(values):
        picture = _sum(light, rule)
        result = fit(found, picture)
        if result.same and result.loglik - price > best[0]:
            best = result.loglik - price, says, result, picture
    return best[1:]


def _rules(values: np.ndarray) -> Iterator[tuple[str, np.ndarray, float]]:
    """Rules that factors may follow: in words, the factors, the price of their parameters."""
    count = len(values)
    bounce = np.arange(count, dtype=np.float64)
    within = np.ones(count)
    within[-1] = 0.0
    yield "every bounce as it is", within, 0.0
    for kept in range(1, count - 1):
        cut = np.where(bounce < kept, 1.0, 0.0)
        yield f"no light after {_times(kept)}", cut, PRICE
    yield "one bounce more than the scene allows", np.ones(count), PRICE
    ratios = [(name, value, PRICE) for name, value in FACTORS.items()]
    known = values[:-1][np.isfinite(values[:-1])]
    if len(known) > 1 and known[0] > 0 and known[1] > 0:
        ratios.append((f"{known[1] / known[0]:.3g}", float(known[1] / known[0]), 2 * PRICE))
    for name, ratio, price in ratios:
        yield f"every bounce multiplied by {name}", within * ratio**bounce, price
        yield f"all light after a bounce multiplied by {name}", within * np.where(bounce > 0, ratio, 1.0), price
        yield f"all light seen directly multiplied by {name}", within * np.where(bounce > 0, 1.0, ratio), price
        yield f"all light multiplied by {name}", within * ratio, price
    yield "no light seen directly", within * np.where(bounce > 0, 1.0, 0.0), PRICE


def _times(vertices: int) -> str:
    return {1: "what is seen directly", 2: "one bounce", 3: "two bounces", 4: "three bounces"}.get(
        vertices, f"{vertices - 1} bounces")
