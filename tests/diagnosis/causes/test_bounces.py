"""Factors of bounces, on layers that are known, and on those of a scene."""

from __future__ import annotations

import numpy as np
import pytest

from harness.diagnosis.causes.bounces import Layers, factors, layers
from harness.diagnosis.causes.match import Seen
from harness.estimators.tracer import Tracer
from harness.samples.estimate import Batch, Estimate, merge
from harness.scene import SceneFile

RNG = np.random.default_rng(7)
LIGHT = [0.5 ** k * RNG.uniform(0.2, 1.0, (12, 16, 3)) for k in range(5)]  # the last: of paths longer than allowed


def noisy(image: np.ndarray, seed: int, noise: float = 0.01) -> Estimate:
    rng = np.random.default_rng(seed)
    return merge(Batch(image + noise * np.sqrt(8) * rng.normal(size=image.shape), 16) for _ in range(8))


@pytest.fixture(scope="module")
def known() -> Layers:
    return Layers(tuple(noisy(light, k, 0.002) for k, light in enumerate(LIGHT)), (1, 2, 3, 8))


@pytest.mark.parametrize(("rule", "says"), [
    ([1, 1, 1, 1, 0], "every bounce as it is"),
    ([1, 0.5, 0.25, 0.125, 0], "every bounce multiplied by 1/2"),
    ([1, np.pi, np.pi**2, np.pi**3, 0], "every bounce multiplied by π"),
    ([1, 0.7, 0.49, 0.343, 0], "every bounce multiplied by 0."),
    ([1, 1, 0, 0, 0], "no light after one bounce"),
    ([1, 1, 1, 1, 1], "one bounce more than the scene allows"),
    ([0, 1, 1, 1, 0], "no light seen directly"),
    ([1, 2, 2, 2, 0], "all light after a bounce multiplied by 2"),
])
def test_reads_the_rule(known: Layers, rule: list[float], says: str) -> None:
    image = sum(factor * light for factor, light in zip(rule, LIGHT, strict=True))
    found = factors(Seen.of(noisy(np.asarray(image), 11)), known)
    assert found.says.startswith(says)
    assert found.fit.same
    assert np.all(np.abs(np.subtract(found.values, rule)) < 6 * np.array(found.errors))
    assert max(found.errors) < 0.1 * max(rule)


def test_says_that_none_explains_what_depends_on_directions(known: Layers) -> None:
    image = LIGHT[0] + LIGHT[1] * np.linspace(0.2, 1.8, 16)[None, :, None]
    found = factors(Seen.of(noisy(image, 12)), known)
    assert found.says == ""
    assert not found.fit.same


def test_layers_are_differences_of_depth_that_share_their_paths() -> None:
    scene = SceneFile.bundled("furnace_convex", (12, 8))
    found = layers(scene, estimator=Tracer("cosine"), spp=4)
    assert len(found.light) == len(found.depths) + 1
    with Tracer("cosine").open(scene) as renderer:
        whole = merge(renderer.render_batch(replica, 0, 4) for replica in range(8))
    total = sum(layer.mean for layer in found.light[:-1])
    assert total == pytest.approx(whole.mean, rel=1e-5)
