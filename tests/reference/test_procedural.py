"""The plugins `fractal`, `marble` and `wood` in Mitsuba: what they evaluate to, where they lie, and as lights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.reference.prepare import instantiate
from harness.reference.procedural import read
from harness.scene import load_scene
from harness.scene.model import Procedural
from harness.scene.noise import NUMPY
from harness.scene.procedural import KINDS, evaluate, ramp

HEAD = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="3"/></integrator>
<sensor type="perspective"><film type="hdrfilm"/></sensor>"""


def points(count: int = 500) -> np.ndarray:
    """Points (N, 3) of the unit cube, exact in float32."""
    return np.random.default_rng(2).uniform(-1, 1, (count, 3)).astype(np.float32).astype(np.float64)


def interaction(mi: Any, p: np.ndarray) -> Any:
    """Surface interactions at points, seen from the front."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(p))
    si.p = mi.Point3f(*(np.ascontiguousarray(c) for c in p.T))
    si.wi = mi.Vector3f(0, 0, 1)
    return si


def colour(texture: Procedural, p: np.ndarray) -> np.ndarray:
    """The texture (N, 3) at points of texture space, in float64."""
    t, _ = evaluate(NUMPY, texture, (p[:, 0], p[:, 1], p[:, 2]))
    return np.stack([ramp(NUMPY, t, stops)[0] for stops in zip(*texture.colors, strict=True)], axis=-1)


@pytest.mark.parametrize("kind", KINDS)
def test_defaults_are_the_loaders(mi: Any, tmp_path: Path, kind: str) -> None:
    """A texture without parameters means the same to both, but for the frequency, which the plugin folds away."""
    path = tmp_path / "scene.xml"
    path.write_text(f'{HEAD}<shape type="sphere"><bsdf type="diffuse"><texture type="{kind}" name="reflectance"/>'
                    "</bsdf></shape></scene>", encoding="utf-8")
    texture = load_scene(path).shapes[0].material.kd
    assert isinstance(texture, Procedural)
    plugin = mi.load_dict({"type": kind})
    found = np.array(plugin.eval(interaction(mi, points()))).T
    np.testing.assert_allclose(found, colour(texture, points()), atol=5e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_evaluations_agree(mi: Any, kind: str) -> None:
    """eval, eval_3 and eval_1, which is the luminance; black where inactive. max and mean are those of the colours."""
    plugin = mi.load_dict({"type": kind, "color0": {"type": "rgb", "value": [0.1, 0.9, 0.3]}, "color1": 0.5,
                           "color2": {"type": "rgb", "value": [3.0, 0.0, 1.0]}})
    si = interaction(mi, points())
    value = np.array(plugin.eval(si)).T
    np.testing.assert_array_equal(np.array(plugin.eval_3(si)).T, value)
    np.testing.assert_allclose(np.array(plugin.eval_1(si)), value @ [0.212671, 0.715160, 0.072169], atol=1e-5)
    odd = np.arange(len(value)) % 2 == 1
    np.testing.assert_array_equal(np.array(plugin.eval(si, mi.Bool(odd))).T, value * odd[:, None])
    assert value.max() <= plugin.max() == 3.0 and np.ravel(plugin.mean())[0] == pytest.approx(6.8 / 9)
    assert "octaves=4" in str(plugin)


def test_colours_and_transforms_are_read(mi: Any) -> None:
    """As Mitsuba gives them to a plugin; the transforms and the frequency become one."""
    props = mi.Properties("wood")
    props["color0"], props["color1"], props["color2"] = mi.ScalarColor3f(0.1, 0.2, 0.3), 0.5, mi.ScalarColor3f(1, 0, 2)
    props["to_texture"] = mi.ScalarAffineTransform4d().translate([0, 0, 1])
    props["to_object"] = mi.ScalarAffineTransform4d().scale([2, 1, 1])
    props["frequency"], props["octaves"], props["seed"] = 3.0, 7, 2**32 - 1
    texture = read(props)
    np.testing.assert_allclose(texture.colors, [[0.1, 0.2, 0.3], [0.5, 0.5, 0.5], [1, 0, 2]], atol=1e-7)
    np.testing.assert_array_equal(texture.to_texture, [[6, 0, 0, 0], [0, 3, 0, 0], [0, 0, 3, 3], [0, 0, 0, 1]])
    assert (texture.frequency, texture.octaves, texture.seed) == (1.0, 7, 2**32 - 1)


def test_variants_without_unsigned_arrays_are_refused(mi: Any) -> None:
    """In which the noise would be another one, without a word."""
    mi.set_variant("scalar_rgb")
    with pytest.raises(RuntimeError, match="marble: variant scalar_rgb is not supported; use llvm_ad_rgb"):
        mi.load_dict({"type": "marble"})


LIGHTS = {
    "rectangle": '<transform name="to_world"><scale x="2" y="0.7"/><rotate x="0.6" y="0.8" angle="40"/></transform>',
    "disk": '<transform name="to_world"><rotate x="0.6" y="0.8" angle="-20"/><scale value="1.3"/></transform>',
    "sphere": '<point name="center" x="0.2" y="-0.3" z="0.1"/><float name="radius" value="1.2"/>',
}


def surface(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3), normals and areas of little cells that cover a shape in object space."""
    side = 700
    u, v = ((np.arange(side) + 0.5) / side for _ in range(2))
    u, v = (grid.ravel() for grid in np.meshgrid(u, v))
    if kind == "rectangle":
        p, area = np.stack([2 * u - 1, 2 * v - 1, 0 * u], axis=-1), np.full(len(u), 4.0)
    elif kind == "disk":
        p = np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v), 0 * u], axis=-1)
        area = np.full(len(u), np.pi)
    else:
        z, phi = 2 * u - 1, 2 * np.pi * v
        p = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=-1)
        area = np.full(len(u), 4 * np.pi)
    return p, p if kind == "sphere" else np.broadcast_to([0.0, 0.0, 1.0], p.shape), area / side**2


@pytest.mark.parametrize("kind", LIGHTS)
def test_sampled_lights_have_the_right_power(mi: Any, tmp_path: Path, kind: str) -> None:
    """Mitsuba's light sampling with a textured radiance against quadrature of ∫ L cos θ / r² dA over the shape."""
    import drjit as dr

    path = tmp_path / "scene.xml"
    path.write_text(f'{HEAD}<shape type="{kind}">{LIGHTS[kind]}<emitter type="area"><texture type="marble" '
                    'name="radiance"><rgb name="color0" value="9, 1, 0"/><rgb name="color1" value="0, 2, 5"/></texture>'
                    "</emitter></shape></scene>", encoding="utf-8")
    scene = load_scene(path)
    shape = scene.shapes[0]
    assert isinstance(shape.emission, Procedural)
    at = np.array([0.7, 0.4, 4.0])
    p, n, area = surface(kind)
    linear, origin = shape.matrix[:3, :3], shape.matrix[:3, 3]
    normal = n @ np.linalg.inv(linear)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Areas grow by |det A| |A⁻ᵀ n|.
    grown = area * abs(np.linalg.det(linear)) * np.linalg.norm(n @ np.linalg.inv(linear), axis=1)
    away = at - (p @ linear.T + origin)
    distance = np.linalg.norm(away, axis=1)
    cosine = np.maximum(np.sum(away * normal, axis=1) / distance, 0)
    exact = (colour(shape.emission, p) * (cosine / distance**2 * grown)[:, None]).sum(axis=0)

    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p = mi.Point3f(at)
    random = np.random.default_rng(0).uniform(size=(2, 1 << 18))
    made = instantiate(scene.file)  # must outlive what is computed from it
    _, weight = made.emitters()[0].sample_direction(si, mi.Point2f(random))
    found = np.array(weight)
    error = found.std(axis=1) / np.sqrt(found.shape[1])
    assert (error < 3e-3 * exact).all()
    assert (np.abs(found.mean(axis=1) - exact) < stats.norm.isf(1e-4) * error + 1e-4 * exact).all()
