"""Displaced spheres in scene files, and the bounds on their surface that marching relies on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.errors import SceneError
from harness.scene import load_scene
from harness.scene.displaced import _grid, bounds, certain_bounds, normal, radius
from harness.scene.model import Displacement, Procedural, as_matrix
from tests.scene.conftest import FileWriter

BODY_LINE = 5  # of the file that the fixture `write` makes
FRACTAL = '<texture type="fractal" name="displacement"/>'


def sphere_xml(inner: str = "", texture: str = FRACTAL, amplitude: str = "0.2") -> str:
    """One displaced sphere."""
    return f'<shape type="displacedsphere"><float name="amplitude" value="{amplitude}"/>{texture}{inner}</shape>'


def displacement(**changed: object) -> Displacement:
    """A displacement, fractal unless told otherwise; `amplitude` and any field of the texture."""
    amplitude = changed.pop("amplitude", 0.4)
    values: dict[str, object] = {
        "kind": "fractal", "colors": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), "octaves": 4, "lacunarity": 2.0, "gain": 0.5,
        "frequency": 2.0, "distortion": 1.5, "seed": 3, "to_texture": as_matrix(np.eye(4)), **changed}
    return Displacement(Procedural(**values), amplitude)  # type: ignore[arg-type]


def greys(*values: float) -> tuple[tuple[float, float, float], ...]:
    """Colours of a ramp; only red counts."""
    return tuple((value, 0.5, 0.5) for value in values)


TURNED = as_matrix(np.array([[1.0, 0.4, 0, 0.3], [-0.4, 0.8, 0, 0], [0, 0.2, 1.5, 2], [0, 0, 0, 1]]))
CASES = {
    "fractal": displacement(),
    "inwards": displacement(amplitude=-0.5),
    "rough": displacement(octaves=6, gain=0.7, frequency=3.0),
    "corners": displacement(colors=greys(0, 1, 0.2, 0.9)),
    "turned": displacement(to_texture=TURNED),
    "marble": displacement(kind="marble", octaves=3, frequency=1.5),
    "wood": displacement(kind="wood", octaves=2, frequency=3.0, amplitude=0.2),
}


def directions(count: int) -> np.ndarray:
    """Random unit vectors, (count, 3)."""
    found = np.random.default_rng(5).normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def test_lengths_are_in_the_units_of_the_radius(write: FileWriter) -> None:
    scene = load_scene(write(sphere_xml('<float name="radius" value="4"/><point name="center" x="1" y="2" z="3"/>'
                                        '<transform name="to_world"><scale value="0.5"/></transform>')))
    shape = scene.shapes[0]
    assert shape.displacement is not None and shape.displacement.amplitude == pytest.approx(0.05)
    expected = np.array([[2, 0, 0, 0.5], [0, 2, 0, 1], [0, 0, 2, 1.5], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(shape.matrix, expected)


def test_a_mirrored_displaced_sphere_faces_outwards(write: FileWriter) -> None:
    mirror = '<transform name="to_world"><scale x="-1"/></transform>'
    assert not load_scene(write(sphere_xml(mirror))).shapes[0].flip_normals


@pytest.mark.parametrize(("body", "expected"), [
    (sphere_xml(amplitude="1"), "the displacement reaches 1 "),
    (sphere_xml(amplitude="-1.5"), "lower 'amplitude' or darken the texture"),
    (sphere_xml('<float name="radius" value="0.2"/>'), "not less than the radius, 0.2"),
    (sphere_xml(texture=""), "needs a texture named 'displacement'; supported: fractal, marble, wood"),
    (sphere_xml(texture='<float name="displacement" value="1"/>'), "needs a texture named 'displacement'"),
    (sphere_xml(texture='<texture type="checkerboard" name="displacement"/>'), "the surface would be torn"),
    (sphere_xml(texture='<texture type="bitmap" name="displacement"/>'), "a bitmap cannot displace"),
    (sphere_xml(texture='<texture type="fractal" name="displacement"><integer name="octaves" value="0"/></texture>'),
     "'octaves' must be between 1 and 16"),
    (sphere_xml(texture=f'{FRACTAL}<texture type="fractal" name="other"/>'), "supported: bsdf, emitter area"),
    (sphere_xml('<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'),
     "has no surface coordinates"),
    (sphere_xml('<transform name="to_world"><scale x="2" y="1" z="1"/></transform>'), "must not shear or scale"),
    (sphere_xml('<float name="radius" value="0"/>'), "'radius' must be positive"),
    ('<shape type="displacedsphere"/>', "needs 'amplitude'"),
    (sphere_xml('<float name="bumpiness" value="1"/>'), "property 'bumpiness'"),
])
def test_refusals(write: FileWriter, body: str, expected: str) -> None:
    path: Path = write(body)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{BODY_LINE}: ") and "\n" not in message
    assert expected in message


@pytest.mark.parametrize("case", CASES)
def test_bounds_hold_everywhere(case: str) -> None:
    """Brute force: heights, slopes and bends along great circles through random directions stay within them."""
    found = bounds(CASES[case])
    e = directions(40_000)
    across = np.cross(e, np.roll(e, 1, axis=0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = 2e-4  # whose rounding errors, 1e-16 / angle², are far below any bend
    r, gradient = radius(CASES[case], e)
    before, after = (radius(CASES[case], np.cos(angle) * e + sign * np.sin(angle) * across) for sign in (-1, 1))
    slope = (gradient * across).sum(axis=1)
    assert found.lowest <= r.min() and r.max() <= found.highest
    assert np.abs(slope).max() <= found.slope
    axis = np.hypot(e[:, 0], e[:, 1])
    bend = np.abs(after[0] - 2 * r + before[0]) / angle**2
    allowed = found.bend + found.axis_bend / np.maximum(axis - angle, 1e-9)
    if case == "corners":  # they bend without end: all but where one lies between
        assert np.mean(bend > allowed) < 0.01
    else:
        assert (bend <= allowed).all()
    assert bend.max() > 0.1 * found.bend  # and they are not idle


@pytest.mark.parametrize("case", CASES)
def test_the_gradient_is_the_derivative(case: str) -> None:
    e, step = directions(500), 1e-6
    _, gradient = radius(CASES[case], e)
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        difference = (radius(CASES[case], e + shift)[0] - radius(CASES[case], e - shift)[0]) / (2 * step)
        assert np.quantile(np.abs(difference - gradient[:, axis]), 0.99) < 1e-4


def test_normals_are_those_of_the_surface() -> None:
    """At right angles to the surface's own tangents, by finite differences."""
    e, step = directions(300), 1e-6
    exact = normal(e, *radius(CASES["fractal"], e))
    for across in (np.roll(e, 1, axis=0), np.roll(e, 2, axis=0)):
        moved = e + step * across
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        here, there = (d * radius(CASES["fractal"], d)[0][:, None] for d in (e, moved))
        tangent = (there - here) / step
        assert np.abs((tangent * exact).sum(axis=1)).max() < 1e-4
    assert ((exact * e).sum(axis=1) > 0).all()


def test_the_grid_leaves_no_direction_farther_than_it_says() -> None:
    grid, apart = _grid()
    nearest = max(float(np.arccos(np.clip((grid @ e).max(), -1, 1))) for e in directions(300))
    assert 0.3 * apart < nearest <= apart


def test_values_tighten_bounds_and_never_loosen_them() -> None:
    certain, found = certain_bounds(CASES["fractal"]), bounds(CASES["fractal"])
    assert certain.lowest < found.lowest and found.highest < certain.highest and found.slope < certain.slope
