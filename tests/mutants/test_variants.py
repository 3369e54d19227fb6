"""Correct variants of the shader: they change pixels, and no gate accuses them."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.gates import Gate, References, load_gates, run_gate
from harness.mutants.variants import Variant, load_variants
from harness.scene.lights import lights_sampled
from harness.shader.library import OURS
from tests.support.lamps import KD, assert_mean, by_a_wall, lamps, measured, of_lamps

VARIANTS = tuple(variant for variant in load_variants() if variant.topic != "lights")
FAMILY = load_gates(Path(__file__).parents[1] / "gates.toml")
# Where roulette is played most, and where numbers choose between terms; with half of the samples, which fail what
# is wrong by a per cent of the mean as surely.
GATES = [replace(gate, spp=gate.spp // 2, reference_spp=-(-gate.reference_spp // 2))
         for gate in FAMILY.select(["white-room", "furnace-phong-mixture", "grazing-mixture"])]


@pytest.fixture(scope="module")
def references() -> References:
    return References()


@pytest.mark.parametrize("gate", GATES, ids=lambda gate: gate.name)
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.id)
def test_no_gate_accuses_one(variant: Variant, gate: Gate, references: References) -> None:
    """Noise that pixels share may leave one undecided, which is no accusation."""
    assert isinstance(gate.test, Tracer)
    result = run_gate(replace(gate, test=replace(gate.test, library=variant.applied())), references)
    assert result.outcome != "fail", result.reason


@pytest.mark.parametrize("gate", GATES, ids=lambda gate: gate.name)
def test_a_wrong_one_is_accused(gate: Gate, references: References) -> None:
    """Or it would prove nothing that none is: paths are a per cent too bright."""
    assert isinstance(gate.test, Tracer)
    wrong = gate.test.library.with_line("lib/path.glsl", "throughput = vec3(1.0);", "throughput = vec3(1.01);")
    result = run_gate(replace(gate, test=replace(gate.test, library=wrong)), references, ladder=False)
    assert result.outcome == "fail", result.reason


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.id)
def test_one_is_another_shader(variant: Variant) -> None:
    """Or nothing would be proved."""
    gate, = FAMILY.select(["white-room"])
    right, other = (Tracer("lobes", library=library) for library in (Tracer().library, variant.applied()))
    images = []
    for test in (right, other):
        with test.open(gate.scene.sized(8, 8).at_depth(6)) as renderer:
            images.append(renderer.render_batch(0, 0, 4).mean)
    texts = [test.source(gate.scene).text for test in (right, other)]
    assert texts[0] != texts[1]
    assert variant.id != "roulette" or not np.array_equal(*images)


# Those of what samples lights, on scenes that have some: many of them; and one that a path meets at its second bounce.
LIGHTS = tuple(variant for variant in load_variants() if variant.topic == "lights")
LIT = {"nee": (lamps, "nee", 4096, 6e-3), "mis": (lamps, "mis", 4096, 8e-3), "wall": (by_a_wall, "mis", 2048, 3e-2)}
# What draws as ours does and finds the same by other means.
SAME_BITS = {"shadow-ray-up-to-the-light", "nee-goes-on"}


@functools.cache
def ours(case: str) -> np.ndarray:
    make, strategy, samples, _ = LIT[case]
    return measured(make()[0], strategy, samples, OURS)


@pytest.mark.parametrize("variant", LIGHTS, ids=lambda variant: variant.id)
def test_another_way_to_sample_lights_finds_as_much(variant: Variant) -> None:
    """The irradiance by quadrature, although pixels are others than ours."""
    changed = set()
    for case, (make, strategy, samples, noise) in LIT.items():
        scene, received = make()
        assert variant.applied().tracer(scene, strategy).text != OURS.tracer(scene, strategy).text
        found = measured(scene, strategy, samples, variant.applied())
        assert_mean(found, of_lamps(KD / np.pi * received), noise)
        changed |= set() if np.array_equal(found, ours(case)) else {case}
    assert bool(changed) == (variant.id not in SAME_BITS)


def test_at_least_ten_sample_lights_otherwise() -> None:
    assert len(LIGHTS) >= 10


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_lights_may_be_chosen_evenly(strategy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any chances are right that are told: here all are alike."""
    monkeypatch.setattr("harness.scene.lights.LEAST_SHARE", 1.0)
    scene, received = lamps()
    chances = {light.chance for light in lights_sampled(scene, strategy)}
    assert max(chances) == pytest.approx(min(chances))
    assert_mean(measured(scene, strategy, 4096, OURS), of_lamps(KD / np.pi * received), 1e-2)


@pytest.mark.parametrize("case", ["nee", "mis"])
def test_a_wrong_way_to_sample_lights_is_accused(case: str) -> None:
    """What lights send is two per cent too bright."""
    make, strategy, samples, noise = LIT[case]
    scene, received = make()
    wrong = OURS.with_line("lib/path.glsl", "ray.weight *= throughput;", "ray.weight *= 1.02 * throughput;")
    with pytest.raises(AssertionError, match="standard errors"):
        assert_mean(measured(scene, strategy, samples, wrong), of_lamps(KD / np.pi * received), noise)


def test_malformed_entries_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('\n[[variant]]\nid = "a"\nwhy = "b"\n')
    with pytest.raises(HarnessError, match=r"a\.toml:2: a variant needs 'id', 'why' and .* \('exchange'\)"):
        load_variants(tmp_path)


def test_one_that_no_longer_applies_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('[[variant]]\nid = "a"\nwhy = "b"\n[[variant.exchange]]\nfile = "lib/path.glsl"\n'
                                     'line = "gone;"\nreplacement = "come;"\n')
    variant, = load_variants(tmp_path)
    with pytest.raises(HarnessError, match=r"a\.toml:1: variant 'a' does not apply: its line is not in lib/path"):
        variant.applied()
