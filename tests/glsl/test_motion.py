"""Moving shapes in the tracer: at every time they are met, and shaded, like shapes that rest where they are then."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.scene import Scene, load_scene
from harness.scene.model import as_matrix
from harness.scene.motion import screw, settled
from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import TracerRenderer, evaluate

SCENES = Path(__file__).parents[2] / "mitsuba_scenes"
RAYS = 4000
NO_HIT = 1e30  # lib/shapes.glsl
SHUTTER = (-0.5, 3.0)  # opens before time 0, and long enough for the fastest to go round more than once
MOTIONS = {
    "translation": '<translate x="0.4" y="-0.3" z="0.2"/>',
    "turn about itself": '<rotate y="1" angle="70"/>',
    "screw": '<translate x="-0.5"/><rotate x="0.6" z="0.8" angle="170"/><translate x="0.6" y="0.2"/>',
    "hardly a turn": '<rotate x="0.6" z="0.8" angle="0.001"/><translate x="0.2" y="0.2"/>',
}
KINDS = ("sphere", "rectangle", "disk", "cube", "cylinder")
SENSOR = """<sensor type="perspective"><float name="shutter_open" value="{}"/><float name="shutter_close" value="{}"/>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film>
</sensor>"""
# From so far off, rays of the file's coordinates are those of the scene's frame.
AFAR = SENSOR.replace("<film", '<transform name="to_world"><lookat origin="0, 0, 30" target="0, 0, 0" up="0, 1, 0"/>'
                               "</transform><film")


def body(motions: list[str], kinds: tuple[str, ...] = KINDS) -> str:
    """Small emitters of each kind in a row, with the motions in turn."""
    return "".join(f"""<shape type="{kind}"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="40"/>
        <translate x="{1.5 * i - 3}" y="{0.3 * i}"/></transform>
        <transform name="motion">{motions[i % len(motions)]}</transform>
        <emitter type="area"><texture name="radiance" type="checkerboard"><transform name="to_uv"><scale value="3"/>
        </transform></texture></emitter></shape>""" for i, kind in enumerate(kinds))


def posed(scene: Scene, time: float) -> Scene:
    """Nothing moves: every shape where it is at `time`."""
    return settled(dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, shutter=(time, time))))


def trace(scene: Scene, o: np.ndarray, d: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Normal, distance, emission and id, (N, 8), of rays at the times that the numbers u stand for."""
    inputs = np.c_[o, np.full(len(o), NO_HIT)], np.c_[d, u]
    return evaluate("intersect.frag", *inputs, outputs=2, generated={"scene.glsl": scene_chunk(scene, "mixture")})


def rounding(motion: Any, time: float, distance: float) -> float:
    """How far apart float32 may put the hits of a shape that moves and of one at rest, `distance` along a ray.

    Two intersections at coordinates of about 8 are each off by up to three half-ulps. A turn adds an angle's error: of
    the time, a product and a sum, and of the revolutions, a product by a rounded literal. And it adds a pose that
    stretches: `cos_sin` is good to 1e-7, so its pair is not of unit length, and each doubling of the angle, by
    (1 - 2 y², 2 x y), multiplies that by 4 y²: eightfold in all for a half turn, nothing for none. A longer direction
    makes distances shorter.
    """
    radius = 4.0  # of the shapes' places about the axes, with some of the shapes
    angle = screw(motion).angle
    revolutions = angle * time / math.tau
    turned = math.tau * (revolutions - round(revolutions))
    drift = angle * np.spacing(np.float32(abs(time))) + math.tau * np.spacing(np.float32(abs(revolutions)))
    stretch = 16 * math.sin(turned / 4) ** 2 * math.sin(turned / 2) ** 2 * 1e-7
    return float(3 * np.spacing(np.float32(8)) + drift * radius + stretch * (radius + distance))


@pytest.mark.parametrize("motions", [[name] for name in MOTIONS] + [list(MOTIONS)], ids=lambda names: ", ".join(names))
@pytest.mark.parametrize("u", [0.0, 0.3, 0.99])
def test_rays_meet_moving_shapes_where_they_are(scene: Any, motions: list[str], u: float) -> None:
    """Distances, normals, emission and identities are those of a scene at rest in that pose, made on the host."""
    loaded = scene(body([MOTIONS[name] for name in motions]), sensor=AFAR.format(*SHUTTER))
    still = posed(loaded, SHUTTER[0] + (SHUTTER[1] - SHUTTER[0]) * u)
    rng = np.random.default_rng(3)
    places = np.array([shape.matrix[:3, 3] for shape in still.shapes])
    target = places[rng.integers(len(places), size=RAYS)] + rng.uniform(-0.6, 0.6, (RAYS, 3))
    o = np.float32(rng.uniform(-6, 6, (RAYS, 3)))
    d = target - o
    d = np.float32(d / np.linalg.norm(d, axis=1, keepdims=True))
    found, expected = trace(loaded, o, d, np.full(RAYS, u)), trace(still, o, d, np.zeros(RAYS))
    # Where rounding decides, at a silhouette or an edge of the checkerboard, the two may differ.
    same = (found[:, 7] == expected[:, 7]) & (np.abs(found[:, 4:7] - expected[:, 4:7]).max(axis=1) < 1e-6)
    assert same.mean() > 0.995
    hit = same & (expected[:, 7] >= 0)
    assert hit.sum() > RAYS / 4 and len(set(expected[hit, 7])) == len(KINDS)
    grazing = np.abs((expected[hit, :3] * d[hit]).sum(axis=1))
    allowed = [rounding(loaded.shapes[int(row[7])].motion, still.camera.shutter[0], row[3]) for row in expected[hit]]
    assert np.quantile(np.abs(found[hit, 3] - expected[hit, 3]) * grazing / allowed, 0.999) < 1
    assert np.quantile(np.abs(found[hit, :3] - expected[hit, :3]).max(axis=1), 0.99) < 2e-5
    np.testing.assert_allclose(np.linalg.norm(found[hit, :3], axis=1), 1, atol=1e-5)  # of small shapes, six units off


def test_times_are_uniform_over_the_shutters_interval(scene: Any) -> None:
    """A wall that recedes at constant speed: distances of rays at random numbers are those of their own times."""
    wall = """<shape type="rectangle"><transform name="to_world"><scale value="100"/><translate z="5"/></transform>
        <transform name="motion"><translate z="2"/></transform></shape>"""
    loaded = scene(wall, sensor=AFAR.format(*SHUTTER))
    u = np.random.default_rng(1).random(1000)
    found = trace(loaded, np.zeros((1000, 3)), np.tile([0.0, 0.0, 1.0], (1000, 1)), u)
    np.testing.assert_allclose(found[:, 3], 5 + 2 * (SHUTTER[0] + (SHUTTER[1] - SHUTTER[0]) * u), rtol=1e-6)


def test_a_moment_is_a_scene_at_rest(scene: Any) -> None:
    """A shutter of no length shows the pose at that time, by the code of a scene that knows no motion."""
    loaded = scene(body(list(MOTIONS.values())), sensor=AFAR.format(0.75, 0.75))
    chunk = scene_chunk(loaded, "mixture")
    assert "HAS_MOTION 0" in chunk and "path_time" not in chunk
    assert chunk == scene_chunk(posed(loaded, 0.75), "mixture")
    carried = screw(loaded.shapes[0].motion).pose(0.75) @ loaded.shapes[0].matrix
    assert settled(loaded).shapes[0].to_world == as_matrix(carried)


@pytest.mark.parametrize("name", ["spheres", "depth_of_field"])
def test_scenes_at_rest_do_not_pay(name: str) -> None:
    """However long their shutter is open."""
    loaded = load_scene(SCENES / f"{name}.xml")
    open_ = dataclasses.replace(loaded, camera=dataclasses.replace(loaded.camera, shutter=(0.0, 1.0)))
    assert scene_chunk(open_, "mixture") == scene_chunk(loaded, "mixture")
    assert "HAS_MOTION 0" in scene_chunk(loaded, "mixture") and "lib/motion.glsl" not in scene_chunk(loaded, "mixture")


def test_shapes_that_share_a_motion_share_its_pose() -> None:
    """motion_blur.xml: two translations, the box's screw, and one turn of both blades."""
    chunk = scene_chunk(load_scene(SCENES / "motion_blur.xml"), "mixture")
    assert chunk.count("= screw_pose(") == 2
    assert chunk.count("vec3 o_") == 4 and chunk.count("vec3 d_") == 2


def test_motion_leaves_no_sample_out() -> None:
    """And is the same to the bit however the samples are divided."""
    renderer = TracerRenderer(load_scene(SCENES / "motion_blur.xml", width=32, height=24), "mixture")
    whole = renderer.render_batch(2, 0, 32)
    renderer._pingpong.max_samples = 5
    parts = renderer.render_batch(2, 0, 32)
    renderer.release()
    assert whole.rejected == 0
    np.testing.assert_array_equal(whole.mean, parts.mean)


CAMERA = '<transform name="to_world"><lookat origin="0,0,6" target="0,0,0" up="0,1,0"/></transform>'
SKY = '<emitter type="constant"><float name="radiance" value="1"/></emitter>'


def image(scene: Scene, samples: int = 256) -> np.ndarray:
    """The mean by cosine sampling, (16, 16, 3): without variance on a convex diffuse body under an even sky."""
    renderer = TracerRenderer(scene, "cosine")
    try:
        return renderer.render_batch(0, 0, samples).mean
    finally:
        renderer.release()


def before_camera(shutter: tuple[float, float]) -> str:
    """A sensor that looks at the origin from z = 6."""
    return SENSOR.format(*shutter).replace("<film", f'<float name="fov" value="20"/>{CAMERA}<film')


def test_a_turning_body_keeps_its_albedo(scene: Any) -> None:
    """Under an even sky a convex diffuse body is its albedo, however it turns: no ray starts into it, or misses light.

    Normals that stay at rest would. Pixels that the box always fills are exact.
    """
    cube = """<shape type="cube"><transform name="to_world"><scale value="0.5"/></transform>
        <transform name="motion"><rotate x="0.6" z="0.8" angle="90"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.5, 0.2"/></bsdf></shape>"""
    found = image(scene(cube + SKY, sensor=before_camera(SHUTTER)))[6:10, 6:10]
    np.testing.assert_allclose(found, np.broadcast_to([0.8, 0.5, 0.2], (4, 4, 3)), rtol=1e-5)


@pytest.mark.parametrize("texture", ["marble", "checkerboard"])
@pytest.mark.parametrize("what", ["reflectance", "radiance"])
@pytest.mark.parametrize("kind", ["sphere", "cube"])
def test_textures_move_with_the_shape(scene: Any, kind: str, what: str, texture: str) -> None:
    """A shutter that closes at once after it opened sees what one of a single moment sees: the same film samples."""
    element = f'<texture type="{texture}" name="{what}"/>'
    surface = f'<bsdf type="diffuse">{element}</bsdf>' if what == "reflectance" else (
        f'<bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf><emitter type="area">{element}</emitter>')
    body = f"""<shape type="{kind}"><transform name="to_world"><scale value="0.8"/></transform>
        <transform name="motion">{MOTIONS["screw"]}</transform>{surface}</shape>{SKY}"""
    found = image(scene(body, sensor=before_camera((0.4, 0.4000001))), samples=64)
    expected = image(scene(body, sensor=before_camera((0.4, 0.4))), samples=64)
    assert np.ptp(expected[4:12, 4:12]) > 0.05, "the texture shows"
    assert np.median(np.abs(found - expected)) < 1e-5
    assert np.abs(found - expected).max() < 0.03, "samples at the edge of a square may fall on either side"
