"""What gates say of a shader that does not keep the ping-pong contract."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.gates import Gate, run_gate
from harness.samples.estimate import Batch
from tests.support.fakes import NoiseRenderer
from tests.support.gates import judging, one_gate, small, with_own


@pytest.fixture
def gate(tmp_path: Path) -> Gate:
    return one_gate(tmp_path)


class TestContract:
    """Shaders that do not do what the ping-pong contract asks: a fail that says what they do instead."""

    @pytest.mark.parametrize(("sum_", "told"), [
        ("vec4(0.5, 0.5, 0.5, 1.0)", "24000 of 25600 samples were not finite, or not counted in alpha; to"),
        ("before + vec4(0.5, 0.5, 0.5, 0.0) * k", "25600 of 25600 samples were not finite, or not counted"),
        ("before + vec4(0.5, 0.5, 0.5, 2.0) * k", "25600 of 25600 samples were not finite, or not counted"),
        ("before + vec4(1e30, 0.0, 0.0, 1e-30) * k", "25600 of 25600 samples were not finite, or not counted"),
        ("before + vec4(0.5, 0.5, 0.5 / (before.a - before.a), 1.0) * k", "25600 of 25600 samples were not finite")])
    def test_alpha_is_the_number_of_samples(self, gate: Gate, tmp_path: Path, sum_: str, told: str) -> None:
        own = with_own(small(gate, 10), shader=own_shader(tmp_path, f"sum = {sum_};"))
        result = run_gate(dataclasses.replace(own, spp=16, replicas=64))
        assert result.outcome == "fail"
        assert result.reason.startswith(told)
        assert np.isfinite(result.test.mean).all()

    def test_replicas_differ(self, gate: Gate, tmp_path: Path) -> None:
        """A seed without the replica looks like noiseless samples: their error would be taken for a bias."""
        for seed, told in (
            ("first_sample", "all replicas are one image, which is not without noise: the seed leaves out `replica`"),
            ("40503u * uint(numpass)", "one image, which is not without noise: the seed leaves out `replica`"),
            ("0u", "; all batches are one image: without noise, or from a seed without `first_sample` and `replica`"),
            ("first_sample + 977u * replica", "")):
            noise = f"vec3(fract(float(pixel * 2654435761u ^ ({seed}) * 40503u) * 2.3283e-10))"
            shader = own_shader(tmp_path, "uint pixel = uint(gl_FragCoord.x) + 40u * uint(gl_FragCoord.y);"
                                          f"sum = before + vec4(0.502 + 0.1 * ({noise} - 0.5), 1.0) * k;")
            result = run_gate(with_own(small(gate, 10), shader=shader))
            assert result.outcome == "fail"
            assert told in result.reason
            assert ("one image" in result.reason) == bool(told)

    @pytest.mark.parametrize("sigma", [0.001, 0.01, 3.0])
    def test_any_two_replicas_differ(self, gate: Gate, sigma: float) -> None:
        """Whatever the verdict and the budget would say: passing, failing and hopeless alike are told of equal ones."""
        class Repeating(NoiseRenderer):
            def render_batch(self, replica: int, *arguments: int, **options: Any) -> Batch:
                return super().render_batch(min(replica, 3), *arguments, **options)

        result = run_gate(judging(gate, Repeating(0.5, sigma, (40, 40))))
        assert (result.outcome, len(result.looks)) == ("fail", 1)
        assert result.reason.startswith("replicas 3 and 4 are one image, and of 16 replicas only 4 differ, which is "
                                        "not without noise: the seed leaves out `replica`")

    @pytest.mark.parametrize("noisy", [0, 31, 32])
    def test_replicas_without_noise_may_be_equal(self, gate: Gate, noisy: int) -> None:
        """And those that differ in a few pixels may be so by chance."""
        sigma = np.zeros((40, 40, 1))
        sigma.ravel()[:noisy] = 0.01

        class Repeating(NoiseRenderer):
            def render_batch(self, replica: int, *arguments: int, **options: Any) -> Batch:
                return super().render_batch(min(replica, 3), *arguments, **options)

        result = run_gate(judging(gate, Repeating(0.5, sigma, (40, 40))))
        assert result.outcome == ("fail" if noisy == 32 else "pass"), result.reason

    def test_count_before_the_budget(self, gate: Gate, tmp_path: Path) -> None:
        """The handout draws one sample a pass: to advise 64 times the samples would help nobody."""
        noise = "vec3(fract(sin(dot(gl_FragCoord.xy, vec2(12.9, 78.2)) + float(replica + first_sample)) * 43758.5))"
        shader = own_shader(tmp_path, f"sum = before + vec4(50.0 * ({noise} - 0.5) + 0.5, 1.0);")
        result = run_gate(dataclasses.replace(with_own(small(gate, 10), shader=shader), spp=16, replicas=64))
        assert (result.outcome, len(result.looks)) == ("fail", 1)
        assert "or not counted in alpha; to what pingpong0 holds" in result.reason
        assert "one sample a pass is too few" in result.reason

    def test_a_wrong_count_of_more_samples_is_no_noise(self, gate: Gate, tmp_path: Path) -> None:
        """This one is right in a single pass, as a gate of one sample draws it."""
        shader = own_shader(tmp_path, "sum = k * float(3 * numpass + 1) * vec4(0.25, 0.25, 0.25, 1.0);")
        result = run_gate(with_own(small(gate, 10), shader=shader))
        assert result.outcome == "fail" and "which is not without noise" not in result.reason

    @pytest.mark.parametrize(("sum_", "spp", "told"), [
        ("vec4(vec3(0.5), before.a + k)", 16, "1/16"), ("vec4(vec3(0.5), before.a + k)", 300, "1/300"),
        ("before + vec4(vec3(0.25), 1.0) * k", 64, "")])
    def test_a_mean_is_no_sum(self, gate: Gate, tmp_path: Path, sum_: str, spp: int, told: str) -> None:
        """The mean in place of the sum; half the sum is another story."""
        shader = own_shader(tmp_path, f"sum = {sum_};")
        result = run_gate(dataclasses.replace(with_own(small(gate, 10), shader=shader), spp=spp, replicas=16))
        assert result.outcome == "fail"
        assert ("as where a mean is stored for a sum: pingpong0's rgb" in result.reason) == bool(told)
        assert f" is {told} - 1, " in result.reason or not told


def own_shader(folder: Path, body: str) -> Path:
    """A whole shader: `before` is what was there, `k` the number of samples to add, `sum` the result."""
    path = folder / "own.frag"
    path.write_text("""uniform sampler2D pingpong0; uniform int numpass; uniform int samples_per_pass;
        uniform uint first_sample; uniform uint replica;
        layout(location = 0) out vec4 sum;
        void main() {
            vec4 before = numpass > 0 ? texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0) : vec4(0.0);
            float k = float(samples_per_pass);
            BODY
        }""".replace("BODY", body))
    return path
