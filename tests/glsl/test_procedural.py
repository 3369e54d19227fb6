"""Marble, wood and fractal in the shader: the colours of Mitsuba's plugins at every point, without needless work."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.api import render, render_reference
from harness.files import data_dir
from harness.policy import judge
from harness.reference.prepare import instantiate
from harness.samples.estimate import Estimate
from harness.scene import Scene, load_scene
from harness.scene.model import Procedural
from harness.scene.noise import NUMPY
from harness.scene.procedural import KINDS, ramp
from harness.scene.procedural import evaluate as formula
from harness.shader.scene.chunk import scene_chunk
from tests.support.scenes import AT_ORIGIN, SceneWriter
from tests.support.tracer import TracerRenderer, evaluate, library

SCENES = data_dir("mitsuba_scenes")
AGREEMENT = 1e-5  # of two float32 evaluations of one colour within [0, 1]
PLACES = (
    '<transform name="to_world"><rotate x="0.6" z="0.8" angle="50"/><scale value="1.7"/>'
    '<translate x="1" y="-2" z="0.5"/></transform>',
    '<point name="center" x="-0.4" y="0.3" z="2"/><float name="radius" value="0.6"/>',
    "",
)


def texture(name: str, rng: np.random.Generator, *, kind: str = "", scale: float = 1.0) -> str:
    """A texture of random kind and parameters, colours up to `scale`."""
    kind = kind or str(rng.choice(list(KINDS)))
    colors = "".join(f'<rgb name="color{i}" value="{r:.4f}, {g:.4f}, {b:.4f}"/>'
                     for i, (r, g, b) in enumerate(scale * rng.uniform(size=(rng.integers(2, 9), 3))))
    numbers = {"lacunarity": rng.uniform(1.5, 2.5), "gain": rng.uniform(0.3, 0.8), "frequency": rng.uniform(0.5, 5)}
    if kind != "fractal":
        numbers["distortion"] = rng.uniform(-2, 4)
    body = "".join(f'<float name="{key}" value="{value:.6f}"/>' for key, value in numbers.items())
    return (f'<texture type="{kind}" name="{name}">{colors}{body}<integer name="octaves" value="{rng.integers(1, 7)}"/>'
            f'<integer name="seed" value="{rng.integers(2**32)}"/><transform name="to_texture">'
            f'<rotate y="1" angle="{rng.uniform(0, 360):.3f}"/><scale x="0.8" y="1.3"/><translate z="0.7"/></transform>'
            "</texture>")


def sphere(*textures: str, light: str = "") -> str:
    """A sphere with these parameters of a phong, and of a light."""
    emitter = f'<emitter type="area">{light}</emitter>' if light else ""
    return f'<shape type="sphere"><bsdf type="phong">{"".join(textures)}</bsdf>{emitter}</shape>'


def points(count: int = 3000) -> np.ndarray:
    """Points (N, 3) about the shapes; a texture fills space, so that they need not lie on one."""
    return np.random.default_rng(1).normal(size=(count, 3)).astype(np.float32).astype(np.float64) * 2


def shader(scene: Scene, index: int, p: np.ndarray) -> dict[str, np.ndarray]:
    """kd, ks, alpha and radiance of a shape at points, as the scene's generated code has them."""
    found = evaluate("material.frag", np.c_[p, np.full(len(p), index)], outputs=4,
                     generated={"scene.glsl": scene_chunk(scene, "mixture")})
    return {"kd": found[:, 0:3], "alpha": found[:, 3], "ks": found[:, 4:7], "radiance": found[:, 8:11]}


def mitsuba(mi: Any, shape: Any, p: np.ndarray) -> dict[str, np.ndarray]:
    """The same of the shape in Mitsuba's scene, from its plugins."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(p))
    si.p = mi.Point3f(*(np.ascontiguousarray(c) for c in p.T))
    si.wi = mi.Vector3f(0, 0, 1)
    bsdf = shape.bsdf()
    found = {"kd": bsdf.kd.eval(si), "ks": bsdf.ks.eval(si), "alpha": bsdf.alpha.eval(si)[0]}
    if shape.emitter() is not None:
        found["radiance"] = shape.emitter().eval(si)
    return {name: np.array(value).T for name, value in found.items()}


@pytest.mark.parametrize("seed", range(4))
def test_shader_and_mitsuba_agree(mi: Any, scene: SceneWriter, seed: int) -> None:
    """Random textures on every parameter of shapes in several places, one BSDF shared: at thousands of points."""
    rng = np.random.default_rng(seed)
    shared = f'<bsdf type="phong" id="shared">{texture("kd", rng)}</bsdf>'
    full = (f'<bsdf type="phong">{texture("kd", rng)}{texture("ks", rng)}{texture("alpha", rng, scale=100)}</bsdf>'
            f'<emitter type="area">{texture("radiance", rng, scale=5)}</emitter>')
    bodies = ['<ref id="shared"/>', full, '<ref id="shared"/>']
    made = scene(shared + "".join(f'<shape type="sphere">{place}{body}</shape>'
                                  for place, body in zip(PLACES, bodies, strict=True)))
    twin = instantiate(made.file)  # must outlive what is computed from it
    for index in range(3):
        found, expected = shader(made, index, points()), mitsuba(mi, twin.shapes()[index], points())
        for name, values in expected.items():
            scale = max(1.0, float(np.max(values)))
            assert np.abs(found[name] - values).max() < AGREEMENT * scale, f"{name} of shape {index}"
        assert all(np.ptp(expected[name]) > 0.1 for name in (expected if index == 1 else ["kd"]))  # none is a constant


@pytest.mark.parametrize("kind", KINDS)
def test_shader_agrees_with_float64(scene: SceneWriter, kind: str) -> None:
    """A texture by itself, whose generated code leaves out other kinds need; too gentle for float32 to show."""
    made = scene(sphere(f'<texture type="{kind}" name="kd"><float name="frequency" value="1.5"/>'
                        '<rgb name="color1" value="1, 0.5, 0"/><rgb name="color2" value="0.3, 0.8, 1"/></texture>'))
    kd = made.shapes[0].material.kd
    assert isinstance(kd, Procedural)
    p = points() / 2
    t, _ = formula(NUMPY, kd, (p[:, 0], p[:, 1], p[:, 2]))
    expected = np.stack([ramp(NUMPY, t, stops)[0] for stops in zip(*kd.colors, strict=True)], axis=-1)
    np.testing.assert_allclose(shader(made, 0, p)["kd"], expected, atol=AGREEMENT)


@pytest.mark.parametrize("kind", KINDS)
def test_both_sides_hold_the_same_constants(kind: str) -> None:
    """NAME_RISE and NAME_GRAIN of the library, where it has them, are those of the kind's row."""
    text = library().assembled("lib/procedural.glsl").text
    rise = re.search(rf"^const float {kind.upper()}_RISE = ([\d.]+);", text, re.MULTILINE)
    grain = re.search(rf"^const vec3 {kind.upper()}_GRAIN = vec3\(([\d., ]+)\);", text, re.MULTILINE)
    row = KINDS[kind]
    assert (rise is None) == (row.distortion is None)
    assert rise is None or float(rise[1]) == row.rise
    assert (tuple(map(float, grain[1].split(", "))) if grain else (1.0, 1.0, 1.0)) == row.grain


def noise_calls(scene: Scene) -> int:
    """How often the scene's code evaluates one octave."""
    return len(re.findall(r"\bvalue_noise\(", scene_chunk(scene, "mixture")))


class TestWork:
    """What the generated code evaluates."""

    def test_shapes_share_one_evaluation(self, scene: SceneWriter) -> None:
        """Of as many octaves as the richest texture has."""
        rng = np.random.default_rng(0)
        made = scene("".join(sphere(texture("kd", rng)) for _ in range(4)) + sphere(light=texture("radiance", rng)))
        octaves = [t.octaves for s in made.shapes for t in (s.material.kd, s.emission) if isinstance(t, Procedural)]
        assert len(octaves) == 5 and noise_calls(made) == max(octaves)

    def test_textures_that_differ_in_colour_are_evaluated_once(self, scene: SceneWriter) -> None:
        made = scene(sphere('<texture type="wood" name="kd"/>',
                            '<texture type="wood" name="ks"><float name="color1" value="0.2"/></texture>'))
        assert noise_calls(made) == 4
        found = shader(made, 0, points(500))
        np.testing.assert_allclose(found["ks"], 0.2 * found["kd"], atol=1e-6)

    def test_textures_of_one_shape_are_evaluated_each(self, scene: SceneWriter) -> None:
        """And another shape's texture joins one of them, though it is first in the file."""
        wood, marble = '<texture type="wood" name="kd"/>', '<texture type="marble" name="ks"/>'
        assert noise_calls(scene(sphere(wood, marble))) == 8
        assert noise_calls(scene(sphere(marble) + sphere(wood, marble) + sphere(wood))) == 8

    def test_a_scene_without_them_has_none_of_their_code(self, scene: SceneWriter) -> None:
        text = scene_chunk(scene(sphere()), "mixture")
        assert "#define HAS_PROCEDURAL 0" in text
        assert "noise" not in text and "ramp" not in text and text.lower().count("procedural") == 1


def test_sixteen_octaves_on_long_paths_lose_no_sample(scene: SceneWriter) -> None:
    """In a closed white box, where paths go on to the end: loops over octaves would exceed the iterations allowed."""
    made = scene('<shape type="cube"><boolean name="flip_normals" value="true"/><transform name="to_world">'
                 '<scale value="9"/></transform><bsdf type="diffuse"><texture type="fractal" name="reflectance">'
                 '<integer name="octaves" value="16"/><float name="lacunarity" value="1.2"/>'
                 '<float name="color0" value="0.9999"/><float name="color1" value="1"/></texture></bsdf></shape>',
                 integrator='<integrator type="path"><integer name="max_depth" value="1000"/></integrator>')
    renderer = TracerRenderer(made, "mixture")
    batch = renderer.render_batch(0, 0, 32)
    renderer.release()
    assert batch.samples == 32 and batch.rejected == 0


def test_an_evenly_lit_plane_shows_its_texture(scene: SceneWriter) -> None:
    """Closed form: under a constant sky a diffuse plane's radiance is the sky's times the texture at each point."""
    made = scene('<emitter type="constant"><float name="radiance" value="2"/></emitter>'
                 '<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="3"/>'
                 '</transform><boolean name="flip_normals" value="true"/><bsdf type="diffuse">'
                 '<texture type="marble" name="reflectance"><float name="frequency" value="30"/></texture></bsdf>'
                 "</shape>", sensor=AT_ORIGIN)
    renderer = TracerRenderer(made, "cosine")
    found = renderer.render_batch(0, 0, 4096).mean[..., 0]
    renderer.release()
    kd = made.shapes[0].material.kd
    assert isinstance(kd, Procedural)
    fine = 64  # places a side in each pixel
    film = ((np.arange(8 * fine) + 0.5) / (8 * fine) * 2 - 1) * made.camera.tan_x * 3 / 50
    x, y = np.meshgrid(-film, -film)  # +x is to the left in camera space, and row 0 at the top
    t, _ = formula(NUMPY, kd, (x, y, 0 * x))
    exact = 2 * t.reshape(8, fine, 8, fine).mean(axis=(1, 3))
    assert np.ptp(exact) > 0.3
    # Of 4096 random places in a pixel where the texture spans 2: at most 1 / 64 of standard error, times 4.5 for 64.
    np.testing.assert_allclose(found, exact, atol=4.5 / 64)
    assert found.mean() == pytest.approx(exact.mean(), abs=4.5 / 64 / 8)


@pytest.fixture(scope="module")
def reference() -> tuple[Scene, Estimate]:
    """The scene that has them all, small, and Mitsuba's image of it, whose bright samples make an interval long."""
    made = load_scene(SCENES / "procedural.xml", width=96, height=64)
    return made, render_reference(made, 1024)


def test_image_agrees_with_mitsuba(reference: tuple[Scene, Estimate]) -> None:
    """Its mean within 0.2 % in each channel, decided at 95 % confidence."""
    verdict = judge(render(reference[0], "mixture", 512), reference[1])
    assert verdict.outcome == "pass", verdict.reason


def test_image_gate_sees_another_seed(reference: tuple[Scene, Estimate], tmp_path: Path) -> None:
    """The same verdict on a ground with another pattern of the same look."""
    text = (SCENES / "procedural.xml").read_text(encoding="utf-8")
    octaves = '<integer name="octaves" value="3"/>'  # the ground's
    assert text.count(octaves) == 1
    (tmp_path / "changed.xml").write_text(text.replace(octaves, octaves + '<integer name="seed" value="1"/>'),
                                          encoding="utf-8")
    changed = load_scene(tmp_path / "changed.xml", width=96, height=64)
    verdict = judge(render(changed, "mixture", 512), reference[1])
    assert verdict.outcome == "fail", verdict.reason
