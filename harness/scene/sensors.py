"""Sensors of a scene file: the camera, its film and its shutter."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from harness.scene.model import Camera, as_matrix
from harness.scene.nodes import Node

# All of Mitsuba's: in both renderers another one takes their place, which does not change the mean.
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")

# Largest film side: what every GL 4.3 implementation must offer as a texture (GL 4.3 core, table 23.53).
MAX_FILM_SIDE = 16384
# Stops by which an image may be brightened or darkened for display; beyond, every radiance is black or white.
MAX_EXPOSURE = 64.0
# Mitsuba's defaults where a file says nothing (hdrfilm, perspective).
DEFAULT_FILM = (768, 576)
DEFAULT_FOCAL_LENGTH = "50mm"
DEFAULT_FILTER = "gaussian"

COMMON = ("to_world", "fov", "fov_axis", "focal_length", "near_clip", "far_clip", "shutter_open", "shutter_close")
# What each sensor takes besides: Mitsuba's thin lens has no principal point.
PARAMETERS = {"perspective": ("principal_point_offset_x", "principal_point_offset_y"),
              "thinlens": ("aperture_radius", "focus_distance")}


@dataclass(frozen=True)
class Sensor:
    """A camera, the size of its film in pixels, the exposure (stops) at which its images are shown, and a sentence for
    each thing that both renderers replace."""

    camera: Camera
    width: int
    height: int
    exposure: float
    notes: tuple[str, ...]


def load_sensor(node: Node, width: int | None, height: int | None) -> Sensor:
    """A `perspective` or `thinlens` sensor; `width` and `height` override the film's."""
    if node.plugin not in PARAMETERS:
        raise node.refuse(PARAMETERS)
    film_size, exposure = DEFAULT_FILM, 0.0
    notes: list[str] = []
    seen: set[str] = set()
    for _, child in node.children():
        if child.kind in seen:
            raise child.error(f"a sensor has one {child.kind}; this is the second")
        seen.add(child.kind)
        if child.kind == "film":
            film_size, exposure = _film(child, notes)
        elif child.kind == "sampler":
            _sampler(child, notes)
        else:
            raise child.refuse(["film hdrfilm", "sampler"])
    if "film" not in seen:
        notes.append("no film given: Mitsuba's default size, with a box filter")
    film_size = (film_size[0] if width is None else width, film_size[1] if height is None else height)
    if not all(1 <= side <= MAX_FILM_SIDE for side in film_size):
        raise node.error(f"film size must be between 1 and {MAX_FILM_SIDE} pixels a side, "
                         f"found {film_size[0]} x {film_size[1]}")
    matrix = node.transform()
    linear = matrix[:3, :3]
    if not np.allclose(linear.T @ linear, np.eye(3), atol=1e-4):
        raise node.error("'to_world' of a sensor must not scale or shear, as in Mitsuba; "
                         "a rotation's axis must have length 1")
    near, far = node.number("near_clip", 1e-2), node.number("far_clip", 1e4)
    if not 0 < near < far:
        raise node.error(f"clip distances must satisfy 0 < near_clip < far_clip, found {near:g} and {far:g}")
    aspect = film_size[0] / film_size[1]
    tan_x = _tan_half_fov_x(node, aspect)
    offset, aperture, focus = (0.0, 0.0), 0.0, 1.0
    if node.plugin == "perspective":
        # Mitsuba measures the principal point in film fractions, positive to the left and upwards in the image, which
        # moves the rays through the film the other way: to the right (our -x) and downwards (our -y).
        offset = (-2 * tan_x * node.number("principal_point_offset_x", 0.0),
                  -2 * tan_x / aspect * node.number("principal_point_offset_y", 0.0))
    else:
        aperture, focus = _lens(node, far, notes)
    shutter = _shutter(node)
    node.done((*COMMON, *PARAMETERS[node.plugin]))
    camera = Camera(as_matrix(matrix), tan_x, tan_x / aspect, near, far, offset, aperture, focus, shutter)
    return Sensor(camera, *film_size, exposure, tuple(notes))


def _lens(node: Node, far_clip: float, notes: list[str]) -> tuple[float, float]:
    """Aperture radius and focus distance, with Mitsuba's defaults."""
    aperture = node.number("aperture_radius")
    if aperture < 0:
        raise node.error(f"'aperture_radius' must not be negative, found {aperture:g}")
    if aperture == 0:  # Mitsuba puts 6e-8 for it
        notes.append("aperture_radius 0: a pinhole in both renderers")
    focus = node.number("focus_distance", far_clip)
    if focus <= 0:
        raise node.error(f"'focus_distance' must be positive, found {focus:g}")
    return aperture, focus


def _shutter(node: Node) -> tuple[float, float]:
    opens, closes = node.number("shutter_open", 0.0), node.number("shutter_close", 0.0)
    if closes < opens:
        raise node.error(f"'shutter_close' must not lie before 'shutter_open', found {closes:g} and {opens:g}")
    return opens, closes


def _sampler(node: Node, notes: list[str]) -> None:
    if node.plugin not in SAMPLERS:
        raise node.refuse(SAMPLERS)
    if node.plugin != "independent":
        notes.append(f"sampler '{node.plugin}' replaced by independent sampling in both renderers")
    node.ignore("sample_count", "seed", "jitter")
    node.done(["sample_count", "seed", "jitter"])


def _tan_half_fov_x(node: Node, aspect: float) -> float:
    """Half the film's width at distance 1. Mitsuba's `parse_fov`: fov with fov_axis, or a 35 mm focal length."""
    given = "fov" in node
    if given:
        if "focal_length" in node:
            raise node.error("give either 'fov' or 'focal_length', not both")
        fov = node.number("fov")
        if not 0 < fov < 180:
            raise node.error(f"'fov' must lie between 0 and 180 degrees, found {fov:g}")
        tangent = math.tan(math.radians(fov) / 2)
        axis = node.string("fov_axis", "x")
    else:
        text = node.string("focal_length", DEFAULT_FOCAL_LENGTH)
        found = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(mm)?\s*", text)
        if not found or float(found[1]) <= 0:
            raise node.error(f"'focal_length' must be a positive length such as '50mm', found '{text}'")
        tangent = math.hypot(36.0, 24.0) / (2 * float(found[1]))  # half the diagonal of a 35 mm frame
        axis = node.string("fov_axis", "diagonal")
        if axis != "diagonal":
            raise node.error("'fov_axis' needs 'fov'; a focal length is always measured on the diagonal")
    if axis == "smaller":
        axis = "y" if aspect > 1 else "x"
    elif axis == "larger":
        axis = "x" if aspect > 1 else "y"
    match axis:
        case "x":
            return tangent
        case "y":
            return tangent * aspect
        case "diagonal":
            return tangent / math.hypot(1.0, 1.0 / aspect)
        case _:
            raise node.error(f"'fov_axis' must be x, y, diagonal, smaller or larger, found '{axis}'")


def _film(node: Node, notes: list[str]) -> tuple[tuple[int, int], float]:
    if node.plugin != "hdrfilm":
        raise node.refuse(["hdrfilm"])
    reconstruction = ""
    for _, child in node.children():
        if child.kind not in ("reconstructionfilter", "rfilter"):
            raise child.refuse(["rfilter"])
        if child.plugin not in FILTERS:
            raise child.refuse(FILTERS)
        if reconstruction:
            raise child.error("a film has one reconstruction filter; this is the second")
        reconstruction = child.plugin
        child.ignore("stddev", "radius", "lobes", "A", "B", "C")
        child.done(["stddev", "radius", "lobes", "A", "B", "C"])
    reconstruction = reconstruction or DEFAULT_FILTER
    if reconstruction != "box":
        notes.append(f"reconstruction filter '{reconstruction}' replaced by box in both renderers")
    size = (node.integer("width", DEFAULT_FILM[0]), node.integer("height", DEFAULT_FILM[1]))
    exposure = node.number("exposure", 0.0)
    if abs(exposure) > MAX_EXPOSURE:
        raise node.error(f"'exposure' must lie between {-MAX_EXPOSURE:g} and {MAX_EXPOSURE:g} stops, "
                         f"found {exposure:g}")
    # How Mitsuba would write its file; the harness always renders float32 RGB.
    node.ignore("pixel_format", "component_format", "file_format", "compensate", "banner")
    node.done(["width", "height", "exposure", "rfilter", "pixel_format", "component_format", "file_format"])
    return size, exposure
