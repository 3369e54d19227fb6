"""Shapes of a scene file: what is refused of them, with file and line, and where the cylinder's ends come to lie."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from harness.errors import SceneError
from harness.scene import load_scene

BODY_LINE = 5  # of the file that the fixture `write` makes


def shape(kind: str, inner: str) -> str:
    """A shape element."""
    return f'<shape type="{kind}">{inner}</shape>'


def under(operations: str) -> str:
    """A transform of these operations."""
    return f'<transform name="to_world">{operations}</transform>'


def ends(p0: str, p1: str) -> str:
    """A cylinder's ends, each as "x y z"."""
    return "".join(f'<point name="{name}" value="{value}"/>' for name, value in (("p0", p0), ("p1", p1)))


LIGHT = '<emitter type="area"/>'
FLAT = "degenerate (it flattens the object); every scale factor must differ from 0"
REFUSED = {
    "no length": ("cylinder", ends("1 2 3", "1 2 3"), "'p0' and 'p1' must differ, found 1, 2, 3 for both"),
    "no length in float32": ("cylinder", ends("0 0 2e8", "0 0 200000001"),
                             "'p0' and 'p1' must differ, found 0, 0, 2e+08 for both"),
    "radius 0": ("cylinder", '<float name="radius" value="0"/>', "'radius' must be positive, found 0"),
    "radius below 0": ("cylinder", '<float name="radius" value="-2"/>', "'radius' must be positive, found -2"),
    "radius NaN": ("cylinder", '<float name="radius" value="nan"/>', "'radius' must be finite"),
    "end NaN": ("cylinder", '<point name="p1" x="0" y="nan" z="0"/>', "'p1' must be a point of three finite numbers"),
    "end as a number": ("cylinder", '<float name="p0" value="1"/>', "'p0' must be a point of three finite numbers"),
    "center of a cylinder": ("cylinder", '<point name="center" x="0" y="0" z="0"/>',
                             "'center' of shape 'cylinder' is not supported; supported: p0, p1, radius, to_world"),
    "oval light": ("cylinder", under('<scale x="2"/>') + LIGHT,
                   "'to_world' of a cylinder that emits must keep it round and upright"),
    "leaning light": ("cylinder", under('<matrix value="1 0 .2 0 1 0 0 0 1"/>') + LIGHT,
                      "must keep it round and upright"),
    "mirrored light": ("cylinder", under('<scale x="-1"/>') + LIGHT, "must not mirror it, since Mitsuba would light"),
    "sphere too small": ("sphere", '<float name="radius" value="1e-20"/>', "the sphere is too small for float32"),
    "too small for its place": ("sphere", '<float name="radius" value="1e-10"/><point name="center" value="1e10 0 0"/>',
                                "the sphere is too small for float32, or for its distance from the origin; scale it"),
    "sphere too large": ("sphere", '<float name="radius" value="1e20"/>',
                         "the sphere is too large or too far away for float32; scale the scene down"),
    "cylinder too far away": ("cylinder", ends("1e20 0 0", "0 0 1"), "the cylinder is too large or too far away"),
    "cube too far away": ("cube", under('<translate x="1e20"/>'), "the cube is too large or too far away"),
    **{f"{kind} scaled to nothing": (kind, under('<scale value="0"/>'), FLAT)
       for kind in ("sphere", "rectangle", "disk", "cube", "cylinder")},
    **{f"{kind} flattened by two operations": (kind, under('<rotate y="1" angle="30"/><scale x="0"/>'), FLAT)
       for kind in ("sphere", "rectangle", "disk", "cube", "cylinder")},
    **{f"{kind} with a NaN": (kind, under('<scale value="nan"/>'), "must be a finite affine transform")
       for kind in ("sphere", "rectangle", "disk", "cube", "cylinder")},
    "rotation about a long axis": ("sphere", under('<rotate x="1" y="1" angle="20"/>'),
                                   "use rotation (about an axis of length 1), translation and uniform scale"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(write: Any, case: str) -> None:
    """One line that names the file, the line of the shape among others, what was found and what is allowed."""
    kind, inner, expected = REFUSED[case]
    path = write(shape("sphere", "") + "\n\n" + shape(kind, inner))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{BODY_LINE + 2}: ")
    assert expected in message and "\n" not in message


@pytest.mark.parametrize(("kind", "inner"), [
    ("cylinder", under('<scale x="2" y="-1" z="3"/>')),
    ("cylinder", under('<matrix value="1 .3 .2 0 1 0 .4 0 1"/>')),
    ("cylinder", under('<rotate y="0.6" z="0.8" angle="50"/><scale value="3"/>') + LIGHT),
    ("cylinder", under('<scale z="4"/>') + LIGHT),
    ("disk", under('<scale x="2"/><rotate y="1" angle="20"/>') + LIGHT),
    ("rectangle", under('<matrix value="1 .3 .2 0 -1 0 .4 0 1"/>') + LIGHT),
    ("cube", under('<scale x="2" y="-1" z="3"/>') + LIGHT),
    ("sphere", under('<scale x="-1"/>') + LIGHT),
])
def test_what_mitsuba_renders_rightly_is_taken(write: Any, kind: str, inner: str) -> None:
    """Uneven, leaning and mirrored, where the tracer's tests compare it with Mitsuba."""
    assert load_scene(write(shape(kind, inner))).shapes[0].kind == kind


@pytest.mark.parametrize(("p0", "p1"), [("0 0 0", "0 0 1"), ("1 2 3", "1 2 -1"), ("0 0 -1", "3 0 -1"),
                                        ("-1 2 0.5", "1.5 -0.5 0.2")])
def test_the_axis_runs_from_p0_to_p1(mi: Any, write: Any, p0: str, p1: str) -> None:
    """Object-space z is 0 at p0 and 1 at p1, and Mitsuba's u begins on the same side, whichever way the axis points."""
    path = write(shape("cylinder", ends(p0, p1) + '<float name="radius" value="0.25"/>'
                       + under('<scale value="2"/><translate x="3"/>')))
    matrix = load_scene(path).shapes[0].matrix
    start, end = (2 * np.array([float(c) for c in p.split()]) + [3, 0, 0] for p in (p0, p1))
    np.testing.assert_allclose(matrix @ [[0, 0], [0, 0], [0, 1], [1, 1]], np.c_[[*start, 1], [*end, 1]], atol=1e-12)
    axes = matrix[:3, :3] / [0.5, 0.5, np.linalg.norm(end - start)]
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0
    local = np.array([[np.cos(0.3), np.sin(0.3), 0.75, 1]]) @ matrix.T
    inwards = -(axes @ [np.cos(0.3), np.sin(0.3), 0])
    theirs = mi.load_file(str(path))  # must outlive the evaluation of what it is asked
    si = theirs.ray_intersect(mi.Ray3f((local[0, :3] - inwards).tolist(), inwards.tolist()))
    np.testing.assert_allclose(np.ravel(si.uv), [0.3 / (2 * np.pi), 0.75], atol=1e-5)
