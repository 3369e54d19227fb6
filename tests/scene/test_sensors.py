"""What the loader takes of a thin lens and a shutter, with Mitsuba's defaults and Mitsuba's refusals."""

from __future__ import annotations

from typing import Any

import pytest

from harness.errors import SceneError
from harness.scene import load_scene

FILM = '<film type="hdrfilm"><rfilter type="box"/></film>'
LENS = '<float name="aperture_radius" value="0.1"/>'


def sensor(inner: str, kind: str = "thinlens") -> str:
    """A sensor element in one line."""
    return f'<sensor type="{kind}">{inner}{FILM}</sensor>'


def test_a_lens_and_a_shutter_are_read(write: Any) -> None:
    """Radius, focus and times as given."""
    camera = load_scene(write(sensor=sensor(
        f'{LENS}<float name="focus_distance" value="4"/><float name="shutter_open" value="-1"/>'
        '<float name="shutter_close" value="2.5"/>'))).camera
    assert (camera.aperture_radius, camera.focus_distance, camera.shutter) == (0.1, 4.0, (-1.0, 2.5))


def test_defaults_are_those_of_mitsuba(mi: Any, write: Any) -> None:
    """A lens is focused on the far plane, and a shutter opens at time 0 for a moment."""
    path = write(sensor=sensor(f'{LENS}<float name="far_clip" value="300"/>'))
    camera, theirs = load_scene(path).camera, mi.load_file(str(path)).sensors()[0]
    assert camera.focus_distance == pytest.approx(theirs.focus_distance())
    assert camera.shutter == (theirs.shutter_open(), theirs.shutter_open() + theirs.shutter_open_time()) == (0, 0)


REFUSED_BY_BOTH = {
    "no aperture": (sensor(""), "sensor 'thinlens' needs 'aperture_radius'"),
    "shutter that closes first": (sensor(f'{LENS}<float name="shutter_open" value="1"/>'),
                                  "'shutter_close' must not lie before 'shutter_open', found 0 and 1"),
    "principal point": (sensor(f'{LENS}<float name="principal_point_offset_x" value="0.1"/>'),
                        "property 'principal_point_offset_x' of sensor 'thinlens' is not supported"),
    "lens on a pinhole": (sensor(LENS, "perspective"), "property 'aperture_radius' of sensor 'perspective'"),
}
REFUSED = {
    **REFUSED_BY_BOTH,
    "aperture negative": (sensor('<float name="aperture_radius" value="-1"/>'),
                          "'aperture_radius' must not be negative, found -1"),
    "aperture NaN": (sensor('<float name="aperture_radius" value="nan"/>'), "'aperture_radius' must be finite"),
    "focus 0": (sensor(f'{LENS}<float name="focus_distance" value="0"/>'),
                "'focus_distance' must be positive, found 0"),
    "focus behind": (sensor(f'{LENS}<float name="focus_distance" value="-2"/>'),
                     "'focus_distance' must be positive, found -2"),
    "shutter infinite": (sensor(f'{LENS}<float name="shutter_close" value="inf"/>'), "'shutter_close' must be finite"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_lenses_and_shutters_are_refused(write: Any, case: str) -> None:
    """One line, at the sensor's own."""
    element, message = REFUSED[case]
    path = write(sensor=element)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}:2: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("case", REFUSED_BY_BOTH)
def test_mitsuba_refuses_them_too(mi: Any, write: Any, case: str) -> None:
    """So no file that Mitsuba takes is turned away for these."""
    path = write(sensor=REFUSED_BY_BOTH[case][0])
    with pytest.raises(RuntimeError):
        mi.load_file(str(path))
