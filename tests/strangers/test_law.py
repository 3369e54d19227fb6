"""The law of accumulation is found by experiment: each of the ways in which frames are joined has its own."""

from __future__ import annotations

import numpy as np
import pytest

from harness.gpu.frames import Frames
from harness.shader.contract import Contract, Law, ShaderPass
from harness.strangers.accumulation import FRAMES, judge_accumulation, radiance_of
from harness.strangers.law import LawFound, find_law, weight_is_of_the_new, with_weight_of_the_new
from harness.strangers.single import decoded, draw_singles, encoded, loop
from tests.support.handmade import MEAN, SAMPLE, SUM, gratin, shadertoy

SIZE = (16, 12)


def toy(update: str) -> Contract:
    """A Shadertoy buffer with its past in `o`, its sample in `s` and the frame's number in `n`."""
    return shadertoy(f"void mainImage(out vec4 c, in vec2 p) {{ seed_(uvec2(p), uint(iFrame)); vec3 s = {SAMPLE}; "
                     f"vec4 o = texelFetch(iChannel0, ivec2(p), 0); float n = float(iFrame); {update} }}")


def found(contract: Contract) -> tuple[LawFound, Frames]:
    frames = Frames(contract, SIZE)
    return find_law(frames), frames


CASES = {
    "sum": (gratin(SUM), Law("sum", count="alpha")),
    "sum without count": (toy("c = vec4(o.rgb + s, 1.0);"), Law("sum")),
    "mean": (shadertoy(MEAN), Law("mean")),
    "count in alpha": (toy("c = vec4((o.rgb * o.a + s) / (o.a + 1.0), o.a + 1.0);"), Law("mean", count="alpha")),
    "inverse in alpha": (toy("float b = iFrame < 2 || o.a == 0.0 ? 1.0 : 1.0 / (1.0 + 1.0 / o.a); "
                             "c = vec4(mix(o.rgb, s, b), b);"), Law("mean", -1, count="inverse_alpha")),
    "counted from 2": (toy("c = vec4(mix(o.rgb, s, 1.0 / (n + 2.0)), 1.0);"), Law("mean", 1)),
    "counted from 0": (toy("c = vec4(mix(o.rgb, s, 1.0 / max(n, 1.0)), 1.0);"), Law("mean", -1)),
    "blend": (toy("c = vec4(mix(o.rgb, s, 0.125), 1.0);"), Law("blend", weight=0.875)),
    "kept encoded": (toy("c = vec4(pow(mix(pow(o.rgb, vec3(2.2)), s, 1.0 / (n + 1.0)), vec3(1.0 / 2.2)), 1.0);"),
                     Law("mean", encoding="gamma")),
    "kept as roots": (toy("c = vec4(sqrt(mix(o.rgb * o.rgb, s, 1.0 / (n + 1.0))), 1.0);"),
                      Law("mean", encoding="sqrt")),
    "first frames thrown away": (toy("if (iFrame < 3) o = vec4(0.0); c = vec4(mix(o.rgb, s, 1.0 / (n + 1.0)), 1.0);"),
                                 Law("mean")),
    "none": (toy("c = vec4(s, 1.0);"), Law("none")),
    "clamped": (toy("c = vec4(min(o.rgb + s, vec3(1.0)), 1.0);"), Law("other")),
}


@pytest.mark.parametrize(("contract", "law"), CASES.values(), ids=CASES)
def test_is_the_one_that_was_written(contract: Contract, law: Law) -> None:
    result, _ = found(contract)
    assert (result.law.kind, result.law.offset, result.law.encoding, result.law.count) == (
        law.kind, law.offset, law.encoding, law.count)
    assert result.law.weight == pytest.approx(law.weight, abs=1e-4)
    assert result.shift == ""


@pytest.mark.parametrize("name", ["sum", "sum without count", "mean", "count in alpha", "inverse in alpha",
                                  "kept encoded", "counted from 0"])
def test_single_frames_are_those_of_the_loop(name: str) -> None:
    """The loop's result is the mean of the frames drawn alone: the law undoes what joins them."""
    result, frames = found(CASES[name][0])
    whole = radiance_of(loop(frames, FRAMES), result.law, FRAMES)
    alone = draw_singles(frames, result.law, range(FRAMES), keep=True)
    assert alone.stack is not None and alone.rejected == 0
    assert judge_accumulation(whole, alone.stack, result.law).outcome == "pass"
    assert alone.mean[..., 0].mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(("read", "told"), [
    ("texelFetch(iChannel0, ivec2(p) + ivec2(1, 0), 0)", "comes back -1 pixels to the right"),
    ("texture(iChannel0, (p + 0.5) / iResolution.xy)", "spread over 4 pixels")])
def test_a_past_that_is_read_elsewhere_is_noticed(read: str, told: str) -> None:
    result, _ = found(toy(f"o = {read}; c = vec4(mix(o.rgb, s, 1.0 / (n + 1.0)), 1.0);"))
    assert told in result.shift


def test_a_weight_that_is_the_new_frames_is_noticed_and_renamed() -> None:
    base = shadertoy("uniform float weight; void mainImage(out vec4 c, in vec2 p) { seed_(uvec2(p), uint(iFrame)); "
                     f"c = vec4(mix(texelFetch(iChannel0, ivec2(p), 0).rgb, {SAMPLE}, weight), 1.0); }}")
    one = base.passes[0]
    told = ShaderPass(one.name, one.source, one.vertex, one.channels, (), (*one.roles, ("weight", "past_weight")))
    contract = Contract(base.host, (told,), base.radiance)
    result, _ = found(contract)
    assert weight_is_of_the_new(result)
    again, _ = found(with_weight_of_the_new(contract))
    assert again.law.kind == "mean" and not weight_is_of_the_new(again)


@pytest.mark.parametrize("encoding", ["", "gamma", "sqrt", "srgb"])
def test_encodings_are_undone(encoding: str) -> None:
    values = np.array([-0.5, 0.0, 1e-3, 0.2, 1.0, 4.0])
    assert decoded(encoded(values, encoding), encoding) == pytest.approx(values)
