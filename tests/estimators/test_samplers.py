"""The tracer with a sampler of its own: what may be said of its batches, and what may not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.gpu import pingpong
from harness.samples.estimate import Accumulator
from harness.scene import SceneFile
from harness.shader.samplers import SAMPLERS, sampler_named
from harness.work.batches import equal_batches, render_estimate

SOBOL = Tracer("cosine", sampler="sobol")
FURNACE = SceneFile.bundled("furnace_convex", (24, 18))


def test_names_and_keys_tell_the_samplers_apart() -> None:
    assert (Tracer("cosine").name, SOBOL.name, Coupled("cosine", "sobol").name) == (
        "cosine", "cosine sobol", "coupled cosine sobol")
    with Tracer("cosine").open(FURNACE) as usual, SOBOL.open(FURNACE) as spread:
        assert usual.identity != spread.identity
        assert "sampler" not in usual.identity, "batches that are stored stay what they are"
        assert (usual.traits.independent_batches, spread.traits.independent_batches) == (True, False)


@pytest.mark.parametrize("name", SAMPLERS)
def test_only_batches_that_depend_on_each_other_fall_faster(name: str) -> None:
    sampler = sampler_named(name)
    assert sampler.independent_batches == (set(sampler.slopes) == {-0.5})


def test_an_unknown_sampler_is_refused() -> None:
    with pytest.raises(HarnessError, match=r"^unknown sampler 'halton'; choose from independent, sobol$"):
        Tracer(sampler="halton").check(FURNACE)


def test_one_generator_at_a_time(tmp_path: Path) -> None:
    """Somebody's own random numbers, and a sampler that would stand in for them."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "random.glsl").write_text("float rand()\n{\n    return 0.5;\n}\n", encoding="utf-8")
    with pytest.raises(HarnessError, match=r"random\.glsl' draws the random numbers, and the sampler 'sobol' would"):
        Tracer(folder=tmp_path, sampler="sobol").whole_library()


def test_samples_do_not_depend_on_how_they_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """Into passes, and into batches: sample number k is the same one in each, bit for bit."""
    with SOBOL.open(FURNACE) as renderer:
        whole = renderer.render_batch(2, 5, 24).mean
        singles = [renderer.render_batch(2, 5 + k, 1).mean for k in range(24)]
    monkeypatch.setattr(pingpong, "MAX_SAMPLES_PER_PASS", 7)
    with SOBOL.open(FURNACE) as renderer:
        np.testing.assert_array_equal(renderer.render_batch(2, 5, 24).mean, whole)
    total = np.zeros_like(whole)
    for single in singles:  # as the shader adds them up, in float32
        total += single
    np.testing.assert_array_equal((total.astype(np.float64) / 24).astype(np.float32), whole)


def ratio(sampler: str) -> float:
    """What batch means say that the variance of a replica's image is, over what it is between replicas."""
    images, told = Accumulator(), []
    with Tracer("cosine", sampler=sampler).open(FURNACE) as renderer:
        for replica in range(24):
            one = Accumulator()
            for start in range(0, 64, 8):
                one.add(renderer.render_batch(replica, start, 8))
            told.append(one.estimate().variance.mean())
            images.add(renderer.render_batch(replica, 0, 64))
    return float(np.mean(told) / (images.estimate().variance.mean() * images.batches))


def test_batch_means_would_be_wrong_of_samples_that_are_spread_evenly() -> None:
    """They take the noise for what it would be if batches were independent: right of independent samples, several
    times too much of Sobol's, whose batches make up for each other's errors. Replicas tell both."""
    assert ratio("independent") == pytest.approx(1, abs=0.15)
    assert ratio("sobol") > 2


def test_nothing_is_told_of_the_noise_of_one_replica() -> None:
    """One replica is one batch, whatever it was drawn in; replicas together know their variance."""
    with SOBOL.open(FURNACE) as renderer:
        alone = render_estimate(renderer, 64)
        assert alone.batches == 1
        assert np.isnan(alone.variance).all()
        np.testing.assert_allclose(alone.mean, renderer.render_batch(0, 0, 64).mean, rtol=1e-6)
        parts = [renderer.render_batch(0, start, 8) for start in range(0, 64, 8)]
    assert len(list(equal_batches(parts, 64, independent=False))) == 1
    assert len(list(equal_batches(parts, 64))) == 8


def test_no_path_is_begun_beside_another() -> None:
    """The loop keeps one word of the generator's while it makes the next ray ready; this sampler has two."""
    assert "#define STARTS_AHEAD 0\n" in SOBOL.source(FURNACE).text
    assert "STARTS_AHEAD 0\n" not in Tracer("cosine").source(FURNACE).text.partition("#line")[0]
