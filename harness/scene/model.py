"""The typed scene: what a Mitsuba scene file says, reduced to what both renderers understand."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from harness.errors import HarnessError
from harness.samples.keys import digest
from harness.scene.file import SceneFile

RGB = tuple[float, float, float]
Matrix = tuple[tuple[float, float, float, float], ...]  # row-major 4x4
Matrix3 = tuple[tuple[float, float, float], ...]  # row-major 3x3, in homogeneous coordinates of the plane

ShapeKind = Literal["sphere", "rectangle", "disk", "cube", "cylinder", "displacedsphere"]


@dataclass(frozen=True)
class Bitmap:
    """An image over the surface's (u, v), with Mitsuba's conventions: row 0 at v = 0, texel centres at half integers.

    `digest` is the SHA-256 of the file's bytes, which stands for its content; `path` says where to find it and does
    not count. 8-bit files are decoded from sRGB unless `raw`. `to_uv` maps (u, v, 1) to texture coordinates.
    """

    path: Path
    digest: str
    raw: bool
    filter_type: Literal["bilinear", "nearest"]
    wrap_mode: Literal["repeat", "mirror", "clamp"]
    to_uv: Matrix3
    peak: RGB  # largest texel of each channel


@dataclass(frozen=True)
class Checkerboard:
    """Mitsuba's `checkerboard`: `color0` where the fractions of u and v lie in the same half, else `color1`."""

    color0: RGB
    color1: RGB
    to_uv: Matrix3


@dataclass(frozen=True)
class Procedural:
    """A colour ramp over value noise at the surface point in object space; see `harness.reference.procedural`.

    `to_texture` maps canonical object space to the space in which the noise is defined.
    """

    kind: str  # one of `harness.scene.procedural.KINDS`
    colors: tuple[RGB, ...]
    octaves: int
    lacunarity: float
    gain: float
    frequency: float
    distortion: float
    seed: int
    to_texture: Matrix


Varying = Bitmap | Checkerboard | Procedural
# A colour over a surface, constant or not.
Texture = RGB | Varying


def peak(texture: Texture) -> RGB:
    """An upper bound of a texture's value, per channel; the least one for constants, bitmaps and checkerboards."""
    match texture:
        case Bitmap():
            return texture.peak
        case Checkerboard():
            return _largest((texture.color0, texture.color1))
        case Procedural():
            return _largest(texture.colors)
        case _:
            return texture


def is_black(texture: Texture) -> bool:
    """Whether a texture is zero everywhere."""
    return max(peak(texture)) == 0


def _largest(colors: tuple[RGB, ...]) -> RGB:
    red, green, blue = (max(channel) for channel in zip(*colors, strict=True))
    return red, green, blue


@dataclass(frozen=True)
class Material:
    """The course's Phong-like BRDF: f = kd/π + ks (α+1)/(2π) max(r·v, 0)^α.

    A Mitsuba `diffuse` is the special case ks = 0. `two_sided` shades the back like the front;
    otherwise the back is black, as in Mitsuba. Of a textured `alpha`, red counts.
    """

    kd: Texture
    ks: Texture
    alpha: float | Varying
    two_sided: bool = False


@dataclass(frozen=True)
class Displacement:
    """Moves a sphere's surface along its radius: r(d) = 1 + amplitude · h(d) for unit directions d of object space.

    h is the red channel of `texture` at d; `amplitude` is a part of the radius, negative inwards.
    """

    texture: Procedural | Bitmap
    amplitude: float


@dataclass(frozen=True)
class Shape:
    """One primitive in Mitsuba's canonical object space under an affine transform.

    Canonical forms: sphere of radius 1 at the origin, displaced or not; rectangle [-1,1]² and disk of radius 1 in the
    plane z = 0 facing +z; cube [-1,1]³; open cylinder of radius 1 about the z axis from z = 0 to 1. A sphere's `center`
    and `radius` and a cylinder's `p0`, `p1` and `radius` are already folded into `to_world`.
    `emission` is the area emitter's radiance, leaving the front side only; None where the shape does not emit.
    `motion` is a rigid transform of world space that carries the shape from its place at time 0, which is `to_world`,
    to its place at time 1; None where the shape rests. At time t it is the t-th power of `motion`, a screw motion.
    """

    kind: ShapeKind
    to_world: Matrix
    material: Material
    emission: Texture | None = None
    flip_normals: bool = False
    motion: Matrix | None = None
    displacement: Displacement | None = None
    name: str = ""

    @property
    def matrix(self) -> np.ndarray:
        """`to_world` as a (4, 4) float64 array."""
        return np.array(self.to_world, dtype=np.float64)


@dataclass(frozen=True)
class Camera:
    """A camera with Mitsuba's conventions (+z forward, +x left, +y up in camera space).

    `tan_x`, `tan_y`: half the film's extent at distance 1. Distances are in scene units. `aperture_radius` is that of
    the thin lens, 0 for a pinhole; what lies in the plane at depth `focus_distance` is sharp. `shutter` is the interval
    of time over which the image is averaged; it may be a single moment.
    """

    to_world: Matrix
    tan_x: float
    tan_y: float
    near_clip: float
    far_clip: float
    principal_point: tuple[float, float] = (0.0, 0.0)
    aperture_radius: float = 0.0
    focus_distance: float = 1.0
    shutter: tuple[float, float] = (0.0, 0.0)

    @property
    def matrix(self) -> np.ndarray:
        """`to_world` as a (4, 4) float64 array."""
        return np.array(self.to_world, dtype=np.float64)


@dataclass(frozen=True)
class EnvironmentMap:
    """A latitude-longitude image as the light from infinity: Mitsuba's `envmap`.

    `digest` and `path` as in `Bitmap`; radiance is the texel times `scale`. `to_world` takes the map's directions,
    +y up, to the scene's. The first and the last of the image's `rows` lie on the poles.
    """

    path: Path
    digest: str
    rows: int
    scale: float
    to_world: Matrix


@dataclass(frozen=True)
class Scene:
    """Everything an image depends on, and nothing else, but for the fields after `max_depth`, which do not count.

    `max_depth` counts as Mitsuba's `path` integrator does: emission seen directly is depth 1, so N allows
    N-1 scatterings; `depth_given` where it is not the file's own. How the scene is shown is another matter: see
    `harness.scene.presentation`.
    """

    shapes: tuple[Shape, ...]
    environment: RGB | EnvironmentMap
    camera: Camera
    width: int
    height: int
    max_depth: int
    name: str = ""
    path: Path | None = None
    parameters: tuple[tuple[str, str], ...] = ()
    depth_given: int | None = None

    @property
    def file(self) -> SceneFile:
        """What this is a reading of. HarnessError where it was made in memory."""
        if self.path is None:
            raise HarnessError(f"scene '{self.name}' has no file, so Mitsuba cannot render it; write it to an .xml "
                               "file and load it with harness.load_scene")
        return SceneFile(self.path, self.parameters, (self.width, self.height), self.depth_given)

    @cached_property  # asked for with every batch that is kept
    def content_hash(self) -> str:
        """16 hexadecimal digits that change exactly when the image may change (names do not count)."""
        content = dataclasses.asdict(self)
        for field in ("parameters", "depth_given"):  # what they change is in the rest
            del content[field]
        return digest(_without_names(content), 16)


def _without_names(content: Any) -> Any:
    """Nested plain values without the entries that do not change an image: names, and where files are."""
    if isinstance(content, dict):
        return {key: _without_names(value) for key, value in content.items() if key not in ("name", "path")}
    if isinstance(content, list | tuple):
        return [_without_names(value) for value in content]
    return content


def as_matrix(matrix: np.ndarray) -> Matrix:
    """A (4, 4) array as nested tuples, which compare and hash by value."""
    a, b, c, d = (tuple(float(value) for value in row) for row in matrix)
    return (a, b, c, d)  # type: ignore[return-value]  # each row has four entries by construction
