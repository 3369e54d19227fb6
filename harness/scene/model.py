"""The typed scene: what a Mitsuba scene file says, reduced to what both renderers understand."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

RGB = tuple[float, float, float]
Matrix = tuple[tuple[float, float, float, float], ...]  # row-major 4x4, object to world

ShapeKind = Literal["sphere", "rectangle", "disk", "cube"]


@dataclass(frozen=True)
class Material:
    """The course's Phong-like BRDF: f = kd/π + ks (α+1)/(2π) max(r·v, 0)^α.

    A Mitsuba `diffuse` is the special case ks = 0. `two_sided` shades the back like the front;
    otherwise the back is black, as in Mitsuba.
    """

    kd: RGB
    ks: RGB
    alpha: float
    two_sided: bool = False


@dataclass(frozen=True)
class Shape:
    """One primitive in Mitsuba's canonical object space under an affine transform.

    Canonical forms: sphere of radius 1 at the origin; rectangle [-1,1]² and disk of radius 1 in the plane z = 0
    facing +z; cube [-1,1]³. A sphere's `center` and `radius` are already folded into `to_world`.
    `emission` is the area emitter's radiance, leaving the front side only; None where the shape does not emit.
    """

    kind: ShapeKind
    to_world: Matrix
    material: Material
    emission: RGB | None = None
    flip_normals: bool = False
    name: str = ""

    @property
    def matrix(self) -> np.ndarray:
        """`to_world` as a (4, 4) float64 array."""
        return np.array(self.to_world, dtype=np.float64)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with Mitsuba's conventions (+z forward, +x left, +y up in camera space).

    `tan_x`, `tan_y`: half the film's extent at distance 1. Distances are in scene units.
    """

    to_world: Matrix
    tan_x: float
    tan_y: float
    near_clip: float
    far_clip: float
    principal_point: tuple[float, float] = (0.0, 0.0)

    @property
    def matrix(self) -> np.ndarray:
        """`to_world` as a (4, 4) float64 array."""
        return np.array(self.to_world, dtype=np.float64)


@dataclass(frozen=True)
class Scene:
    """Everything an image depends on, and nothing else, but for the last three fields, which `content_hash` leaves out.

    `max_depth` counts as Mitsuba's `path` integrator does: emission seen directly is depth 1, so N allows
    N-1 scatterings. `exposure` (in stops) is the fixed exposure at which display metrics see this scene.
    """

    shapes: tuple[Shape, ...]
    environment: RGB
    camera: Camera
    width: int
    height: int
    max_depth: int
    exposure: float = 0.0
    name: str = ""
    path: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def content_hash(self) -> str:
        """16 hexadecimal digits that change exactly when the image may change (names and notes do not count)."""
        content = dataclasses.asdict(self)
        for shape in content["shapes"]:
            del shape["name"]
        for field in ("name", "path", "notes", "exposure"):
            del content[field]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
