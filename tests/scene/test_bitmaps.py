"""Image files in a scene: what the loader reads of them, and what it refuses."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import SceneError
from harness.files import data_dir
from harness.reference.prepare import instantiate
from harness.scene import bitmaps, load_scene
from harness.scene.bitmaps import bitmap_texels
from harness.scene.model import Bitmap, EnvironmentMap, peak

BODY_LINE = 5  # of the files that the fixture `write` makes

FileWriter = Callable[..., Path]


def textured(filename: str, inner: str = "", kind: str = "bitmap") -> str:
    """A sphere whose albedo is an image."""
    name = f'<string name="filename" value="{filename}"/>' if filename else ""
    return (f'<shape type="sphere"><bsdf type="diffuse"><texture type="{kind}" name="reflectance">{name}{inner}'
            "</texture></bsdf></shape>")


def lit(filename: str, inner: str = "") -> str:
    """An environment map."""
    return f'<emitter type="envmap"><string name="filename" value="{filename}"/>{inner}</emitter>'


def option(name: str, value: str) -> str:
    """A string property."""
    return f'<string name="{name}" value="{value}"/>'


def to(name: str, inner: str) -> str:
    """A transform."""
    return f'<transform name="{name}">{inner}</transform>'


def picture(mi: Any, folder: Path, name: str = "image.png", values: Any = ((0, 128, 255), (51, 51, 51))) -> str:
    """Write a 2 x 1 image: uint8, or float32 where its name ends in .exr; its name."""
    dtype = np.float32 if name.endswith(".exr") else np.uint8
    mi.Bitmap(np.array([values], dtype=dtype)).write(str(folder / name))
    return name


def refusal(path: Path) -> str:
    """The loader's one line."""
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_bitmap_is_what_its_file_holds(mi: Any, write: FileWriter, tmp_path: Path) -> None:
    """Defaults are Mitsuba's; the peak is that of the decoded texels, 51/255 being 0.0331 in sRGB."""
    texture = load_scene(write(textured(picture(mi, tmp_path)))).shapes[0].material.kd
    assert isinstance(texture, Bitmap)
    assert (texture.raw, texture.filter_type, texture.wrap_mode) == (False, "bilinear", "repeat")
    assert texture.to_uv == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    np.testing.assert_allclose(peak(texture), [0.0331048, 0.2158605, 1], atol=1e-6)
    np.testing.assert_allclose(bitmap_texels(texture), [[[0, 0.2158605, 1], [0.0331048] * 3]], atol=1e-6)
    raw = load_scene(write(textured("image.png", '<boolean name="raw" value="true"/>'))).shapes[0].material.kd
    np.testing.assert_allclose(peak(raw), [0.2, 128 / 255, 1], atol=1e-6)


def test_the_content_decides_not_the_place(mi: Any, write: FileWriter, tmp_path: Path) -> None:
    """The same bytes under another name are the same scene; other bytes under the same name are another."""
    hashes = []
    for name in ("one.png", "two.png"):
        picture(mi, tmp_path, name)
        hashes.append(load_scene(write(textured(name) + lit(name))).content_hash)
    picture(mi, tmp_path, "two.png", ((1, 128, 255), (51, 51, 51)))
    changed = load_scene(tmp_path / "scene.xml").content_hash
    assert hashes[0] == hashes[1] != changed


def test_names_start_at_the_outermost_file(mi: Any, write: FileWriter, tmp_path: Path, monkeypatch: Any) -> None:
    """As in Mitsuba, an included file's images too; the process's folder does not matter, in either renderer."""
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "included.xml").write_text(f'<scene version="3.0.0">{textured("image.png")}</scene>')
    picture(mi, tmp_path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    picture(mi, elsewhere, values=((9, 9, 9), (9, 9, 9)))
    path = write('<include filename="part/included.xml"/>')
    monkeypatch.chdir(elsewhere)
    for given in (path, Path("..") / path.name):
        scene = load_scene(given)
        assert peak(scene.shapes[0].material.kd)[2] == 1
        bsdf = instantiate(scene.file).shapes()[0].bsdf()
        import drjit as dr

        si = dr.zeros(mi.SurfaceInteraction3f, 1)
        si.uv = mi.Point2f(0.25, 0.5)
        np.testing.assert_allclose(np.ravel(bsdf.eval_diffuse_reflectance(si)), [0, 0.2158605, 1], atol=1e-6)


def test_a_shared_texture_is_read_once(mi: Any, write: FileWriter, tmp_path: Path, monkeypatch: Any) -> None:
    """A BSDF that twenty shapes refer to is loaded twenty times, its image is not."""
    picture(mi, tmp_path, values=((1, 2, 3), (4, 5, 6)))
    reads = []
    original = bitmaps._texels
    monkeypatch.setattr(bitmaps, "_texels", lambda *arguments: reads.append(1) or original(*arguments))
    material = '<bsdf type="diffuse" id="m"><texture type="bitmap" name="reflectance">' \
               '<string name="filename" value="image.png"/></texture></bsdf>'
    scene = load_scene(write(material + '<shape type="sphere"><ref id="m"/></shape>' * 20))
    assert len(scene.shapes) == 20 and len(reads) == 1


def test_an_environment_map_is_what_its_file_holds(mi: Any, write: FileWriter, tmp_path: Path) -> None:
    """Scale and rotation beside it; what changes only Mitsuba's noise is let through."""
    name = picture(mi, tmp_path, "map.exr")
    inner = ('<float name="scale" value="0.5"/><boolean name="mis_compensation" value="true"/>'
             + to("to_world", '<rotate y="1" angle="90"/>'))
    found = load_scene(write(lit(name, inner))).environment
    assert isinstance(found, EnvironmentMap)
    assert (found.scale, found.rows, found.path) == (0.5, 3, tmp_path / name)
    np.testing.assert_allclose(np.array(found.to_world)[:3, :3], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-6)


REFUSED = {
    "no filename": (textured(""), "texture 'bitmap' needs 'filename', an image file"),
    "missing file": (textured("none.png"), "'filename' is 'none.png', which cannot be read (No such file"),
    "a folder": (textured("."), "'filename' is '.', which cannot be read (Is a directory)"),
    "not an image": (textured("scene.xml"), "'scene.xml' is not an image that Mitsuba reads, or damaged"),
    "empty file": (textured("empty.png"), "'empty.png' is not an image that Mitsuba reads, or damaged"),
    "truncated file": (textured("cut.png"), "'cut.png' is not an image that Mitsuba reads, or damaged"),
    "NaN": (textured("nan.exr"), "'nan.exr' holds 1 texels that are negative or not finite, the first at column 1, "
                                 "row 0: (nan, 1, 1)"),
    "infinite": (textured("infinite.exr"), "'infinite.exr' holds 1 texels that are negative or not finite"),
    "negative": (textured("negative.exr"), "column 0, row 0: (1, -0.5, 1)"),
    "five channels": (textured("five.exr"), "'five.exr' has channels other than grey, RGB or XYZ"),
    "albedo above 1": (textured("bright.exr"), "diffuse albedo must not exceed 1, found 4"),
    "filter": (textured("image.png", option("filter_type", "trilinear")),
               "'filter_type' must be 'bilinear' or 'nearest', found 'trilinear'"),
    "wrap": (textured("image.png", option("wrap_mode", "zero")),
             "'wrap_mode' must be 'repeat' or 'mirror' or 'clamp', found 'zero'"),
    "format": (textured("image.png", option("format", "variant")), "'format' must be 'auto', found 'variant'"),
    "misspelt": (textured("image.png", option("wrap", "clamp")), "property 'wrap' of texture 'bitmap'"),
    "to_uv flat": (textured("image.png", to("to_uv", '<scale x="2" y="0"/>')), "'to_uv' is degenerate"),
    "to_uv upright": (textured("image.png", to("to_uv", '<rotate x="1" angle="90"/>')), "'to_uv' is degenerate"),
    "checkerboard of textures": (textured("", '<texture type="checkerboard" name="color0"/>', "checkerboard"),
                                 "texture 'checkerboard' is not supported; supported: a plain value"),
    "bright checkerboard": (textured("", '<rgb name="color1" value="0, 2, 0"/>', "checkerboard"),
                            "'color1' as a colour must not exceed 1, found 2; Mitsuba's checkerboard takes"),
    "dark checkerboard": (textured("", '<rgb name="color0" value="0, -2, 0"/>', "checkerboard"),
                          "'color0' must be finite and not negative"),
    "checkerboard misspelt": (textured("", '<rgb name="colour0" value="0, 0, 0"/>', "checkerboard"),
                              "property 'colour0' of texture 'checkerboard'"),
    "missing map": (lit("none.exr"), "'filename' is 'none.exr', which cannot be read"),
    "damaged map": (lit("cut.png"), "'cut.png' is not an image that Mitsuba reads, or damaged"),
    "NaN in a map": (lit("nan.exr"), "'nan.exr' holds 1 texels that are negative or not finite"),
    "scaled map": (lit("image.png", to("to_world", '<scale value="2"/>')), "'to_world' of an envmap must be a rot"),
    "sheared map": (lit("image.png", to("to_world", '<scale x="1" y="2" z="1"/>')), "must be a rotation"),
    "dark map": (lit("image.png", '<float name="scale" value="-1"/>'), "'scale' must not be negative, found -1"),
    "two skies": ('<emitter type="constant"/>' + lit("image.png"), "a scene has one environment"),
}


@pytest.fixture
def pictures(mi: Any, tmp_path: Path) -> None:
    """The files that the refused scenes name."""
    picture(mi, tmp_path)
    for name, first, second in (("nan", (1, 1, 1), (np.nan, 1, 1)), ("infinite", (1, 1, 1), (1, np.inf, 1)),
                                ("negative", (1, -0.5, 1), (1, 1, 1)), ("bright", (0, 4, 0), (1, 1, 1))):
        picture(mi, tmp_path, f"{name}.exr", (first, second))
    (tmp_path / "empty.png").touch()
    (tmp_path / "cut.png").write_bytes((tmp_path / "image.png").read_bytes()[:60])
    mi.Bitmap(mi.Bitmap.PixelFormat.MultiChannel, mi.Struct.Type.Float32, [2, 2], 5, list("abcde")).write(
        str(tmp_path / "five.exr"))


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line(write: FileWriter, case: str) -> None:
    """With file and line, and what is allowed."""
    body, expected = REFUSED[case]
    path = write(body)
    message = refusal(path)
    assert message.startswith(f"{path}:{BODY_LINE}: ")
    assert expected in message


def test_an_image_inside_the_scene_file_is_refused(write: FileWriter) -> None:
    """Mitsuba's XML has no such element; its parser says so."""
    path = write('<emitter type="envmap"><bitmap name="bitmap" filename="image.png"/></emitter>')
    assert refusal(path).startswith(f"{path}:{BODY_LINE}: encountered an unsupported XML element: <bitmap>")


def test_too_many_texels_are_refused(mi: Any, write: FileWriter, tmp_path: Path, monkeypatch: Any) -> None:
    """Before they are spread out as float32."""
    picture(mi, tmp_path, values=((7, 8, 9), (9, 8, 7)))
    monkeypatch.setattr(bitmaps, "MAX_TEXELS", 1)
    assert "'image.png' has 2 x 1 texels, allowed: 1 in all; scale it down" in refusal(write(textured("image.png")))


def test_bright_numbers_are_no_colours(write: FileWriter) -> None:
    """A checkerboard that shines brighter than 1, which Mitsuba takes as <float>."""
    body = '<shape type="disk"><emitter type="area"><texture type="checkerboard" name="radiance">' \
           '<float name="color0" value="5"/></texture></emitter></shape>'
    assert peak(load_scene(write(body)).shapes[0].emission) == (5, 5, 5)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["sky.exr", "tiles.png", "leaves.png", "wear.png", "window.exr"])
def test_the_shipped_images_are_what_their_script_makes(mi: Any, name: str) -> None:
    """All of them, to the bit but for what another NumPy may round elsewhere; and small."""
    folder = data_dir("mitsuba_scenes") / "textures"
    made = runpy.run_path(str(folder / "make_textures.py"))[name.split(".")[0]]()
    shipped = np.atleast_3d(np.array(mi.Bitmap(str(folder / name))))
    np.testing.assert_allclose(shipped.astype(np.float64), made, rtol=1e-5, atol=1e-6)
    assert shipped.dtype == made.dtype
    assert sum(file.stat().st_size for file in folder.iterdir() if file.is_file()) < 300_000
