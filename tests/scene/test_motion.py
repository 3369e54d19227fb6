"""Motion of shapes: powers of a rigid transform against the matrix logarithm, and what the loader takes and refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from harness.errors import SceneError
from harness.scene import load_scene
from harness.scene.model import as_matrix
from harness.scene.motion import moving, screw, settled

SENSOR = """<sensor type="perspective"><float name="shutter_open" value="{}"/><float name="shutter_close" value="{}"/>
<film type="hdrfilm"><rfilter type="box"/></film></sensor>"""
TURN = '<rotate z="1" angle="90"/><translate x="2"/>'


def rigid(angle: float, seed: int) -> np.ndarray:
    """A rotation by `angle` radians about a random axis and a random translation, (4, 4)."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    matrix[:3, 3] = rng.normal(0, 3, 3)
    return matrix


def moved(inner: str, kind: str = "cube") -> str:
    """A shape with a motion."""
    return f'<shape type="{kind}"><transform name="motion">{inner}</transform></shape>'


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.5, np.pi / 2, 3.0, 3.1415])
def test_poses_are_powers_of_the_motion(angle: float) -> None:
    """By SciPy's matrix logarithm and exponential, before, within and beyond the unit of time."""
    motion = rigid(angle, seed=int(1000 * angle))
    steady = screw(as_matrix(motion))
    assert steady.angle == pytest.approx(angle, abs=1e-12)
    generator = logm(motion).real
    for time in (-2.5, 0.0, 0.25, 1.0, 7.0):
        np.testing.assert_allclose(steady.pose(time), expm(time * generator), rtol=0, atol=1e-9)
    np.testing.assert_allclose(steady.pose(1), motion, rtol=0, atol=1e-9)


def test_a_translation_is_linear() -> None:
    """No turn, so no slide along an axis of rounding errors either."""
    motion = np.eye(4)
    motion[:3, 3] = 1, 2, 3
    np.testing.assert_array_equal(screw(as_matrix(motion)).pose(0.5)[:3, 3], [0.5, 1, 1.5])
    assert screw(as_matrix(motion)).angle == 0


def test_a_motion_is_read_from_the_file(write: Any) -> None:
    """As it stands there, after `to_world`, on every kind of shape; without one there is none."""
    for kind in ("sphere", "rectangle", "disk", "cube", "cylinder"):
        (shape,) = load_scene(write(moved(TURN, kind))).shapes
        np.testing.assert_allclose(shape.motion, [[0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)
        np.testing.assert_array_equal(shape.matrix, np.eye(4))
    (shape,) = load_scene(write('<shape type="cube"/>')).shapes
    assert shape.motion is None


def test_any_turn_below_a_half_is_a_motion(write: Any) -> None:
    """The message on half turns is for them alone."""
    for degrees in (-179.9, 150, 179.9):
        (shape,) = load_scene(write(moved(f'<rotate x="0.6" z="0.8" angle="{degrees}"/>'))).shapes
        assert screw(shape.motion).angle == pytest.approx(np.radians(abs(degrees)))


def test_a_rotation_of_rounded_numbers_is_made_one(write: Any) -> None:
    """Five digits of a matrix are read as the nearest rotation, so that powers neither grow nor shrink."""
    (shape,) = load_scene(write(moved('<matrix value="0.86603 -0.5 0  0.5 0.86603 0  0 0 1"/>'))).shapes
    turn = np.array(shape.motion)[:3, :3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-14)
    assert screw(shape.motion).angle == pytest.approx(np.radians(30), abs=1e-5)


@pytest.mark.parametrize("inner", ["", '<translate x="0"/>', '<rotate z="1" angle="360"/>'])
def test_a_motion_to_the_same_place_is_none(write: Any, inner: str) -> None:
    """It changes no image, and so neither the shader nor the scene's hash."""
    scene = load_scene(write(moved(inner), sensor=SENSOR.format(0, 1)))
    assert scene.shapes[0].motion is None
    assert scene.content_hash == load_scene(write('<shape type="cube"/>', sensor=SENSOR.format(0, 1))).content_hash


def test_a_motion_changes_the_hash(write: Any) -> None:
    """And so does the time for which the shutter is open."""
    scenes = [load_scene(write(moved(inner), sensor=SENSOR.format(0, close)))
              for inner in ('<translate x="1"/>', '<translate x="2"/>') for close in (1, 2)]
    assert len({scene.content_hash for scene in scenes}) == 4


def test_shapes_move_while_the_shutter_is_open(write: Any) -> None:
    """A moment shows them at rest where they are then; without motion nothing changes."""
    body = f'<shape type="sphere"/>{moved(TURN)}'
    opened = load_scene(write(body, sensor=SENSOR.format(0.25, 0.5)))
    assert moving(opened) == (1,) and settled(opened) is opened
    moment = load_scene(write(body, sensor=SENSOR.format(0.5, 0.5)))
    assert moving(moment) == ()
    sphere, cube = settled(moment).shapes
    assert sphere is moment.shapes[0] and cube.motion is None
    np.testing.assert_allclose(cube.matrix, screw(moment.shapes[1].motion).pose(0.5), atol=1e-15)
    still = load_scene(write('<shape type="sphere"/>', sensor=SENSOR.format(0, 1)))
    assert moving(still) == () and settled(still) is still


@pytest.mark.parametrize(("inner", "message"), [
    ('<scale value="1.1"/>', "'motion' must be rigid"),
    ('<scale x="-1"/>', "'motion' must be rigid"),
    ('<matrix value="1 .2 0 0 1 0 0 0 1"/>', "'motion' must be rigid"),
    ('<rotate x="1" y="1" angle="30"/>', "a rotation's axis must have length 1"),
    ('<scale value="0"/>', "'motion' is degenerate"),
    ('<translate x="nan"/>', "'motion' must be a finite affine transform"),
    ('<rotate y="1" angle="180"/>', "'motion' turns by 180 degrees in a unit of time"),
    ('<rotate x="0.6" z="0.8" angle="-180"/><translate x="1"/>', "keep the shutter open for longer"),
])
def test_what_is_no_motion_is_refused(write: Any, inner: str, message: str) -> None:
    """Scales, shears, mirrors, half turns: one line, at the shape's own."""
    path = write(moved(inner))
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}:5: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("body", ['<shape type="cube"><float name="motion" value="1"/></shape>',
                                  '<bsdf type="diffuse"><transform name="motion"/></bsdf>'])
def test_a_motion_elsewhere_is_refused(write: Any, body: str) -> None:
    """It is a transform, of a shape."""
    with pytest.raises(SceneError, match=r"'motion' must be a <transform>|property 'motion' of bsdf"):
        load_scene(write(body))
