"""The ladder of depths: where a failed gate begins to fail, told from renders that are wrong from a known depth on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from harness.estimators.tracer import Tracer
from harness.gates import Gate, load_gates, run_gate
from harness.gates.artefacts import LADDER, WRONG_DEPTH, record, save_result
from harness.gates.ladder import told
from harness.gates.records import as_json, from_json
from harness.gates.summary import write_summary
from harness.scene import SceneFile
from harness.shader.library import OURS
from tests.support.fakes import NoiseRenderer
from tests.support.gates import SKY, Noise, judging, one_gate, write


@dataclass(frozen=True)
class Deep:
    """Normal noise about a level that grows by 1 a vertex, except for the first `dark`; from depth `wrong` on it is off
    by the relative `bias`. `ghost`: what it shows where there is no light. `asked`: the depths that were opened."""

    wrong: int = 1 << 20
    bias: float = -0.02
    dark: int = 0
    sigma: float = 0.01
    ghost: float = 0.0
    name: str = "cosine"
    asked: list[int] = field(default_factory=list, compare=False)

    def check(self, scene: SceneFile) -> str:
        return ""

    def takes_depth(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
        depth, film = scene.depth or 100, scene.film
        self.asked.append(depth)
        level = max(0, depth - self.dark) * (1 + self.bias * (depth >= self.wrong))
        black = level == 0
        yield NoiseRenderer(self.ghost if black else level, 0.0 if black else self.sigma * level,
                            (film.height, film.width))


def gate_of(folder: Path, test: Deep, depth: int | None, reference: Deep | None = None) -> Gate:
    gate = one_gate(folder)
    bound = f'<integer name="max_depth" value="{depth}"/>' if depth else ""
    (folder / "sky.xml").write_text(SKY.replace('<integer name="max_depth" value="2"/>', bound), encoding="utf-8")
    return replace(gate, test=test, reference=reference or Deep(dark=test.dark, name="truth"))


class TestClimb:
    """Which depths are asked for, and what is said."""

    @pytest.mark.parametrize(("top", "wrong", "asked", "said"), [
        (6, 1, [1], "wrong from depth 1 on (light seen directly): -2"),
        (6, 3, [1, 2, 3], "right up to depth 2, wrong from 3 on (light scattered twice): -2"),
        (6, 6, [1, 2, 3, 4, 5], "right up to depth 5, wrong at 6, the scene's (light scattered 5 times)"),
        (16, 7, [1, 2, 3, 4, 6, 7, 8], "right up to depth 6, wrong from 7 on (light scattered 6 times): -2"),
        (None, 20, [1, 2, 3, 4, 8, 16, 18, 19, 20, 24, 32],
         "right up to depth 19, wrong from 20 on (light scattered 19 times): -2"),
        (None, 60, [1, 2, 3, 4, 8, 16, 32], "right up to depth 32"),
    ])
    def test_finds_the_first_wrong_depth(self, tmp_path: Path, top: int | None, wrong: int, asked: list[int],
                                         said: str) -> None:
        test = Deep(wrong)
        result = run_gate(gate_of(tmp_path, test, top))
        assert result.outcome == "fail" and result.ladder is not None
        assert [rung.depth for rung in result.ladder.rungs] == asked
        assert sorted(test.asked[1:]) == asked, "each is run once"
        assert told(result.ladder).startswith(said) and result.reason.endswith(f"; {told(result.ladder)}")

    def test_says_the_same_every_time(self, tmp_path: Path) -> None:
        gate = gate_of(tmp_path, Deep(3), 6)
        assert run_gate(gate).reason == run_gate(gate).reason

    def test_is_not_climbed_by_a_gate_that_passes_or_at_the_only_depth(self, tmp_path: Path) -> None:
        assert run_gate(gate_of(tmp_path, Deep(), 6)).ladder is None
        found = run_gate(gate_of(tmp_path, Deep(1), 1))
        assert found.ladder is not None and not found.ladder.rungs and "depth" not in found.reason

    def test_is_not_climbed_where_nobody_asks(self, tmp_path: Path) -> None:
        test = Deep(3)
        assert run_gate(gate_of(tmp_path, test, 6), ladder=False).ladder is None
        assert test.asked == [6]

    def test_black_depths_are_passed_over(self, tmp_path: Path) -> None:
        """There is no mean that an error could be relative to."""
        result = run_gate(gate_of(tmp_path, Deep(4, dark=2), 6))
        assert result.reason.endswith("black up to depth 2, right up to depth 3, wrong from 4 on (light scattered 3 "
                                      "times): -2 %")

    def test_light_where_there_is_none_is_wrong(self, tmp_path: Path) -> None:
        result = run_gate(gate_of(tmp_path, Deep(3, dark=1, ghost=0.1), 6))
        assert result.reason.endswith("wrong from depth 1 on (light seen directly): light where the reference has none "
                                      "at all")

    def test_a_depth_that_noise_hides_is_undecided(self, tmp_path: Path) -> None:
        """Its budget is too small: no claim is made of it."""
        @dataclass(frozen=True)
        class Noisy(Deep):
            @contextmanager
            def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
                with replace(self, sigma=3.0 if scene.depth == 2 else 0.01, asked=[]).plain(scene) as renderer:
                    yield renderer

            def plain(self, scene: SceneFile):  # type: ignore[no-untyped-def]
                return super().open(scene)

        result = run_gate(gate_of(tmp_path, Noisy(4), 6))
        assert result.ladder is not None
        assert result.ladder.rungs[1].reason.startswith("a budget of 64 replicas of 1 samples per pixel is too small")
        assert "right up to depth 1, undecided at 2, wrong from 4 on" in result.reason


class TestRealRenderers:
    """Our tracer against Mitsuba."""

    CUBE = """[[gate]]
        name = "cube"
        scene = "furnace_cube"
        strategy = "cosine"
        size = [16, 16]
        max_depth = 4
        spp = 8
        reference = { value = [0.5904, 0.75, 0.8502] }
        tolerance = { fine = 0.05 }
        reason = "E (1 + ρ + ρ² + ρ³)"
        """

    def test_a_closed_form_is_left_to_mitsuba(self, tmp_path: Path) -> None:
        """The series E (1 - ρ^N) / (1 - ρ) belongs to one depth. The third vertex emits nothing: -22 % of depth 3."""
        gate, = load_gates(write(tmp_path, self.CUBE)).gates
        assert run_gate(gate).outcome == "pass", "max_depth reaches the tracer"
        wrong = OURS.with_line("lib/path.glsl", "if (facing > 0.0)", "if (facing > 0.0 && vertex != 3)")
        result = run_gate(replace(gate, test=Tracer("cosine", library=wrong)))
        assert result.ladder is not None and result.ladder.wrong is not None
        assert "right up to depth 2, wrong from 3 on (light scattered twice): -" in result.reason
        e, rho = np.array([0.2, 0.4, 0.6]), np.array([0.8, 0.5, 0.3])
        lost = -(e * rho**2) / (e * (1 + rho + rho**2)) @ [1, 1, 1] / 3
        assert result.ladder.wrong.error == pytest.approx(lost, abs=0.08)

    def test_a_closed_form_that_is_wrong_is_in_doubt(self, tmp_path: Path) -> None:
        gate, = load_gates(write(tmp_path, self.CUBE.replace("0.75", "0.76"))).gates
        result = run_gate(gate)
        assert result.reason.endswith("; right at every depth against Mitsuba, so the reference is in doubt")
        assert record(result).wrong_from is None

    def test_a_gate_without_ladder_says_why(self, tmp_path: Path) -> None:
        """A shader of one's own that does not heed MAX_DEPTH, and what has no word of depths."""
        (tmp_path / "own.frag").write_text("""uniform sampler2D pingpong0; uniform int numpass, samples_per_pass;
            in vec2 texcoord; layout(location = 0) out vec4 sum;  // MAX_DEPTH in a comment
            void main() {
                vec4 before = numpass > 0 ? texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0) : vec4(0.0);
                sum = before + float(samples_per_pass) * vec4(0.3, 0.3, 0.3, 1.0);
            }""")
        gate = one_gate(tmp_path)
        own = run_gate(replace(gate, test=Tracer("cosine", shader=tmp_path / "own.frag")))
        assert own.reason.endswith(f"; no ladder of depths: {tmp_path / 'own.frag'} does not use MAX_DEPTH, so no "
                                   "depth can be set; bound its paths by it")
        deaf = run_gate(judging(gate, Noise(0.01))).reason
        assert deaf.endswith("no ladder of depths: cosine is what it is at every max_depth")
        with pytest.raises(Exception, match=r"gates\.toml:8: gate 'sky': .*own\.frag does not use MAX_DEPTH"):
            run_gate(replace(gate, scene=gate.scene.at_depth(1), test=Tracer("cosine", shader=tmp_path / "own.frag")))


def test_what_is_left_behind(tmp_path: Path) -> None:
    """The JSON record there and back, the pictures, the page."""
    result = run_gate(gate_of(tmp_path, Deep(3), 6))
    found = record(result)
    assert (found.wrong_from, [rung.outcome for rung in found.ladder]) == (3, ["pass", "pass", "fail"])
    assert from_json(json.loads(json.dumps(as_json(found)))) == found
    save_result(result, tmp_path / "out" / found.gate)
    assert {LADDER, WRONG_DEPTH} <= {path.name for path in (tmp_path / "out" / found.gate).iterdir()}
    write_summary([found], tmp_path / "out")
    page = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    assert "wrong from 3 on" in page and LADDER in page and '<td class="right">3</td><td class="fail">fail</td>' in page
