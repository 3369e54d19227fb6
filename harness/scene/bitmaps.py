"""Image files of a scene, for textures and environment maps: found, decoded as Mitsuba decodes them, and checked."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import SceneError
from harness.machine.mitsuba_runtime import import_mitsuba
from harness.scene.model import RGB, Bitmap, EnvironmentMap, Matrix3, as_matrix
from harness.scene.nodes import Node

# Texels of an image; more would take over half a gigabyte in the tracer, which holds each as four float32.
MAX_TEXELS = 2**25
# Mitsuba repeats the last row of a lower environment map until it has so many.
MIN_ENVIRONMENT_ROWS = 3

# Ratio of a plane transform's two scales below which float32 no longer tells it from a flattening one.
FLATTEST = 1e-6

FILTER_TYPES = ("bilinear", "nearest")
WRAP_MODES = ("repeat", "mirror", "clamp")


def load_bitmap(node: Node) -> Bitmap:
    """A `bitmap` texture; refuses a file that is missing, damaged, too large, or holds other than finite colours ≥ 0.

    Mitsuba itself takes NaN and negative texels without a word.
    """
    path, digest = _file(node)
    raw = node.boolean("raw", False)
    filter_type = _choice(node, "filter_type", FILTER_TYPES)
    wrap_mode = _choice(node, "wrap_mode", WRAP_MODES)
    _choice(node, "format", ("auto",))
    node.ignore("accel")  # of CUDA only
    try:
        peak = _peak(path, digest, raw)
    except SceneError as error:
        raise node.error(str(error)) from None
    bitmap = Bitmap(path, digest, raw, filter_type, wrap_mode, load_to_uv(node), peak)
    node.done(["filename", "raw", "filter_type", "wrap_mode", "to_uv"])
    return bitmap


def load_to_uv(node: Node) -> Matrix3:
    """The plane's part of a texture's `to_uv`: what Mitsuba takes of a 4x4 transform, without z."""
    matrix = node.transform("to_uv")[np.ix_([0, 1, 3], [0, 1, 3])]
    longest, shortest = np.linalg.svd(matrix[:2, :2], compute_uv=False)
    if shortest <= FLATTEST * longest:
        raise node.error("'to_uv' is degenerate (it flattens the plane of u and v); rotate about z, and scale by "
                         "factors other than 0")
    a, b, c = (tuple(float(value) for value in row) for row in matrix)
    return (a, b, c)  # type: ignore[return-value]  # each row has three entries by construction


def load_environment_map(node: Node) -> EnvironmentMap:
    """An `envmap` emitter; refuses files as `load_bitmap` does, and a `to_world` that is no rotation.

    Under any other transform Mitsuba takes angles from directions that are not unit vectors: a wrong image.
    """
    path, digest = _file(node)
    scale = node.number("scale", 1.0)
    if scale < 0:
        raise node.error(f"'scale' must not be negative, found {scale:g}")
    matrix = node.transform()
    if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-5):
        raise node.error("'to_world' of an envmap must be a rotation, mirrored or not; scaling and shearing change "
                         "directions' lengths, which Mitsuba does not expect (use 'scale' for the brightness)")
    node.ignore("mis_compensation")  # changes Mitsuba's noise, not the mean
    try:
        rows = _texels(path, digest, False, True).shape[0]
    except SceneError as error:
        raise node.error(str(error)) from None
    node.done(["filename", "scale", "to_world"])
    return EnvironmentMap(path, digest, rows, scale, as_matrix(matrix))


def bitmap_texels(bitmap: Bitmap) -> np.ndarray:
    """A texture's texels, (H, W, 3) float32 linear, row 0 at v = 0; grey is spread over the three channels.

    Raises SceneError where the file is no longer what it was when the scene was loaded.
    """
    return _texels(bitmap.path, bitmap.digest, bitmap.raw, False)


def environment_texels(environment: EnvironmentMap) -> np.ndarray:
    """An environment map's texels before `scale`, (H, W, 3) float32 linear, first and last row on the poles.

    Raises SceneError where the file is no longer what it was when the scene was loaded.
    """
    return _texels(environment.path, environment.digest, False, True)


def _file(node: Node) -> tuple[Path, str]:
    """The file that `filename` names, and the SHA-256 of its bytes. Relative names start at the scene file's folder.

    At that of the outermost file, not of an included one: as in Mitsuba.
    """
    name = node.string("filename", "")
    if not name:
        raise node.error(f"{node.kind} '{node.plugin}' needs 'filename', an image file (a scene file cannot hold the "
                         "image itself)")
    path = (Path(str(node.state.files[0])).parent / name).absolute()
    try:
        return path, hashlib.sha256(path.read_bytes()).hexdigest()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise node.error(f"'filename' is '{name}', which cannot be read ({reason}); give an image file's path, "
                         "absolute or from the scene file's folder") from None


def _choice(node: Node, name: str, allowed: tuple[Any, ...]) -> Any:
    """A string property out of `allowed`, whose first is the default."""
    value = node.string(name, allowed[0])
    if value not in allowed:
        raise node.error(f"'{name}' must be {' or '.join(map(repr, allowed))}, found '{value}'")
    return value


@functools.lru_cache(maxsize=64)
def _peak(path: Path, digest: str, raw: bool) -> RGB:
    """The largest texel of each channel; a texture that many shapes share is read once. SceneError as `_texels`."""
    red, green, blue = _texels(path, digest, raw, False).max(axis=(0, 1))
    return float(red), float(green), float(blue)


def _texels(path: Path, digest: str, raw: bool, environment: bool) -> np.ndarray:
    """Decode a file as Mitsuba's `bitmap` or its `envmap` does; SceneError, without a line, where it cannot be used."""
    mi = import_mitsuba()
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror})") from None
    if hashlib.sha256(data).hexdigest() != digest:
        raise SceneError(f"{path}: the image changed since the scene was loaded; load the scene again")
    try:
        image = mi.Bitmap(str(path))
    except Exception as error:  # Mitsuba raises bare RuntimeError
        raise SceneError(f"'{path.name}' is not an image that Mitsuba reads, or damaged ({' '.join(str(error).split())}"
                         "); allowed: PNG, JPEG, EXR, HDR (RGBE), PFM, PPM, TGA, BMP") from None
    width, height = (int(side) for side in image.size())
    if width * height > MAX_TEXELS:
        raise SceneError(f"'{path.name}' has {width} x {height} texels, allowed: {MAX_TEXELS} in all; scale it down")
    texels = _converted(mi, image, path, raw, environment)
    bad = ~(np.isfinite(texels) & (texels >= 0)).all(axis=2)
    if bad.any():
        y, x = np.argwhere(bad)[0]
        raise SceneError(f"'{path.name}' holds {int(bad.sum())} texels that are negative or not finite, the first at "
                         f"column {x}, row {y}: ({', '.join(f'{value:g}' for value in texels[y, x])}); mend the image")
    if environment and height < MIN_ENVIRONMENT_ROWS:
        texels = np.pad(texels, ((0, MIN_ENVIRONMENT_ROWS - height), (0, 0), (0, 0)), mode="edge")
    return texels


def _converted(mi: Any, image: Any, path: Path, raw: bool, environment: bool) -> np.ndarray:
    """Linear RGB, (H, W, 3) float32, without alpha, rounded to the precision in which Mitsuba keeps it."""
    formats = mi.Bitmap.PixelFormat
    pixel_format = image.pixel_format()
    if pixel_format not in (formats.Y, formats.YA, formats.RGB, formats.RGBA, formats.XYZ, formats.XYZA):
        raise SceneError(f"'{path.name}' has channels other than grey, RGB or XYZ, with or without alpha "
                         f"({image.channel_count()} in all); keep those")
    if raw:
        image.set_srgb_gamma(False)
    # A texture of 8-bit integers is decoded texel by texel in float32, one of 16 bits is kept as halves.
    halves = not environment and image.bytes_per_pixel() // image.channel_count() == 2
    component = mi.Struct.Type.Float16 if halves else mi.Struct.Type.Float32
    target = formats.Y if not environment and pixel_format in (formats.Y, formats.YA) else formats.RGB
    texels = np.atleast_3d(np.array(image.convert(target, component, False))).astype(np.float32)
    return np.broadcast_to(texels, (*texels.shape[:2], 3))
