"""Correct variants of the shader: they change pixels, and no gate accuses them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.gates import Gate, References, load_gates, run_gate
from harness.mutants.variants import Variant, load_variants

VARIANTS = load_variants()
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
