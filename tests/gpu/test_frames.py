"""Frames of a contract: feedback, roles, values, stand-ins, several passes, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.errors import ShaderError
from harness.gpu.frames import Frames, Moment, iterations_limit, unset_variables
from harness.samples.estimate import Batch, merge
from harness.samples.exr import write_estimate
from harness.shader.contract import Channel, Contract, Role, ShaderPass
from tests.support.handmade import MEAN, SUM, VERTEX, gratin, shadertoy, source

SIZE = (16, 12)


def one(text: str, *, head: str = "#version 420\nout vec4 c;\n", channels: tuple[Channel, ...] = (),
        roles: tuple[tuple[str, Role], ...] = (), name: str = "pass") -> ShaderPass:
    return ShaderPass(name, source(head, text, "one.frag"), VERTEX, channels, (), roles)


def drawn(*passes: ShaderPass, moment: Moment | None = None, values: tuple = ()) -> np.ndarray:
    """What the last of these passes leaves after one frame."""
    frames = Frames(Contract("test", passes, passes[-1].name, values), SIZE)
    frames.frame(moment or Moment.of(3, 3))
    left = frames.read(passes[-1].name)
    frames.release()
    return left


class TestFeedback:
    """What a pass left is what it reads."""

    @pytest.mark.parametrize(("contract", "alpha"), [(gratin(SUM), 4.0), (shadertoy(MEAN), 1.0)])
    def test_carries_from_frame_to_frame(self, contract: Contract, alpha: float) -> None:
        frames = Frames(contract, SIZE)
        for n in range(4):
            frames.frame(Moment.of(n, n))
        left = frames.read(contract.radiance)
        assert left.shape == (12, 16, 4)
        assert np.all(left[..., 3] == alpha)
        assert left[..., 0].mean() / alpha == pytest.approx(0.5, abs=0.1)

    def test_is_what_was_written_in_its_place(self) -> None:
        frames = Frames(gratin("void main() { outBuffer0 = texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0); }"), SIZE)
        past = np.random.default_rng(1).random((12, 16, 4)).astype(np.float32)
        frames.write("pingpong", past)
        frames.frame(Moment.of(0, 0))
        assert np.array_equal(frames.read("pingpong"), past)

    def test_of_another_pass_is_that_of_this_frame_where_it_is_drawn_before(self) -> None:
        reader = one("uniform sampler2D a; void main() { c = texelFetch(a, ivec2(0), 0) * 2.0; }",
                     channels=(Channel("a", "pass:first"),))
        assert np.all(drawn(one("void main() { c = vec4(3.0); }", name="first"), reader) == 6.0)

    def test_does_not_carry_what_is_not_finite_by_itself(self) -> None:
        frames = Frames(gratin(SUM), SIZE)
        frames.clear(float("nan"))
        frames.frame(Moment.of(0, 0))
        assert np.isfinite(frames.read("pingpong")).all()


class TestTold:
    """What uniforms say, by their role."""

    @pytest.mark.parametrize(("kind", "role", "expected"), [
        ("int", "frame", 7), ("float", "frame", 7), ("uint", "count", 4), ("float", "past_weight", 0.75),
        ("float", "new_weight", 0.25), ("float", "time", 7 / 60), ("float", "aspect", 16 / 12), ("int", "width", 16)])
    def test_is_a_number(self, kind: str, role: Role, expected: float) -> None:
        left = drawn(one(f"uniform {kind} u; void main() {{ c = vec4(float(u)); }}", roles=(("u", role),)),
                     moment=Moment.of(7, 3))
        assert left[0, 0, 0] == pytest.approx(expected, rel=1e-6)

    def test_is_the_films_size_in_as_many_numbers_as_there_are(self) -> None:
        for kind, rest in (("vec2", "0.0, 0.0"), ("ivec2", "0.0, 0.0"), ("vec3", "0.0")):
            left = drawn(one(f"uniform {kind} u; void main() {{ c = vec4(u, {rest}); }}", roles=(("u", "resolution"),)))
            assert tuple(left[0, 0, :2]) == SIZE

    def test_is_another_random_number_in_each_frame_and_the_same_again(self) -> None:
        text = one("uniform float u; void main() { c = vec4(u); }", roles=(("u", "random"),))
        first, again, other = (drawn(text, moment=Moment.of(n, n))[0, 0, 0] for n in (1, 1, 2))
        assert first == again != other

    def test_is_a_value_that_somebody_gave(self) -> None:
        text = "uniform float a[3]; uniform bool b; void main() { c = vec4(a[2], b ? 1.0 : 0.0, 0.0, 0.0); }"
        left = drawn(one(text), values=(("a", (1.0, 2.0, 3.0)), ("b", True)))
        assert tuple(left[0, 0, :2]) == (3.0, 1.0)

    def test_is_an_array_of_vectors_one_number_after_the_other(self) -> None:
        """As contracts hold it."""
        text = "uniform vec2 a[2]; void main() { c = vec4(a[0], a[1]); }"
        left = drawn(one(text), values=(("a", (1.0, 2.0, 3.0, 4.0)),))
        assert tuple(left[0, 0]) == (1.0, 2.0, 3.0, 4.0)


class TestStandIns:
    """What samplers read that have nothing to read."""

    @pytest.mark.parametrize(("kind", "reads", "at", "low", "high"), [
        ("sampler2D", "black", "vec2(0.5)", 0, 0), ("sampler2D", "white", "vec2(0.5)", 1, 1),
        ("sampler2D", "keyboard", "vec2(0.5)", 0, 0), ("sampler2D", "noise", "gl_FragCoord.xy / 16.0", 0.3, 0.7),
        ("samplerCube", "cube", "vec3(1.0)", 0.5, 0.5), ("sampler3D", "volume", "gl_FragCoord.xyz / 16.0", 0.2, 0.8)])
    def test_are_there(self, kind: str, reads: str, at: str, low: float, high: float) -> None:
        left = drawn(one(f"uniform {kind} u; void main() {{ c = texture(u, {at}); }}",
                         channels=(Channel("u", reads, kind, repeat=True),)))
        assert low <= left[..., 0].mean() <= high

    @pytest.mark.parametrize("suffix", ["exr", "png"])
    def test_are_files_with_their_first_row_on_top(self, tmp_path: Path, suffix: str) -> None:
        """Radiance beyond 1 as it is."""
        rows = np.array([[[4.0, 0.5, 0.25]], [[0.0, 1.0, 0.0]]], np.float32)
        file = tmp_path / f"map.{suffix}"
        if suffix == "exr":
            write_estimate(file, merge([Batch(rows, 1)]))
        else:
            Image.fromarray((255 * np.minimum(rows, 1)).astype(np.uint8)).save(file)
        left = drawn(one("uniform sampler2D u; void main() { c = texelFetch(u, ivec2(0, 1), 0); }",
                         channels=(Channel("u", f"file:{file}", "sampler2D"),)))
        assert left[0, 0, :3] == pytest.approx([4.0 if suffix == "exr" else 1.0, 0.5, 0.25], abs=0.003)

    def test_of_a_sampler_without_a_channel_is_black_and_not_the_past(self) -> None:
        frames = Frames(Contract("test", (one("uniform sampler2D u; void main() { c = texture(u, vec2(0.5)); }"),),
                                 "pass"), SIZE)
        frames.clear(5.0)
        frames.frame(Moment.of(0, 0))
        assert not frames.read("pass")[..., :3].any()


class TestRefusals:
    """ShaderError in one line."""

    def test_name_the_authors_line(self) -> None:
        with pytest.raises(ShaderError, match=r"^body\.frag:\d+: `colour' undeclared; in the line `void main"):
            Frames(gratin("void main() { outBuffer0 = vec4(colour); }"), SIZE)

    def test_are_short_however_long_the_line_is(self) -> None:
        with pytest.raises(ShaderError) as error:
            Frames(gratin(f"void main() {{ outBuffer0 = vec4(colour{' + 1.0' * 900}); }}"), SIZE)
        assert len(str(error.value)) < 600

    def test_say_what_has_no_line(self) -> None:
        with pytest.raises(ShaderError, match=r"^body\.frag: function `float f.float.' has static recursion$"):
            Frames(gratin("float f(float x) { return x < 0.0 ? x : f(x - 1.0); } "
                          "void main() { outBuffer0 = vec4(f(2.0)); }"), SIZE)

    def test_are_for_data_that_only_another_program_has(self) -> None:
        text = "layout(std430, binding = 0) buffer Data { vec4 d[]; }; void main() { c = d[int(gl_FragCoord.x)]; }"
        with pytest.raises(ShaderError, match="'Data' is a storage buffer"):
            Frames(Contract("test", (one(text, head="#version 430\nout vec4 c;\n"),), "pass"), SIZE)


def test_the_compiler_names_variables_without_a_value() -> None:
    contract = gratin("void main() { float q; outBuffer0 = vec4(q); }")
    (where, name), = [found for found in unset_variables(contract.passes[0]) if found[1] == "q"]
    assert name == "q" and where.startswith("body.frag:")


def test_a_display_pass_is_drawn_where_it_is_asked_for() -> None:
    shown = replace(one("void main() { c = vec4(2.0); }", name="show"), displays=True)
    frames = Frames(Contract("test", (gratin(SUM).passes[0], shown), "pingpong"), SIZE)
    frames.frame(Moment.of(0, 0))
    assert not frames.read("show").any()
    frames.frame(Moment.of(1, 1), displays=True)
    assert (frames.read("show") == 2.0).all()


@pytest.mark.parametrize("iterations", [65_000, 70_000, 1_000_000])
def test_a_loop_is_cut_where_the_limit_of_iterations_says(iterations: int) -> None:
    """llvmpipe of Mesa 22 has a limit, and that of Mesa 25 has none."""
    counted = drawn(one(f"void main() {{ float n = 0.0; for (int i = 0; i < {iterations}; ++i) n += 1.0; "
                        "c = vec4(n); }"))
    limit = iterations_limit()
    assert (counted == (min(iterations, limit) if limit else iterations)).all()
