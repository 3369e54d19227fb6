"""Running gates: when they stop, what they say, that a pass means something, and whose shader is tested."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, ShaderError
from harness.estimators.tracer import Tracer
from harness.gates import Gate, run_gate
from harness.gates.runner import opened
from harness.samples.estimate import Batch
from harness.scene import SceneFile
from harness.shader.source import ShaderSource
from harness.work.run import Run
from tests.support.fakes import NoiseRenderer
from tests.support.gates import GATES, SKY, Noise, judging, one_gate, with_own


@pytest.fixture
def gate(tmp_path: Path) -> Gate:
    return one_gate(tmp_path)


class TestOutcome:
    """pass, fail, inconclusive."""

    def test_a_right_render_passes_at_the_first_look(self, gate: Gate) -> None:
        result = run_gate(judging(gate, Noise()))
        assert (result.outcome, len(result.looks)) == ("pass", 1)
        assert result.test.samples == 16

    @pytest.mark.parametrize("bias", [0.01, -0.01])
    def test_a_bias_of_several_tolerances_fails_at_the_first_look(self, gate: Gate, bias: float) -> None:
        result = run_gate(judging(gate, Noise(bias)))
        assert (result.outcome, len(result.looks)) == ("fail", 1)
        assert result.verdict.mean.error == pytest.approx(bias, rel=0.05)

    def test_a_bias_of_one_tolerance_never_passes(self, gate: Gate) -> None:
        """Neither fails nor passes: it lies on the edge, so all of the budget is drawn."""
        result = run_gate(judging(gate, Noise(gate.tolerance.mean)))
        assert (result.outcome, len(result.looks)) == ("inconclusive", 3)
        assert result.test.samples == 64
        assert "the budget of 64 x 1 samples per pixel has ended" in result.reason

    def test_looks_share_the_error_rates(self, gate: Gate) -> None:
        looks = run_gate(judging(gate, Noise(gate.tolerance.mean))).looks
        assert sum(look.verdict.mean.pass_level for look in looks) == pytest.approx(gate.pass_level)
        assert sum(look.verdict.mean.fail_level for look in looks) == pytest.approx(gate.fail_level / 3, rel=0.01)

    def test_samples_that_are_not_finite_fail_unless_allowed(self, gate: Gate) -> None:
        class Rejecting(NoiseRenderer):
            def render_batch(self, *arguments: object, **options: object) -> Batch:  # type: ignore[override]
                return dataclasses.replace(super().render_batch(*arguments, **options), rejected=1)  # type: ignore

        rejecting = judging(gate, Rejecting(0.5, 0.01, (40, 40)))
        result = run_gate(rejecting)
        assert (result.outcome, result.verdict.outcome) == ("fail", "pass")
        assert result.reason.startswith("16 of 25600 samples were not finite, or not counted in alpha; look for a")
        assert run_gate(dataclasses.replace(rejecting, not_finite=1 / 1600)).outcome == "pass"

    def test_a_local_error_fails_although_the_mean_is_right(self, gate: Gate) -> None:
        class Patched(NoiseRenderer):
            def render_batch(self, *arguments: object, **options: object) -> Batch:  # type: ignore[override]
                batch = super().render_batch(*arguments, **options)  # type: ignore[arg-type]
                batch.mean[8:12, 20:24] *= 1.2
                batch.mean[30:34, 4:8] *= 0.8
                return batch

        result = run_gate(judging(gate, Patched(0.5, 0.01, (40, 40))))
        assert (result.outcome, result.verdict.mean.outcome) == ("fail", "pass")
        tile = result.verdict.fine.tile
        row, column = (tile * position for position in result.verdict.fine.worst)
        assert (8 <= row < 12 and 20 <= column < 24) or (30 <= row < 34 and 4 <= column < 8)


class TestBudget:
    """Looks, and budgets that cannot decide."""

    def test_more_noise_takes_more_looks(self, gate: Gate) -> None:
        assert [len(run_gate(judging(gate, Noise(sigma=sigma))).looks) for sigma in (0.01, 0.03, 0.05)] == [1, 2, 3]

    def test_that_is_hopeless_is_refused_after_the_first_look(self, gate: Gate) -> None:
        """The message's number of samples is what a run then needs."""
        noise = Noise(sigma=1.0)
        with pytest.raises(HarnessError) as caught:
            run_gate(judging(gate, noise))
        assert len(noise.made[0].calls) == 16
        message = str(caught.value)
        assert message.startswith(f"{gate.origin}: gate 'sky': a budget of 64 replicas of 1 samples per pixel is too "
                                  "small to decide; about ")
        factor = float(message.split("about ")[1].split(" times")[0])
        larger = dataclasses.replace(gate, spp=round(gate.spp * factor))
        assert run_gate(judging(larger, Noise(sigma=1.0))).outcome == "pass"

    def test_that_is_hopeless_does_not_hide_a_gross_error(self, gate: Gate) -> None:
        assert run_gate(judging(gate, Noise(bias=0.5, sigma=0.3))).outcome == "fail"

    def test_that_errs_is_judged_without_regard_to_the_error(self, gate: Gate) -> None:
        """A bias within what is left open after the first look is no reason to refuse the budget."""
        result = run_gate(judging(gate, Noise(gate.tolerance.mean, sigma=0.05)))
        assert len(result.looks) == 3

    def test_each_replica_is_drawn_once(self, gate: Gate) -> None:
        noise = Noise(gate.tolerance.mean)
        run_gate(judging(gate, noise))
        assert noise.made[0].calls == [(replica, 0, 1) for replica in range(64)]

    def test_curves_begin_with_one_replica_and_end_with_all(self, gate: Gate) -> None:
        result = run_gate(judging(gate, Noise(0.01)))
        assert [point.samples for point in result.curve] == [1, 2, 4, 8, 16]
        assert np.isnan(result.curve[0].low)
        assert result.curve[-1].low < result.curve[-1].error < result.curve[-1].high
        assert result.curve[-1].error == pytest.approx(0.01, rel=0.05)

    def test_the_smallest_detectable_bias_exceeds_the_tolerance(self, gate: Gate) -> None:
        found = run_gate(judging(gate, Noise())).smallest_detectable
        for name, value in found.items():
            assert value > getattr(gate.tolerance, name)
        assert found["mean"] < found["coarse"] < found["fine"]


class TestShader:
    """The gate's own shader in place of ours."""

    def test_is_ours_without_more(self, gate: Gate) -> None:
        names = [name for name, _ in source(gate).files]
        assert names[0] == "path_tracer.frag"
        assert "lib/path.glsl" in names

    def test_files_in_a_folder_stand_in_for_those_of_the_same_name(self, gate: Gate, tmp_path: Path) -> None:
        """Whatever else lies there, and with the byte-order mark of editors on Windows left out."""
        own = own_file(tmp_path, "lib/path.glsl", "\ufeff// mine\n".encode())
        (tmp_path / "own" / "notes.txt").write_bytes(b"\xff")
        (tmp_path / "own" / "lib" / "._path.glsl").write_bytes(b"\xff")  # macOS leaves such beside files on a stick
        assert (str(own), "// mine\n") in source(with_own(gate, folder=tmp_path / "own")).files

    def test_files_of_our_own_that_the_scene_does_not_need_may_be_there(self, gate: Gate, tmp_path: Path) -> None:
        own_file(tmp_path, "lib/displaced.glsl", b"// mine\n")
        assert "// mine\n" not in dict(source(with_own(gate, folder=tmp_path / "own")).files).values()

    @pytest.mark.parametrize(("name", "message"), [
        ("phong.glsl", "'{own}/phong.glsl' stands in for nothing and nothing includes it; to stand in for the "
                       "harness's lib/phong.glsl it must be '{own}/lib/phong.glsl'"),
        ("lib/fong.glsl", "'{own}/lib/fong.glsl' stands in for nothing and nothing includes it; give it the name of a "
                          "file of the harness's glsl folder, include it, or take it away"),
        ("lib/phong.glsl.txt", "the folder '{own}' holds no .glsl and no .frag file; put lib/phong.glsl, for example, "
                               "into it"),
        ("scene.glsl", "'{own}/scene.glsl' cannot stand in for scene.glsl, which is written from the scene; give it "
                       "another name, or take it away")])
    def test_one_that_would_not_be_tested_is_refused(
        self, gate: Gate, tmp_path: Path, name: str, message: str,
    ) -> None:
        """Or the gate would pass with the harness's own in its place."""
        own_file(tmp_path, name, b"// mine\n")
        with pytest.raises(HarnessError) as caught, opened(with_own(gate, folder=tmp_path / "own")):
            pass
        assert str(caught.value) == f"{gate.origin}: gate 'sky': {message.format(own=tmp_path / 'own')}"

    def test_two_for_one_place_are_refused(self, gate: Gate, tmp_path: Path) -> None:
        main = own_file(tmp_path, "path_tracer.frag", b"// mine\n")
        both = with_own(gate, folder=tmp_path / "own", shader=main)
        with pytest.raises(HarnessError, match=r"both stand in for path_tracer\.frag; take one away"), opened(both):
            pass

    def test_a_whole_shader_is_rendered(self, gate: Gate, tmp_path: Path) -> None:
        """A shader that shows half of a right radiance: a fail of -50 %, and one that is right passes."""
        body = """uniform sampler2D pingpong0; uniform int numpass; uniform int samples_per_pass; in vec2 texcoord;
            layout(location = 0) out vec4 sum;
            void main() {
                vec4 before = numpass > 0 ? texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0) : vec4(0.0);
                sum = before + float(samples_per_pass) * vec4(RADIANCE);
            }"""
        for radiance, outcome in (("0.25, 0.25, 0.25, 1.0", "fail"), ("0.5, 0.5, 0.5, 1.0", "pass")):
            (tmp_path / "own.frag").write_text(body.replace("RADIANCE", radiance))
            result = run_gate(with_own(gate, shader=tmp_path / "own.frag"))
            assert result.outcome == outcome
        assert run_gate(gate).outcome == "pass"

    @pytest.mark.parametrize(("text", "message"), [
        (b"void main()\n{ undeclared = 1; }\n", ":2: "),
        (b"// fine\n// B\xfcro\n", ":2: not UTF-8 text; save the file in the encoding UTF-8"),
        (b" \n", ":1: the file is empty; all functions of the file that it stands in for must be in it"),
        (b"// mine\n#version 330\n", ":2: '#version 330'; the harness begins the shader with"),
        (b"\n#include \"lib/fong.glsl\"\n", ":2: no such shader file \"lib/fong.glsl\""),
        (b"\n\n#error mine\n", ":3: #error mine; in the line `#error mine`")])
    def test_one_that_is_no_shader_is_refused_with_its_path_and_line(
        self, gate: Gate, tmp_path: Path, text: bytes, message: str,
    ) -> None:
        (tmp_path / "own.frag").write_bytes(text)
        with pytest.raises(ShaderError) as caught:
            run_gate(with_own(gate, shader=tmp_path / "own.frag"))
        assert str(caught.value).startswith(f"{tmp_path / 'own.frag'}{message}")


def source(gate: Gate) -> ShaderSource:
    """The shader that the gate judges."""
    assert isinstance(gate.test, Tracer)
    return gate.test.source(gate.scene)


def own_file(folder: Path, name: str, content: bytes) -> Path:
    """A file in the folder `own`."""
    path = folder / "own" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def test_a_strategy_that_does_not_suit_the_scene_is_refused(gate: Gate) -> None:
    spheres = dataclasses.replace(gate, test=Tracer("phong"), scene=SceneFile.bundled("spheres", (40, 40)))
    with pytest.raises(HarnessError, match="gate 'sky': strategy 'phong' does not suit the scene: lobe-only sampling"):
        run_gate(spheres)


def test_a_film_that_is_too_large_is_refused(tmp_path: Path) -> None:
    gate = one_gate(tmp_path, GATES.replace("size = [40, 40]\n", ""))
    gate.scene.path.write_text(SKY.replace('"hdrfilm">', '"hdrfilm"><integer name="width" value="2000"/>'))
    with pytest.raises(HarnessError, match="film has 2000 x 576 pixels, a gate at most 1024 a side; set 'size'"):
        run_gate(judging(gate, Noise()))


def test_a_run_grows_and_keeps_its_order() -> None:
    """The tiles of the first replicas do not depend on how many came after."""
    short, long = (Run(NoiseRenderer(size=(20, 20)), 2) for _ in range(2))
    short.grow(3)
    long.grow(2)
    long.grow(9)
    np.testing.assert_array_equal(short.tiles(3).means, long.tiles(3).means)
    assert long.estimate().samples == 18
