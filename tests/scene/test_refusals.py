"""What the loader refuses: always one line that begins `file:line:`, names the culprit and says what is supported."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from harness.errors import SceneError
from harness.scene import describe, load_scene

# The lines of the file that the fixture `write` makes.
SENSOR_LINE, INTEGRATOR_LINE, BODY_LINE = 2, 4, 5


def refusal(path: Path) -> str:
    """The message of the SceneError; fails where the scene loads, or the message has more than one line."""
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert "\n" not in message
    return message


def shape(inner: str, kind: str = "sphere") -> str:
    """A shape element."""
    return f'<shape type="{kind}">{inner}</shape>'


def bsdf(inner: str, kind: str = "diffuse") -> str:
    """A sphere with a BSDF."""
    return shape(f'<bsdf type="{kind}">{inner}</bsdf>')


def emitter(inner: str) -> str:
    """A sphere that emits."""
    return shape(f'<emitter type="area">{inner}</emitter>')


def to_world(inner: str, kind: str = "sphere") -> str:
    """A shape under a transform."""
    return shape(f'<transform name="to_world">{inner}</transform>', kind)


def sensor(inner: str = "", film: str = "") -> str:
    """A sensor in two lines, as the fixture's is."""
    return f'<sensor type="perspective">{inner}<film type="hdrfilm">{film}</film>\n</sensor>'


BODIES = {
    # shapes
    "unknown shape": (shape("", "torus"), "shape 'torus' is not supported; supported: sphere, rectangle, disk, cube"),
    "mesh": (shape('<string name="filename" value="a.obj"/>', "obj"), "shape 'obj' is not supported"),
    "misspelt property": (shape('<float name="radios" value="1"/>'),
                          "property 'radios' of shape 'sphere' is not supported; supported: center, radius"),
    "property of another shape": (shape('<float name="radius" value="1"/>', "disk"),
                                  "property 'radius' of shape 'disk'"),
    "radius of the wrong type": (shape('<string name="radius" value="1"/>'), "'radius' must be a number, found '1'"),
    "radius as boolean": (shape('<boolean name="radius" value="true"/>'), "'radius' must be a number, found True"),
    "unreadable number": (shape('<float name="radius" value="abc"/>'), 'could not parse floating point value "abc"'),
    "property given twice": (shape('<float name="radius" value="1"/><float name="radius" value="2"/>'), "given twice"),
    "radius 0": (shape('<float name="radius" value="0"/>'), "'radius' must be positive, found 0"),
    "radius negative": (shape('<float name="radius" value="-1"/>'), "'radius' must be positive, found -1"),
    "radius NaN": (shape('<float name="radius" value="nan"/>'), "'radius' must be finite"),
    "radius beyond float32": (shape('<float name="radius" value="1e39"/>'),
                              "'radius' must be finite and at most 3.4e+38"),
    "center of the wrong type": (shape('<float name="center" value="3"/>'), "'center' must be a point"),
    "center NaN": (shape('<point name="center" x="nan" y="0" z="0"/>'), "'center' must be a point of three finite"),
    "flip_normals as text": (shape('<string name="flip_normals" value="yes"/>'),
                             "'flip_normals' must be true or false"),
    "second BSDF": (shape('<bsdf type="diffuse"/><bsdf type="diffuse"/>'), "a shape has one BSDF; this is the second"),
    "second emitter": (shape('<emitter type="area"/><emitter type="area"/>'), "a shape has one emitter"),
    "medium": (shape('<medium name="interior" type="homogeneous"/>'), "medium 'homogeneous' is not supported"),
    "group of shapes": ('<shape type="shapegroup"><shape type="sphere"/></shape>',
                        "shape 'shapegroup' is not supported"),
    # transforms
    "uneven sphere": (to_world('<scale x="2"/>'), "'to_world' of a sphere must not shear or scale unevenly"),
    "sheared sphere": (to_world('<matrix value="1 .2 0 0 1 0 0 0 1"/>'), "must not shear or scale unevenly"),
    "scale 0": (to_world('<scale value="0"/>', "cube"), "degenerate (it flattens the object)"),
    "flattened": (to_world('<scale z="0"/>', "cube"), "degenerate (it flattens the object)"),
    "flattened by a matrix": (to_world('<matrix value="1 1 0 1 1 0 0 0 1"/>', "cube"), "degenerate (it flattens the"),
    "rotation about nothing": (to_world('<rotate x="0" angle="9"/>'), "rotation axis cannot be zero"),
    "too small": (to_world('<scale value="1e-39"/>', "cube"), "too small for float32"),
    "translation NaN": (to_world('<translate x="nan"/>'), "'to_world' must be a finite affine transform"),
    "translation beyond float32": (to_world('<translate x="1e39"/>'), "'to_world' must be a finite affine transform"),
    "number for a transform": (shape('<float name="to_world" value="3"/>'),
                               "'to_world' must be a <transform>, found 3"),
    "lookat at itself": (to_world('<lookat origin="0,0,0" target="0,0,0" up="0,1,0"/>'),
                         "invalid lookat transformation: 'origin' and 'target' must differ, and 'up' must not point"),
    "lookat along up": (to_world('<lookat origin="0,0,5" target="0,0,0" up="0,0,1"/>'), "'up' must not point along"),
    "matrix of 5": (to_world('<matrix value="1 0 0 0 1"/>'), "matrix must have 9 or 16 values, got 5"),
    # BSDFs
    "unknown BSDF": (bsdf("", "ruff"), "bsdf 'ruff' is not supported; supported: phong, diffuse, twosided"),
    "BSDF of Mitsuba": (bsdf("", "roughconductor"), "bsdf 'roughconductor' is not supported"),
    "unused BSDF": ('<bsdf type="dielectric" id="unused"/>', "bsdf 'dielectric' is not supported"),
    "misspelt BSDF property": (bsdf('<rgb name="reflectanse" value="1"/>'), "property 'reflectanse' of bsdf 'diffuse'"),
    "texture of Mitsuba": (bsdf('<texture type="volume" name="reflectance"/>'),
               "texture 'volume' is not supported; supported: bitmap, checkerboard"),
    "texture as exponent": (bsdf('<texture type="volume" name="alpha"/>', "phong"), "texture 'volume'"),
    "BSDF in a BSDF": (bsdf('<bsdf type="diffuse"/>'),
                       "bsdf 'diffuse' is not supported; supported: colours, numbers and textures"),
    "spectrum": (bsdf('<spectrum name="reflectance" value="400:0.1, 700:0.9"/>'), "'reflectance' is a spectrum"),
    "albedo above 1": (bsdf('<rgb name="reflectance" value="0, 1.3, 0"/>'),
                       "diffuse albedo must not exceed 1, found 1.3"),
    "kd above 1": (bsdf('<float name="kd" value="2"/>', "phong"), "diffuse albedo must not exceed 1, found 2"),
    "albedo negative": (bsdf('<rgb name="reflectance" value="-0.3, 0, 0"/>'),
                        "finite and not negative, found -0.3, 0, 0"),
    "albedo NaN": (bsdf('<float name="reflectance" value="nan"/>'), "'reflectance' must be finite and not negative"),
    "ks infinite": (bsdf('<float name="ks" value="inf"/>', "phong"), "'ks' must be finite and not negative"),
    "colour as text": (bsdf('<string name="reflectance" value="red"/>'), "must be a colour or a number, found 'red'"),
    "colour as boolean": (bsdf('<boolean name="reflectance" value="true"/>'),
                          "must be a colour or a number, found True"),
    "colour as vector": (bsdf('<vector name="reflectance" x="1" y="0"/>'), "missing required attribute"),
    "colour of two": (bsdf('<rgb name="reflectance" value="0.1, 0.2"/>'), 'could not parse RGB value "0.1, 0.2"'),
    "alpha negative": (bsdf('<float name="alpha" value="-1"/>', "phong"), "'alpha' must not be negative, found -1"),
    "alpha as text": (bsdf('<string name="alpha" value="x"/>', "phong"), "'alpha' must be a number, found 'x'"),
    "alpha as colour": (bsdf('<rgb name="alpha" value="1, 2, 3"/>', "phong"), "'alpha' must be a number"),
    "twosided around nothing": (bsdf("", "twosided"), "'twosided' takes exactly one nested BSDF, found 0"),
    "twosided around two": (bsdf('<bsdf type="diffuse"/><bsdf type="diffuse"/>', "twosided"),
                            "one nested BSDF, found 2"),
    # emitters
    "emitter of Mitsuba": ('<emitter type="point"/>', "emitter 'point' is not supported; supported: constant"),
    "area light of nothing": ('<emitter type="area"/>', "emitter 'area' is not supported; supported: constant, envmap"),
    "constant in a shape": (shape('<emitter type="constant"/>'),
                            "emitter 'constant' is not supported; supported: area"),
    "second environment": ('<emitter type="constant"/><emitter type="constant"/>', "a scene has one environment"),
    "misspelt radiance": (emitter('<float name="radiannce" value="2"/>'), "property 'radiannce' of emitter 'area'"),
    "radiance negative": (emitter('<float name="radiance" value="-2"/>'), "'radiance' must be finite and not negative"),
    "radiance beyond float32": (emitter('<float name="radiance" value="1e39"/>'), "'radiance' must be finite"),
    "radiance as texture": (emitter('<texture type="volume" name="radiance"/>'), "texture 'volume' is not"),
    # Mitsuba gives (2.41, 1.90, 1.82) for it.
    "radiance as spectrum": (emitter('<spectrum name="radiance" value="2"/>'),
                             "'radiance' is a spectrum; give it as <rgb>"),
    "sky as spectrum": ('<emitter type="constant"><spectrum name="radiance" value="2"/></emitter>', "is a spectrum"),
    # the scene
    "second sensor": ('<sensor type="perspective"/>', "a scene has one sensor; this is the second"),
    "second integrator": ('<integrator type="path"/>', "a scene has one integrator; this is the second"),
    "medium in the scene": ('<medium type="homogeneous"/>', "medium 'homogeneous' is not supported; supported: shape"),
    "unknown element": ('<sphere radius="1"/>', "unsupported XML element: <sphere>"),
    "unknown attribute": (shape('<float name="radius" value="1" unit="m"/>'), 'unexpected attribute "unit"'),
    "element without type": ("<shape/>", 'missing required attribute "type" in <shape>'),
    "unknown id": (shape('<ref id="nope"/>'), "reference to unknown id 'nope'; define an element with that id"),
    "id twice": ('<bsdf type="diffuse" id="b"/><bsdf type="diffuse" id="b"/>', 'duplicate ID: "b"'),
    "reference to a shape": (f'<shape type="sphere" id="s"/>{shape("""<ref id="s"/>""")}',
                             "shape 'sphere' is not supported"),
    "unknown parameter": (bsdf('<float name="reflectance" value="$albedo"/>'), "undefined parameter: $albedo"),
    "missing include": ('<include filename="absent.xml"/>', 'included file "absent.xml" not found'),
    "include of itself": ('<include filename="scene.xml"/>', "maximum include recursion depth"),
    "name of two lines": (shape("", "to&#10;rus"), "shape 'to rus' is not supported"),
}


@pytest.mark.parametrize("case", BODIES)
def test_outside_the_subset(write: Any, case: str) -> None:
    """The element's own line, its name, and what is supported in its place."""
    body, expected = BODIES[case]
    path = write(body)
    message = refusal(path)
    assert message.startswith(f"{path}:{BODY_LINE}: ")
    assert expected in message


SENSORS = {
    "sensor of Mitsuba": ('<sensor type="orthographic">\n</sensor>',
                          "sensor 'orthographic' is not supported; supported: perspective, thinlens"),
    "fov 0": (sensor('<float name="fov" value="0"/>'), "'fov' must lie between 0 and 180 degrees, found 0"),
    "fov 180": (sensor('<float name="fov" value="180"/>'), "'fov' must lie between 0 and 180 degrees, found 180"),
    "fov NaN": (sensor('<float name="fov" value="nan"/>'), "'fov' must be finite"),
    "fov as text": (sensor('<string name="fov" value="40"/>'), "'fov' must be a number, found '40'"),
    "axis": (sensor('<float name="fov" value="40"/><string name="fov_axis" value="z"/>'),
             "'fov_axis' must be x, y, diagonal, smaller or larger, found 'z'"),
    "axis without fov": (sensor('<string name="fov_axis" value="x"/>'), "'fov_axis' needs 'fov'"),
    "fov and focal length": (sensor('<float name="fov" value="40"/><string name="focal_length" value="50mm"/>'),
                             "give either 'fov' or 'focal_length', not both"),
    "focal length": (sensor('<string name="focal_length" value="1.2.3mm"/>'),
                     "'focal_length' must be a positive length"),
    "focal length 0": (sensor('<string name="focal_length" value="0mm"/>'), "'focal_length' must be a positive length"),
    "focal length in cm": (sensor('<string name="focal_length" value="5cm"/>'), "such as '50mm', found '5cm'"),
    "near 0": (sensor('<float name="near_clip" value="0"/>'), "0 < near_clip < far_clip, found 0 and 10000"),
    "near beyond far": (sensor('<float name="near_clip" value="5"/><float name="far_clip" value="2"/>'),
                        "found 5 and 2"),
    "near at far": (sensor('<float name="near_clip" value="2"/><float name="far_clip" value="2"/>'), "found 2 and 2"),
    "scaled": (sensor('<transform name="to_world"><scale value="2"/></transform>'),
               "must not scale or shear, as in Mitsuba"),
    "shutter that closes first": (sensor('<float name="shutter_close" value="-1"/>'),
                                  "'shutter_close' must not lie before 'shutter_open', found -1 and 0"),
    "shape in a sensor": (sensor('<shape type="sphere"/>'), "shape 'sphere' is not supported; supported: film hdrfilm"),
    "two films": (sensor('<film type="hdrfilm"/>'), "a sensor has one film; this is the second"),
    "two samplers": (sensor('<sampler type="independent"/><sampler type="independent"/>'), "a sensor has one sampler"),
    "unknown sampler": (sensor('<sampler type="sobol"/>'), "sampler 'sobol' is not supported; supported: independent"),
    "sampler's property": (sensor('<sampler type="independent"><integer name="sample_cont" value="4"/></sampler>'),
                           "property 'sample_cont' of sampler 'independent'"),
    "film of Mitsuba": ('<sensor type="perspective"><film type="specfilm"/>\n</sensor>',
                        "film 'specfilm' is not supported"),
    "width 0": (sensor(film='<integer name="width" value="0"/>'), "between 1 and 16384 pixels a side, found 0 x 576"),
    "height negative": (sensor(film='<integer name="height" value="-3"/>'), "found 768 x -3"),
    "width too large": (sensor(film='<integer name="width" value="16385"/>'), "found 16385 x 576"),
    "width as float": (sensor(film='<float name="width" value="10"/>'), "'width' must be an integer, found 10.0"),
    "crop": (sensor(film='<integer name="crop_width" value="4"/>'), "property 'crop_width' of film 'hdrfilm'"),
    "unknown filter": (sensor(film='<rfilter type="cone"/>'),
                       "'cone' is not supported; supported: box, tent, gaussian"),
    "two filters": (sensor(film='<rfilter type="box"/><rfilter type="box"/>'), "a film has one reconstruction filter"),
    "filter's property": (sensor(film='<rfilter type="tent"><float name="radios" value="1"/></rfilter>'),
                          "property 'radios' of"),
    "exposure NaN": (sensor(film='<float name="exposure" value="nan"/>'), "'exposure' must be finite"),
}


@pytest.mark.parametrize("case", SENSORS)
def test_sensors(write: Any, case: str) -> None:
    """Field of view, clip planes, film and sampler."""
    element, expected = SENSORS[case]
    path = write(sensor=element)
    message = refusal(path)
    assert message.startswith(f"{path}:{SENSOR_LINE}: ")
    assert expected in message


INTEGRATORS = {
    "integrator of Mitsuba": ('<integrator type="volpath"/>', "integrator 'volpath' is not supported; supported: path"),
    "unbounded": ('<integrator type="path"/>', "'max_depth' must be between 1 and 1024, found -1 (unbounded)"),
    "depth 0": ('<integrator type="path"><integer name="max_depth" value="0"/></integrator>',
                "found 0; both renderers"),
    "too deep": ('<integrator type="path"><integer name="max_depth" value="1025"/></integrator>', "found 1025"),
    "depth as float": ('<integrator type="path"><float name="max_depth" value="4"/></integrator>',
                       "must be an integer"),
    "hidden emitters": ('<integrator type="path"><integer name="max_depth" value="4"/>'
                        '<boolean name="hide_emitters" value="true"/></integrator>', "'hide_emitters' must be false"),
    "unknown property": ('<integrator type="path"><integer name="max_depth" value="4"/>'
                         '<integer name="rr" value="4"/></integrator>', "property 'rr' of integrator 'path'"),
}


@pytest.mark.parametrize("case", INTEGRATORS)
def test_integrators(write: Any, case: str) -> None:
    """Both renderers trace bounded paths, and nothing else is asked of them."""
    element, expected = INTEGRATORS[case]
    path = write(integrator=element)
    message = refusal(path)
    assert message.startswith(f"{path}:{INTEGRATOR_LINE}: ")
    assert expected in message


@pytest.mark.parametrize(("left_out", "expected"), [("sensor", "no <sensor>"), ("integrator", "no <integrator>")])
def test_missing_parts(write: Any, left_out: str, expected: str) -> None:
    """A scene needs a sensor and an integrator; the message says which to add."""
    path = write(**{left_out: ""})
    assert refusal(path).startswith(f"{path}:1: the scene has {expected}; add one of type ")


MALFORMED = {
    "empty": (b"", 1, "No document element found"),
    "blank": (b" \n \n", 3, "No document element found"),
    "text": (b"hello", 1, "No document element found"),
    "zeros": (b"\0" * 100, 1, "No document element found"),
    "binary": (bytes(range(256)) * 4, 5, "No document element found"),
    "unclosed": (b'<scene version="3.0.0">\n<shape type="sphere">\n</scene>', 3, "Start-end tags mismatch"),
    "cut off": (b'<scene version="3.0.0">\n<shape type="sph', 2, "Error parsing"),
    "another root": (b'<html version="3.0.0"></html>', 1, "unsupported XML element: <html>"),
    "a shape as root": (b'<shape version="3.0.0" type="sphere"/>', 1,
                        "the root element must be <scene>, found a shape"),
    "no version": (b"<scene></scene>", 1, "missing version attribute"),
    "bad version": (b'<scene version="three"></scene>', 1, 'invalid version number "three"'),
    "Latin-1": ('<scene version="3.0.0">\n<shape type="sphere" id="Höhe"/></scene>'.encode("latin-1"), 2,
                "not UTF-8 text"),
    "UTF-16": ('<scene version="3.0.0"></scene>'.encode("utf-16"), 1, "not UTF-8 text"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_files(tmp_path: Path, case: str) -> None:
    """Whatever the bytes, the answer is one line with a place in the file."""
    data, line, expected = MALFORMED[case]
    path = tmp_path / "scene.xml"
    path.write_bytes(data)
    message = refusal(path)
    assert message.startswith(f"{path}:{line}: ")
    assert expected in message


@pytest.mark.parametrize("name", ["absent.xml", ".", "absent/scene.xml", "n" * 300, "nul\0character"])
def test_files_that_are_none(tmp_path: Path, name: str) -> None:
    """Missing, a folder, or a name that no file can have."""
    message = refusal(tmp_path / name)
    found = "a folder, not a scene file" if name == "." else "no such scene file"
    assert re.fullmatch(rf".*: {found}; give the path of a Mitsuba 3 \.xml scene", message)
    with pytest.raises(SceneError):
        describe(tmp_path / name)


def test_an_error_in_an_included_file_names_that_file(write: Any, tmp_path: Path) -> None:
    """Of the loader and of Mitsuba's parser: the innermost file and its own line."""
    included = tmp_path / "part one.xml"
    path = write('<include filename="part one.xml"/>')
    for content, line in (('<scene version="3.0.0">\n\n<shape type="torus"/>\n</scene>', 3),
                          (f'<scene version="3.0.0">\n{shape("""<float name="radius" value="x"/>""")}</scene>', 2),
                          ('<scene version="3.0.0">\n\n\n<shape type="sphere">\n</scene>', 5)):
        included.write_text(content)
        assert refusal(path).startswith(f"{included}:{line}: ")


@pytest.mark.parametrize("size", [{"width": 0}, {"height": -1}, {"width": 20000}])
def test_impossible_sizes_asked_for(write: Any, size: dict[str, int]) -> None:
    """A size from the command line is held to the same limits as the file's."""
    with pytest.raises(SceneError, match="film size must be between 1 and 16384"):
        load_scene(write(), **size)
