"""Coupled gates: the tracer held against Mitsuba on its own paths, and what they see that others do not."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.gates import Gate, load_gates, run_gate
from harness.gates.artefacts import AUTOPSY, record, save_result
from harness.gates.records import as_json, from_json
from harness.shader.library import OURS
from harness.stats.paired import COUPLED

GATES = """
[defaults]
tolerance = { mean = 0.002, coarse = 0.0125, fine = 0.05 }

[coupled]
size = [32, 24]
spp = 64
replicas = 64
reference = { coupled = true }
tolerance = { coarse = 0.004, fine = 0.15 }

[[gate]]
name = "diffuse"
scene = "diffuse"
strategy = "cosine"
reference = { coupled = true }
reason = "Albedo alone."
"""


def gate(folder: Path, gates: str = GATES, **changes: object) -> Gate:
    (folder / "gates.toml").write_text(gates, encoding="utf-8")
    found, = load_gates(folder / "gates.toml").gates
    return dataclasses.replace(found, **changes)  # type: ignore[arg-type]


def wrong(old: str, new: str, file: str = "lib/phong.glsl") -> Tracer:
    return Tracer("cosine", OURS.with_line(file, old, new))


class TestReading:
    """What a gates file says."""

    def test_defaults_are_those_of_coupled_gates(self, tmp_path: Path) -> None:
        found = gate(tmp_path)
        assert (found.reference, found.reference_spp, found.agreement) == (Coupled("cosine"), 64, 0.002)
        assert found.tolerance == dataclasses.replace(COUPLED, coarse=0.004, fine=0.15)

    @pytest.mark.parametrize(("old", "new", "message"), [
        ("coupled = true }\nreason", "coupled = 1 }\nreason", r":16: expected true, found 1"),
        ('strategy = "cosine"', 'command = "myrt {scene} {seed} {spp} {out}"',
         r"16: only our tracer's paths can be followed, and what is judged is myrt; hold it against reference"),
        ('strategy = "cosine"', 'strategy = "cosine"\nshader = "own.frag"',
         r"16: .*own\.frag traces paths of its own .* cannot be followed; hold it against reference = \{ spp"),
        ("coarse = 0.004,", "mean = 1e-8, coarse = 0.004,", r"10: a coupled tolerance of 1e-08 \(mean\) lies"),
        ("reference = { coupled = true }\nreason", "agreement = 0.1\nreason", r":16: 'agreement' is of gates with"),
        ('scene = "diffuse"', 'scene = "glass.xml"', r"glass\.xml:\d+: .*dielectric"),
    ])
    def test_what_cannot_be_followed_is_refused_in_one_line(self, tmp_path: Path, old: str, new: str,
                                                            message: str) -> None:
        assert old in GATES
        (tmp_path / "own.frag").write_text("void main() {}", encoding="utf-8")
        scene = Coupled.__module__ and gate(tmp_path).scene.path.read_text(encoding="utf-8")
        (tmp_path / "glass.xml").write_text(scene.replace('type="diffuse"', 'type="dielectric"'), encoding="utf-8")
        with pytest.raises(HarnessError, match=message) as caught:
            run_gate(gate(tmp_path, GATES.replace(old, new)))
        assert "\n" not in str(caught.value)


class TestVerdicts:
    """What they make of right and wrong shaders."""

    def test_a_right_shader_passes_at_tolerances_of_a_hundred_thousandth(self, tmp_path: Path) -> None:
        result = run_gate(gate(tmp_path))
        assert result.outcome == "pass"
        assert result.gate.tolerance.mean == 2e-5
        assert result.agreement is not None and result.agreement.differing == 0
        assert all(abs(point.error) < 2e-6 for point in result.curve[1:])  # one replica has no interval
        assert result.smallest_detectable["mean"] < 1e-4

    def test_an_albedo_one_ten_thousandth_too_high_fails_and_is_named(self, tmp_path: Path) -> None:
        """By its mean: 1e-4 of a sample is too little for the agreement. The autopsy names file and line."""
        result = run_gate(gate(tmp_path, test=wrong("return m.kd;", "return m.kd * 1.0001;")))
        assert result.outcome == "fail"
        assert result.agreement is not None and result.agreement.outcome == "pass"
        assert result.verdict.luminance[0] == pytest.approx(6.6e-5, rel=0.3)
        assert "the first stage that differs is 'weight', computed by sample_phong" in result.reason
        save_result(result, tmp_path / "out")
        assert "FIRST DIFFERENCE: weight" in (tmp_path / "out" / AUTOPSY).read_text(encoding="utf-8")
        there_and_back = from_json(json.loads(json.dumps(as_json(record(result)))))
        assert there_and_back == record(result)
        assert there_and_back.numbers is not None and there_and_back.numbers.agreement is not None

    def test_an_azimuth_a_thousandth_short_fails_by_its_samples(self, tmp_path: Path) -> None:
        """Of the mean little is lost, but every other sample is another."""
        result = run_gate(gate(tmp_path, test=wrong("float phi = 2.0 * PI * u;", "float phi = 1.998 * PI * u;",
                                                    "lib/sampling.glsl")), ladder=False)
        assert result.outcome == "fail" and "samples" in result.reason
        assert result.agreement is not None and result.agreement.outcome == "fail"
        assert result.autopsy is None

    def test_numbers_in_another_order_are_told_as_such(self, tmp_path: Path) -> None:
        """Right in the mean, but no path is followed."""
        swapped = wrong("l = sample_cosine(n, rand2());", "l = sample_cosine(n, rand2().yx);")
        result = run_gate(gate(tmp_path, test=swapped), ladder=False)
        assert result.outcome == "fail"
        assert "paths do not follow, as where the shader draws numbers of its own, or in another order" in result.reason

    def test_a_budget_too_small_for_its_tolerance_is_refused_after_the_first_look(self, tmp_path: Path) -> None:
        with pytest.raises(HarnessError, match=r"gates\.toml:\d+: gate 'diffuse': a budget of 64 replicas of 1 samples "
                                               r"per pixel is too small .* about [\d.]+ times the samples would do"):
            run_gate(gate(tmp_path, GATES.replace("spp = 64", "spp = 1")))

    def test_a_tight_one_has_a_quarter_of_the_tolerances_and_four_times_the_samples(self, tmp_path: Path) -> None:
        loose = gate(tmp_path)
        tight = loose.tightened()
        assert tight.tolerance.sizes == tuple(allowed / 4 for allowed in loose.tolerance.sizes)
        assert (tight.spp, tight.reference_spp, tight.replicas) == (256, 256, 64)
