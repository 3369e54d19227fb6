"""From a Mitsuba scene file to a `Scene`: Mitsuba parses, this module understands the subset and refuses the rest."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from harness.errors import SceneError
from harness.scene.model import RGB, Camera, Material, Matrix, Scene, Shape, ShapeKind
from harness.scene.nodes import Node, parse

SHAPES: tuple[ShapeKind, ...] = ("sphere", "rectangle", "disk", "cube")
BSDFS = ("phong", "diffuse", "twosided")
# All of Mitsuba's: in both renderers another one takes their place, which does not change the mean.
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")

# A path longer than this is refused: the tracer's loop is bounded (see tracer.renderer.MAX_ITERATIONS).
MAX_DEPTH_LIMIT = 1024
# Largest film side: what every GL 4.3 implementation must offer as a texture (GL 4.3 core, table 23.53).
MAX_FILM_SIDE = 16384
# Stops by which an image may be brightened or darkened for display; beyond, every radiance is black or white.
MAX_EXPOSURE = 64.0
# Mitsuba's defaults where a file says nothing (hdrfilm, perspective).
DEFAULT_FILM = (768, 576)
DEFAULT_FOCAL_LENGTH = "50mm"
DEFAULT_FILTER = "gaussian"


def load_scene(path: str | Path, *, width: int | None = None, height: int | None = None) -> Scene:
    """Read a Mitsuba 3 XML scene into a `Scene`; `width` and `height` (pixels) override the film's.

    Raises SceneError (one line with file and line) for anything malformed or outside the supported subset.
    """
    path = Path(path)
    state = parse(path)
    root = Node(state, 0)
    if root.kind != "scene":
        raise root.error(f"the root element must be <scene>, found a {root.kind}")
    shapes: list[Shape] = []
    notes: list[str] = []
    environment: RGB | None = None
    camera: tuple[Camera, int, int, float] | None = None
    max_depth: int | None = None
    for _, node in root.children():
        match node.kind:
            case "shape":
                shapes.append(_shape(node))
            case "emitter":
                if node.plugin != "constant":
                    raise node.refuse(["constant (in the scene)", "area (inside a shape)"])
                if environment is not None:
                    raise node.error("a scene has one environment; this is the second")
                environment = node.rgb("radiance", 1.0, emission=True)
                node.done(["radiance"])
            case "sensor":
                if camera is not None:
                    raise node.error("a scene has one sensor; this is the second")
                camera = _sensor(node, width, height, notes)
            case "integrator":
                if max_depth is not None:
                    raise node.error("a scene has one integrator; this is the second")
                max_depth = _integrator(node)
            case "bsdf":
                _material(node)  # used by reference; checked here, so that an unused one is not silently wrong
            case _:
                raise node.refuse(["shape", "emitter constant", "sensor", "integrator", "bsdf"])
    root.done([])
    if camera is None:
        raise root.error("the scene has no <sensor>; add one of type 'perspective'")
    if max_depth is None:
        raise root.error("the scene has no <integrator>; add one of type 'path' with 'max_depth'")
    return Scene(tuple(shapes), environment or (0.0, 0.0, 0.0), camera[0], camera[1], camera[2], max_depth,
                 exposure=camera[3], name=path.stem, path=path.resolve(), notes=tuple(notes))


def describe(path: str | Path) -> str:
    """The scene file's opening comment as one paragraph; empty where there is none."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise SceneError(f"{path}: not UTF-8 text; save the file in the encoding UTF-8") from None
    found = re.match(r"\s*(?:<\?xml.*?\?>)?\s*<!--(.*?)-->", text, re.DOTALL)
    return " ".join(found[1].split()) if found else ""


def _integrator(node: Node) -> int:
    if node.plugin != "path":
        raise node.refuse(["path"])
    max_depth = node.integer("max_depth", -1)
    if not 1 <= max_depth <= MAX_DEPTH_LIMIT:
        raise node.error(f"'max_depth' must be between 1 and {MAX_DEPTH_LIMIT}, found {max_depth}"
                         f"{' (unbounded)' if max_depth == -1 else ''}; both renderers trace bounded paths")
    if node.boolean("hide_emitters", False):
        raise node.error("'hide_emitters' must be false; supported: max_depth, rr_depth")
    node.ignore("rr_depth")  # Russian roulette is off in both renderers; it changes the noise, not the mean
    node.done(["max_depth", "rr_depth"])
    return max_depth


def _shape(node: Node) -> Shape:
    if node.plugin not in SHAPES:
        raise node.refuse(SHAPES)
    kind: ShapeKind = next(shape for shape in SHAPES if shape == node.plugin)
    material: Material | None = None
    emission: RGB | None = None
    for _, child in node.children():
        if child.kind == "bsdf":
            if material is not None:
                raise child.error("a shape has one BSDF; this is the second")
            material = _material(child)
        elif child.kind == "emitter":
            if child.plugin != "area":
                raise child.refuse(["area"])
            if emission is not None:
                raise child.error("a shape has one emitter; this is the second")
            emission = child.rgb("radiance", 1.0, emission=True)
            child.done(["radiance"])
        else:
            raise child.refuse(["bsdf", "emitter area"])
    if material is None:
        # Mitsuba's own default: diffuse with reflectance 0.5, black for an emitter (Shape::initialize).
        grey = 0.5 if emission is None else 0.0
        material = Material((grey, grey, grey), (0.0, 0.0, 0.0), 1.0)
    matrix = node.transform()
    flip = node.boolean("flip_normals", False)
    if kind == "sphere":
        matrix, flip = _sphere(node, matrix, flip)
        node.done(["center", "radius", "to_world", "flip_normals"])
    else:
        if kind == "disk":
            _refuse_unless_similarity(node, matrix, plane_only=True)
        node.done(["to_world", "flip_normals"])
    return Shape(kind, _matrix(matrix), material, emission, flip, name=node.name)


def _sphere(node: Node, matrix: np.ndarray, flip: bool) -> tuple[np.ndarray, bool]:
    center = node.point("center", (0.0, 0.0, 0.0))
    radius = node.number("radius", 1.0)
    if radius <= 0:
        raise node.error(f"'radius' must be positive, found {radius:g}")
    _refuse_unless_similarity(node, matrix, plane_only=False)
    local = np.diag([radius, radius, radius, 1.0])
    local[:3, 3] = center
    # A mirrored sphere is turned inside out in Mitsuba (Sphere::update), unlike every other mirrored shape.
    return matrix @ local, flip ^ bool(np.linalg.det(matrix[:3, :3]) < 0)


def _refuse_unless_similarity(node: Node, matrix: np.ndarray, *, plane_only: bool) -> None:
    """Spheres stay spheres and disks circular in Mitsuba: rotation, translation and uniform scale only."""
    columns = matrix[:3, :2] if plane_only else matrix[:3, :3]
    gram = columns.T @ columns
    if not np.allclose(gram, np.eye(len(gram)) * gram[0, 0], rtol=0, atol=1e-5 * gram[0, 0]):
        raise node.error(f"'to_world' of a {node.plugin} must not shear or scale unevenly; "
                         "use rotation, translation and uniform scale")


def _material(node: Node) -> Material:
    if node.plugin == "twosided":
        inner = [child for _, child in node.children()]
        if len(inner) != 1 or inner[0].kind != "bsdf":
            raise node.error(f"'twosided' takes exactly one nested BSDF, found {len(inner)}")
        node.done([])
        material = _material(inner[0])
        return Material(material.kd, material.ks, material.alpha, two_sided=True)
    if node.plugin == "diffuse":
        material = Material(node.rgb("reflectance", 0.5), (0.0, 0.0, 0.0), 1.0)
        _refuse_children(node)
        node.done(["reflectance"])
    elif node.plugin == "phong":
        material = Material(node.rgb("kd", 0.5), node.rgb("ks", 0.0), node.number("alpha", 10.0))
        _refuse_children(node)
        node.done(["kd", "ks", "alpha"])
        if material.alpha < 0:
            raise node.error(f"'alpha' must not be negative, found {material.alpha:g}")
    else:
        raise node.refuse(BSDFS)
    if max(material.kd) > 1:
        raise node.error(f"diffuse albedo must not exceed 1, found {max(material.kd):g}")
    return material


def _refuse_children(node: Node) -> None:
    for _, child in node.children():
        raise child.refuse([f"colours and numbers in a {node.plugin}"])


def _sensor(node: Node, width: int | None, height: int | None, notes: list[str]) -> tuple[Camera, int, int, float]:
    if node.plugin != "perspective":
        raise node.refuse(["perspective"])
    film_size, exposure = DEFAULT_FILM, 0.0
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
    # Mitsuba measures the principal point in film fractions, positive to the left and upwards in the image, which
    # moves the rays through the film the other way: to the right (our -x) and downwards (our -y).
    offset = (-2 * tan_x * node.number("principal_point_offset_x", 0.0),
              -2 * tan_x / aspect * node.number("principal_point_offset_y", 0.0))
    node.done(["to_world", "fov", "fov_axis", "focal_length", "near_clip", "far_clip",
               "principal_point_offset_x", "principal_point_offset_y"])
    return Camera(_matrix(matrix), tan_x, tan_x / aspect, near, far, offset), *film_size, exposure


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


def _matrix(matrix: np.ndarray) -> Matrix:
    a, b, c, d = (tuple(float(value) for value in row) for row in matrix)
    return (a, b, c, d)  # type: ignore[return-value]  # each row has four entries by construction
