"""Somebody's shader as an estimator: its batches are independent single frames, and it is refused in one line."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, ShaderError
from harness.estimators.base import Estimator, Renderer
from harness.estimators.shader import Shader
from harness.scene import SceneFile
from harness.shader.contract import Law
from harness.work.batches import render_estimate
from tests.support.ball import SCENE, body, toy


@pytest.fixture
def ball(tmp_path: Path) -> SceneFile:
    path = tmp_path / "ball.xml"
    path.write_text(SCENE, encoding="utf-8")
    return SceneFile(path)


def shader(folder: Path, text: str, name: str = "shader.frag") -> Shader:
    (folder / name).write_text(text, encoding="utf-8")
    return Shader((folder / name,))


@pytest.mark.parametrize(("text", "name", "kind"), [(body(), "a.frag", "sum"), (toy(), "b.glsl", "mean")])
def test_renders_batches_of_single_frames(ball: SceneFile, tmp_path: Path, text: str, name: str, kind: str) -> None:
    estimator: Estimator = shader(tmp_path, text, name)
    assert estimator.check(ball) == ""
    with estimator.open(ball) as opened:
        renderer: Renderer = opened
        assert opened.law.kind == kind
        estimate = render_estimate(renderer, 64)
        again, other = (renderer.render_batch(replica, 0, 4) for replica in (0, 1))
        assert np.array_equal(again.mean, renderer.render_batch(0, 0, 4).mean)
        halves = [renderer.render_batch(0, start, 2).mean for start in (0, 2)]
    assert np.allclose(again.mean, np.mean(halves, axis=0), atol=1e-6)
    assert not np.array_equal(again.mean, other.mean)
    assert again.samples == 4 and again.rejected == 0 and again.cost.seconds > 0
    # Row 0 is the top one, where there is sky; the ball is as bright as its albedo.
    assert estimate.mean[0, 0] == pytest.approx(1.0)
    assert estimate.mean[7, 8] == pytest.approx([0.6, 0.5, 0.4], abs=0.12)
    assert estimate.variance[7, 8, 0] > 0 == estimate.variance[0, 0, 0]


def test_is_a_value(tmp_path: Path) -> None:
    one = shader(tmp_path, body())
    assert pickle.loads(pickle.dumps(one)) == one
    assert hash(one) == hash(replace(one)) and one.name == "shader"


def test_is_known_by_its_text_and_how_it_is_drawn(ball: SceneFile, tmp_path: Path) -> None:
    identities = []
    for one in (shader(tmp_path, body(), "a.frag"), shader(tmp_path, body("vec3(0.5)"), "b.frag")):
        with one.open(ball) as renderer:
            identities.append(renderer.identity)
    with replace(shader(tmp_path, body(), "a.frag"), run=8).open(ball) as renderer:
        identities.append(renderer.identity)
    assert len({tuple(identity.items()) for identity in identities}) == 3


def test_takes_the_law_that_its_contract_has(ball: SceneFile, tmp_path: Path) -> None:
    one = shader(tmp_path, body())
    told = replace(one, contract=replace(one.read(), law=Law("none"), flipped=True))
    with told.open(ball) as renderer:
        assert renderer.law == Law("none")
        assert renderer.render_batch(0, 0, 1).mean.shape == (16, 16, 3)


def test_refuses_frames_beyond_a_replicas(ball: SceneFile, tmp_path: Path) -> None:
    one = replace(shader(tmp_path, body()), run=8)
    told = "a replica of shader has 8 frames, found 4 from 6"
    with one.open(ball) as renderer, pytest.raises(HarnessError, match=told):
        renderer.render_batch(0, 6, 4)


def test_refuses_what_it_cannot_be_told(ball: SceneFile, tmp_path: Path) -> None:
    unknown = "#version 330 core\nuniform sampler2D prev; uniform float wavelength; out vec4 c;\n" \
              "void main() { c = texture(prev, vec2(0.5)) + vec4(wavelength); }\n"
    with pytest.raises(HarnessError, match="nobody knows what 'float wavelength' is for"):
        shader(tmp_path, unknown).check(ball)
    with pytest.raises(ShaderError, match=r"shader\.frag:\d+: "), shader(tmp_path, "float f(").open(ball):
        pass


def test_refuses_a_film_of_another_size_than_the_authors(ball: SceneFile, tmp_path: Path) -> None:
    one = shader(tmp_path, body())
    other = replace(one, contract=replace(one.read(), size=(512, 512)))
    with pytest.raises(HarnessError, match=r"a size of 512 x 512 is written into the shader.*--size 512x512"):
        other.check(ball)
