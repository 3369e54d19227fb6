"""`harness check`: the contract, the faults and the verdict of somebody's shader, and a status that says which."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.diagnosis import stranger
from tests.cli.conftest import Harness, refusal
from tests.strangers.hostile import RANDOM
from tests.support.ball import COSINE_TWICE, SCENE, body


def written(text: str, name: str = "shader.frag") -> str:
    Path(name).write_text(text, encoding="utf-8")
    return name


@pytest.fixture
def sky_shader() -> str:
    """Shows the sky of conftest's scene, without noise but in its last digit."""
    return written(f"{RANDOM}in vec2 texcoord;\nvoid main() {{ ivec2 p = ivec2(gl_FragCoord.xy); seed_(uvec2(p), "
                   "uint(numpass)); vec4 o = numpass > 0 ? texelFetch(pingpong0, p, 0) : vec4(0.0);\n"
                   "outBuffer0 = o + vec4(vec3(0.5, 0.25, 1.0) * (0.9 + 0.2 * rnd()), 1.0); }\n")


class TestWithoutScene:
    """What a shader says of itself."""

    def test_tells_the_contract_and_passes_what_is_right(self, harness: Harness) -> None:
        done = harness("check", written(body()), "--size", "16x16")
        assert done.status == 0
        assert "host body" in done.out and "running sum, alpha counts its samples" in done.out
        assert "accumulation: pass: the loop's result is the mean of its 24 frames, exactly" in done.out
        assert "give --scene SCENE" in done.err

    def test_names_faults_with_the_authors_line_and_fails(self, harness: Harness) -> None:
        wrong = body().replace("outBuffer0 = old + vec4(1.0 * s, 1.0)", "s = min(s, vec3(0.7));\n"
                               "    outBuffer0 = old + vec4(s, 1.0)")
        done = harness("check", written(wrong), "--size", "16x16", "--json")
        assert done.status == 1
        (fault,) = done.json["findings"]
        assert (fault["kind"], fault["severity"]) == ("clamps_samples", "fault")
        line = wrong.splitlines().index("    s = min(s, vec3(0.7));") + 1
        assert fault["where"].endswith(f"shader.frag:{line}")
        assert done.json["contract"]["law"]["kind"] == "sum"
        assert "estimator" not in done.json


class TestWithScene:
    """The verdict against Mitsuba."""

    @pytest.fixture(autouse=True)
    def counted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Frames by their number and not by seconds: a busy machine decides nothing."""
        monkeypatch.setattr(stranger, "_frames_of_a_batch", lambda *arguments: 24)

    def test_passes_what_is_right(self, harness: Harness, sky: Path, sky_shader: str) -> None:
        done = harness("check", sky_shader, "--scene", sky, "--size", "16x12", "--tolerance", 0.01,
                       "--reference-spp", 64)
        assert done.status == 0, done.out + done.err
        assert "estimator: pass" in done.out
        assert "slope" in done.out and "worst tile" in done.out

    def test_fails_what_is_wrong(self, harness: Harness) -> None:
        Path("ball.xml").write_text(SCENE, encoding="utf-8")
        done = harness("check", written(body(COSINE_TWICE)), "--scene", "ball.xml", "--no-causes", "--tolerance",
                       0.01, "--size", "8x8", "--json", "--reference-spp", 1024)
        assert done.status == 1
        assert done.json["findings"] == []  # its averaging and its numbers are right: it is what a frame computes
        assert done.json["accumulation"]["outcome"] == "pass"
        assert done.json["estimator"]["outcome"] == "fail"
        assert done.json["estimator"]["error"] < -0.05
        assert done.json["estimator"]["worst"]["error"] < 0


class TestRefusals:
    """Status 2, one line."""

    @pytest.mark.parametrize(("arguments", "told"), [
        (("nothing.frag",), "nothing.frag"),
        (("shader.frag", "--host", "nowhere"), "no host 'nowhere'"),
        (("shader.frag", "--set", "alpha"), "--set: expected NAME=VALUE"),
        (("shader.frag", "--set", "alpha=1"), "declares no uniform of that name"),
        (("shader.frag", "--scene", "nowhere"), "unknown scene 'nowhere'"),
        (("shader.frag", "--size", "16"), "--size: expected WIDTHxHEIGHT")])
    def test_say_what_was_wrong(self, harness: Harness, arguments: tuple[str, ...], told: str) -> None:
        written(body())
        assert told in refusal(harness("check", *arguments))

    def test_are_for_shaders_that_do_not_compile(self, harness: Harness) -> None:
        assert "shader.frag:" in refusal(harness("check", written(body().replace("s, 1.0)", "colour, 1.0)"))))

    def test_ask_for_uniforms_by_name_and_take_what_is_said(self, harness: Harness) -> None:
        name = written("#version 330 core\nuniform sampler2D prev; uniform float wavelength;\nuniform int frame; "
                       "out vec4 c;\nvoid main() { c = texelFetch(prev, ivec2(gl_FragCoord.xy), 0) + "
                       "vec4(wavelength); }")
        assert "--set wavelength=VALUE" in refusal(harness("check", name))
        assert harness("check", name, "--set", "wavelength=0.5", "--size", "16x12").status in (0, 1)
