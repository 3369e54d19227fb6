"""Area lights of every shape, seen directly and by what they light: both renderers against known formulas.

Irradiance is measured on a small patch of a matt floor, seen from above, under one light in a black world: its radiance
is kd Le F, where F is the configuration factor from the patch to the light. A renderer's own idea of the light's area,
side, place or density changes F.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from harness.gpu.renderer import TracerRenderer
from harness.reference import ReferenceRenderer
from harness.samples.estimate import Estimate, merge
from harness.scene import Scene, load_scene

BATCHES = 32
# All comparisons of this file together raise a false alarm in one of a hundred changes of the seeds.
COMPARISONS = 100
LIMIT = stats.t.isf(1e-2 / (2 * COMPARISONS), BATCHES - 1)
# Largest relative standard error at which a comparison still means something.
RESOLUTION = 2.5e-3
# Of an answer without noise: what float32 leaves of sums and of a patch that is not a point.
EXACT = 1e-5
KD = np.array([0.8, 0.6, 0.4])
RADIANCE = np.array([2.0, 3.0, 5.0])
SPP = {"tracer": 1024, "mitsuba": 192}  # per batch
# Of the tracer's strategies that sample lights.
LIT_SPP = {"cosine+nee": 288, "cosine+mis": 288}
# Looks down at the origin of the floor z = 0; a pixel sees a hundredth of a unit.
SENSOR = """<sensor type="perspective"><transform name="to_world"><lookat origin="0, 0, {height}" target="0, 0, 0"
    up="0, 1, 0"/></transform><float name="fov" value="{fov}"/><film type="hdrfilm"><integer name="width" value="8"/>
    <integer name="height" value="8"/><rfilter type="box"/></film></sensor>"""
FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="30"/></transform><bsdf type="diffuse">
    <rgb name="reflectance" value="0.8, 0.6, 0.4"/></bsdf></shape>"""
CELLS = 256  # along either side of a surface that is integrated by cells
Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]
EMITTER = '<emitter type="area"><rgb name="radiance" value="2, 3, 5"/></emitter>'


def write(folder: Path, body: str, *, max_depth: int = 2, height: float = 0.1, fov: float = 1.0) -> Scene:
    """A scene around `body`, seen from `height` above the origin."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{SENSOR.format(height=height, fov=fov)}<integrator type="path">'
                    f'<integer name="max_depth" value="{max_depth}"/></integrator>{body}</scene>', encoding="utf-8")
    return load_scene(path)


def measure(scene: Scene, renderer: str, spp: int, batches: int = BATCHES) -> Estimate:
    """Batches of `spp` samples per pixel; fails where a sample was not finite."""
    if renderer == "mitsuba":
        reference = ReferenceRenderer(scene.file)
        merged = merge(reference.render_batch(0, k * spp, spp) for k in range(batches))
    else:
        tracer = TracerRenderer(scene, "cosine" if renderer == "tracer" else renderer)
        merged = merge(tracer.render_batch(0, k * spp, spp) for k in range(batches))
        tracer.release()
    assert merged.rejected == 0
    return merged


def assert_answer(found: Estimate, exact: np.ndarray) -> None:
    """The image's mean is the answer within its standard error by batch means, which is fine enough."""
    error = np.sqrt(found.image_variance[:3])
    assert (error <= RESOLUTION * exact).all(), f"relative standard error {error / exact}"
    off = found.image_mean[:3] - exact
    assert (np.abs(off) <= LIMIT * error + EXACT * exact).all(), f"off by {off / exact} +- {error / exact}"


# Factors from a small patch at the origin, facing +z, to what lies wholly above its horizon; after Howell, "A Catalog
# of Radiation Heat Transfer Configuration Factors", section B, unless said otherwise.


def ellipse_factor(a: float, b: float, height: float) -> float:
    """Parallel ellipse of half axes a and b, centred above: (1/2π) ∫ R²/(R² + h²) dφ over its outline R(φ)."""
    return float(a * b / np.sqrt((a**2 + height**2) * (b**2 + height**2)))


def sphere_factor(x: float, z: float, radius: float) -> float:
    """Sphere about (x, 0, z): (R/D)² cos θ."""
    return float(radius**2 * z / np.hypot(x, z) ** 3)


def polygon_factor(corners: np.ndarray) -> float:
    """Polygon (N, 3), clockwise as seen from the patch; negative where it is the other way round.

    Lambert's sum over edges: Baum, Rushmeier & Winget 1989, "Improving Radiosity Solutions Through the Use of
    Analytically Determined Form-Factors", eq. 11.
    """
    towards = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    after = np.roll(towards, -1, axis=0)
    cross = np.cross(towards, after)
    angles = np.arccos(np.clip((towards * after).sum(axis=1), -1, 1))
    return float(-(angles * cross[:, 2] / np.linalg.norm(cross, axis=1)).sum() / (2 * np.pi))


def rectangle_factor(matrix: np.ndarray) -> float:
    """[-1,1]² under a (4, 4) transform, its front towards the patch."""
    corners = np.array([[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]]) @ matrix.T
    return abs(polygon_factor(corners[:, :3]))


def cube_factor(matrix: np.ndarray) -> float:
    """[-1,1]³ under a (4, 4) transform: its faces that look at the patch."""
    total = 0.0
    for axis in range(3):
        for side in (-1, 1):
            face = np.array([[-1, -1, side, 1], [1, -1, side, 1], [1, 1, side, 1], [-1, 1, side, 1]], dtype=float)
            face[:, [axis, 2]] = face[:, [2, axis]]
            corners = (face @ matrix.T)[:, :3]
            outward = corners.mean(axis=0) - matrix[:3, 3]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
            total += max(0.0, polygon_factor(corners if normal @ outward > 0 else corners[::-1]))
    return total


def tube_factor(radius: float, height: float, length: float) -> float:
    """Cylinder with its axis parallel to the patch, from straight above it to `length` sideways."""
    h, side = height / radius, length / radius
    x, y = (1 + h) ** 2 + side**2, (1 - h) ** 2 + side**2
    end = (x - 2 * h) / np.sqrt(x * y) * np.arctan(np.sqrt(x * (h - 1) / (y * (h + 1))))
    outline = end - np.arctan(np.sqrt((h - 1) / (h + 1)))
    return float((np.arctan(side / np.sqrt(h**2 - 1)) + side * outline) / (np.pi * h))


def matrix(*operations: np.ndarray) -> np.ndarray:
    """The (4, 4) product of transforms, the first applied first as in a scene file."""
    result = np.eye(4)
    for operation in operations:
        result = operation @ result
    return result


def scale(x: float, y: float, z: float) -> np.ndarray:
    return np.diag([x, y, z, 1.0])


def translate(x: float, y: float, z: float) -> np.ndarray:
    result = np.eye(4)
    result[:3, 3] = x, y, z
    return result


def rotate(axis: int, degrees: float) -> np.ndarray:
    """About a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result = np.eye(4)
    result[[i, j, i, j], [i, j, j, i]] = np.array([1, 1, -1, 1]) * np.repeat(
        [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))], 2)
    return result


def light(kind: str, operations: str = "", *, inner: str = "", flip: bool = False) -> str:
    """A light under operations of a scene file."""
    flipped = '<boolean name="flip_normals" value="true"/>' if flip else ""
    return f'<shape type="{kind}"><transform name="to_world">{operations}</transform>{inner}{flipped}{EMITTER}</shape>'


def tube(p0: str, p1: str, radius: float) -> str:
    """Parameters of a cylinder."""
    return (f'<point name="p0" value="{p0}"/><point name="p1" value="{p1}"/>'
            f'<float name="radius" value="{radius}"/>')


ABOVE = '<translate z="1.1"/>'
NESTED = """<scale x="0.9" y="0.6" z="0.7"/><rotate y="1" angle="25"/><scale x="-1.3" y="1" z="1"/>
    <rotate x="1" angle="-35"/><translate x="0.2" y="-0.3" z="1.8"/>"""
NESTED_MATRIX = matrix(scale(0.9, 0.6, 0.7), rotate(1, 25), scale(-1.3, 1, 1), rotate(0, -35),
                       translate(0.2, -0.3, 1.8))
LIGHTS: dict[str, tuple[str, float]] = {
    "disk": (light("disk", '<rotate x="1" angle="180"/><scale value="0.8"/>' + ABOVE), ellipse_factor(0.8, 0.8, 1.1)),
    "mirrored disk": (light("disk", '<scale x="0.8" y="0.8" z="-3"/>' + ABOVE), ellipse_factor(0.8, 0.8, 1.1)),
    "oval disk": (light("disk", '<scale x="1.2" y="0.5"/><rotate z="1" angle="30"/>' + ABOVE, flip=True),
                  ellipse_factor(1.2, 0.5, 1.1)),
    "rectangle": (light("rectangle", NESTED, flip=True), rectangle_factor(NESTED_MATRIX)),
    "cube": (light("cube", NESTED), cube_factor(NESTED_MATRIX)),
    "flat cube": (light("cube", '<scale z="1e-4"/>' + NESTED), cube_factor(matrix(scale(1, 1, 1e-4), NESTED_MATRIX))),
    "sphere": (light("sphere", '<scale value="1.6"/>', inner='<float name="radius" value="0.5"/>'
                     '<point name="center" value="0.5 0 0.75"/>'), sphere_factor(0.8, 1.2, 0.8)),
    "mirrored sphere": (light("sphere", '<scale x="-0.8" y="0.8" z="0.8"/><translate x="-0.8" z="1.2"/>', flip=True),
                        sphere_factor(0.8, 1.2, 0.8)),
    # By a texture of one value, from radius 0.5 to 0.8: the reference renders a mesh, the tracer marches.
    "displaced sphere": (light("displacedsphere", '<translate x="0.8" z="1.2"/>', inner='''<float name="radius"
                         value="0.5"/><float name="amplitude" value="0.6"/><texture type="fractal" name="displacement">
                         <float name="color0" value="0.5"/><float name="color1" value="0.5"/></texture>'''),
                         sphere_factor(0.8, 1.2, 0.8)),
    "cylinder": (light("cylinder", '<rotate z="1" angle="40"/>', inner=tube("-1.5 0 1.2", "2.5 0 1.2", 0.6)),
                 tube_factor(0.6, 1.2, 1.5) + tube_factor(0.6, 1.2, 2.5)),
    "stretched cylinder": (light("cylinder", '<scale x="2"/>', inner=tube("1.25 0 1.2", "-0.75 0 1.2", 0.6)),
                           tube_factor(0.6, 1.2, 1.5) + tube_factor(0.6, 1.2, 2.5)),
    # From its bottom all that is not the opening above is wall.
    "inside of a cylinder": (light("cylinder", inner=tube("0 0 0", "0 0 1.5", 0.7), flip=True),
                             1 - ellipse_factor(0.7, 0.7, 1.5)),
}


@pytest.mark.parametrize("renderer", [*SPP, *LIT_SPP])
@pytest.mark.parametrize("name", LIGHTS)
def test_irradiance(tmp_path: Path, name: str, renderer: str) -> None:
    """Every shape as a light; nested, mirrored, uneven and flipped as far as Mitsuba allows it."""
    body, factor = LIGHTS[name]
    found = measure(write(tmp_path, FLOOR + body), renderer, {**SPP, **LIT_SPP}[renderer])
    assert_answer(found, KD * RADIANCE * factor)


SIDES = {
    "sphere": "<scale value='0.5'/>", "cube": "<scale value='0.5'/>", "cylinder": "<rotate y='1' angle='90'/>",
    "rectangle": "<translate z='-0.5'/>", "disk": "<translate z='-0.5'/>",
}


@pytest.mark.parametrize("renderer", SPP)
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("kind", SIDES)
def test_light_leaves_the_front_only(tmp_path: Path, kind: str, flip: bool, renderer: str) -> None:
    """Of a closed shape seen from outside and from inside, of a flat one from before and behind: all of it or none."""
    for outside in (True, False):
        place = "<translate z='-3'/>" if outside else ""
        if kind == "cylinder":
            place += "<translate x='-0.5'/>"
        elif kind in ("rectangle", "disk") and not outside:
            place = "<rotate x='1' angle='180'/><translate z='-1'/>"
        scene = write(tmp_path, light(kind, SIDES[kind] + place, flip=flip), max_depth=1)
        pixels = measure(scene, renderer, 1, batches=1).mean
        np.testing.assert_allclose(pixels, np.broadcast_to(RADIANCE * (outside != flip), pixels.shape), rtol=1e-6)


@pytest.mark.parametrize(("renderer", "radius"), [("tracer", 0.5), ("tracer", 1e-3), ("mitsuba", 0.5),
                                                  ("mitsuba", 0.1)])
def test_coverage_by_a_tube(tmp_path: Path, radius: float, renderer: str) -> None:
    """Seen at right angles to its axis from distance D, a tube reaches R / √(D² - R²) to each side at distance 1.

    The tracer as thin as a wire. Mitsuba not: its equation cancels, and what a wire covers in its images is off by
    0.05 % at R/D = 1/100, 0.15 % at 1/200, 9 % at 1/4000.
    """
    distance = 4.0
    half_film = 4 * radius / distance  # at distance 1: the tube takes about a quarter of the film
    fov = 2 * np.degrees(np.arctan(half_film))
    body = light("cylinder", '<rotate z="1" angle="90"/>', inner=tube("-9 0 0", "9 0 0", radius))
    found = measure(write(tmp_path, body, max_depth=1, height=distance, fov=fov), renderer, 256)
    assert_answer(found, RADIANCE * radius / np.sqrt(distance**2 - radius**2) / half_film)


@pytest.mark.parametrize("renderer", SPP)
@pytest.mark.parametrize("flip", [False, True])
def test_a_view_through_a_tube(tmp_path: Path, flip: bool, renderer: str) -> None:
    """Along the axis of an open cylinder: sky through its far end and around it, its inside between the two rims."""
    body = light("cylinder", inner=tube("0 0 0", "0 0 1", 0.5), flip=flip) + '<emitter type="constant"/>'
    ring = np.pi * ((0.5 / 3) ** 2 - (0.5 / 4) ** 2) / (2 * np.tan(np.radians(20.0))) ** 2
    found = measure(write(tmp_path, body, max_depth=1, height=4.0, fov=40.0), renderer, 256)
    assert_answer(found, 1 - ring + RADIANCE * ring * flip)


@pytest.mark.parametrize("renderer", SPP)
def test_a_convex_tube_shows_its_albedo(tmp_path: Path, renderer: str) -> None:
    """From outside an open cylinder is convex: under a sky of radiance 1 it shows its albedo, whatever the depth."""
    body = ('<shape type="cylinder"><transform name="to_world"><rotate y="1" angle="70"/><translate z="-3"/>'
            '</transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.6, 0.4"/></bsdf></shape>'
            '<emitter type="constant"/>')
    assert_answer(measure(write(tmp_path, body, max_depth=5), renderer, 256), KD)


def cell_factors(surface: Surface, inside: tuple[float, float, float]) -> np.ndarray:
    """1/π cos θ cos θ' / r² dA of each cell of a convex surface, its points over [0,1]², (CELLS, CELLS)."""
    points = surface(*np.meshgrid(*[np.linspace(0, 1, CELLS + 1)] * 2))
    centres = (points[1:, 1:] + points[:-1, :-1] + points[1:, :-1] + points[:-1, 1:]) / 4
    areas = np.cross(points[1:, 1:] - points[:-1, :-1], points[1:, :-1] - points[:-1, 1:]) / 2
    areas *= np.sign(((centres - inside) * areas).sum(axis=-1, keepdims=True))
    towards = np.maximum(-(centres * areas).sum(axis=-1), 0)
    return centres[..., 2] * towards / (np.pi * (centres**2).sum(axis=-1) ** 2)


@pytest.mark.parametrize(("factor", "surface", "inside"), [
    (ellipse_factor(1.2, 0.5, 1.1),
     lambda u, v: np.stack([1.2 * u * np.cos(2 * np.pi * v), 0.5 * u * np.sin(2 * np.pi * v), 1.1 + 0 * u], -1),
     (0, 0, 2)),
    (sphere_factor(0.8, 1.2, 0.6),
     lambda u, v: 0.6 * np.stack([np.sin(np.pi * u) * np.cos(2 * np.pi * v), np.sin(np.pi * u) * np.sin(2 * np.pi * v),
                                  np.cos(np.pi * u)], -1) + [0.8, 0, 1.2], (0.8, 0, 1.2)),
    (tube_factor(0.6, 1.2, 1.5),
     lambda u, v: np.stack([1.5 * u, 0.6 * np.cos(2 * np.pi * v), 1.2 + 0.6 * np.sin(2 * np.pi * v)], -1),
     (0.75, 0, 1.2)),
    (rectangle_factor(NESTED_MATRIX),
     lambda u, v: np.stack([2 * u - 1, 2 * v - 1, 0 * u, 1 + 0 * u], -1) @ NESTED_MATRIX[:3].T, (0, 0, 9)),
], ids=["ellipse", "sphere", "tube", "rectangle"])
def test_formulas_agree_with_quadrature(factor: float, surface: Surface, inside: tuple[float, float, float]) -> None:
    """What the renderers are held against is itself checked by another way."""
    assert cell_factors(surface, inside).sum() == pytest.approx(factor, rel=4e-4)


def test_a_cubes_factor_is_that_of_its_faces() -> None:
    """Each face by quadrature; those that turn away count nothing."""
    total = 0.0
    for axis in range(3):
        for side in (-1.0, 1.0):
            def face(u: np.ndarray, v: np.ndarray, axis: int = axis, side: float = side) -> np.ndarray:
                points = np.insert(np.stack([2 * u - 1, 2 * v - 1], -1), axis, side, axis=-1)
                return points @ NESTED_MATRIX[:3, :3].T + NESTED_MATRIX[:3, 3]
            total += cell_factors(face, tuple(NESTED_MATRIX[:3, 3])).sum()
    assert total == pytest.approx(cube_factor(NESTED_MATRIX), rel=4e-4)


def around(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)


# Canonical surfaces by Mitsuba's (u, v).
BY_UV: dict[str, list[Surface]] = {
    "sphere": [lambda u, v: np.stack([*(np.sin(np.pi * v) * x for x in around(u)), np.cos(np.pi * v)], -1)],
    "cylinder": [lambda u, v: np.stack([*around(u), v], -1)],
    "disk": [lambda u, v: np.stack([*(u * x for x in around(v)), 0 * u], -1)],
    "rectangle": [lambda u, v: np.stack([2 * u - 1, 2 * v - 1, 0 * u], -1)],
    "cube": [lambda u, v: np.stack([1 + 0 * u, 2 * u - 1, 1 - 2 * v], -1),
             lambda u, v: np.stack([-1 + 0 * u, 2 * u - 1, 2 * v - 1], -1),
             lambda u, v: np.stack([1 - 2 * u, 1 + 0 * u, 1 - 2 * v], -1),
             lambda u, v: np.stack([2 * v - 1, -1 + 0 * u, 2 * u - 1], -1),
             lambda u, v: np.stack([2 * v - 1, 2 * u - 1, 1 + 0 * u], -1),
             lambda u, v: np.stack([2 * v - 1, 1 - 2 * u, -1 + 0 * u], -1)],
}
# Everything oblique, so that no symmetry hides a mistake, and wholly above the horizon, fronts towards the patch.
TURNED = '<rotate x="1" angle="130"/><rotate z="1" angle="35"/><rotate y="1" angle="20"/>'
TURN = (rotate(0, 130), rotate(2, 35), rotate(1, 20))
TEXTURED = {
    "sphere": (TURNED + '<scale value="0.8"/><translate x="0.3" z="1.1"/>', (*TURN, scale(0.8, 0.8, 0.8),
                                                                         translate(0.3, 0, 1.1))),
    "cylinder": ('<scale x="0.7" y="0.7" z="3"/><translate z="-1.5"/>' + TURNED + '<translate z="1.9"/>',
                 (scale(0.7, 0.7, 3), translate(0, 0, -1.5), *TURN, translate(0, 0, 1.9))),
    "disk": ('<scale x="-1.2" y="0.7"/>' + TURNED + '<translate x="0.2" z="1.2"/>',
             (scale(-1.2, 0.7, 1), *TURN, translate(0.2, 0, 1.2))),
    "rectangle": ('<scale x="-1.2" y="0.7"/>' + TURNED + '<translate x="0.2" z="1.4"/>',
                  (scale(-1.2, 0.7, 1), *TURN, translate(0.2, 0, 1.4))),
    "cube": ('<scale x="0.8" y="0.5" z="0.6"/>' + TURNED + '<translate x="0.3" z="1.3"/>',
             (scale(0.8, 0.5, 0.6), *TURN, translate(0.3, 0, 1.3))),
}


@pytest.mark.parametrize("renderer", [*SPP, "cosine+nee"])
@pytest.mark.parametrize("kind", TEXTURED)
def test_irradiance_from_a_chequered_light(tmp_path: Path, kind: str, renderer: str) -> None:
    """The sum over cells of the surface, each in its colour.

    Left to itself, Mitsuba's `path` loses most of a cube's light and some of a cylinder's and of a turned sphere's: see
    harness/reference/lights.py.
    """
    operations, matrices = TEXTURED[kind]
    place = matrix(*matrices)
    colors = np.array([[1.0, 0.3, 0.2], [0.2, 0.6, 1.0]])
    board = (f'<emitter type="area"><texture type="checkerboard" name="radiance">'
             f'<rgb name="color0" value="{", ".join(map(str, colors[0]))}"/>'
             f'<rgb name="color1" value="{", ".join(map(str, colors[1]))}"/>'             '</texture></emitter>')
    u, v = np.meshgrid(*[(np.arange(CELLS) + 0.5) / CELLS] * 2)
    same_half = (u < 0.5) == (v < 0.5)
    factors = np.zeros(2)
    for face in BY_UV[kind]:
        inside = place[:3, 3] + place[:3, 2] * {"cylinder": 0.5, "disk": -1, "rectangle": -1}.get(kind, 0)
        cells = cell_factors(lambda u, v, face=face: face(u, v) @ place[:3, :3].T + place[:3, 3], tuple(inside))
        factors += cells[same_half].sum(), cells[~same_half].sum()
    shape = light(kind, operations).replace(EMITTER, board)
    found = measure(write(tmp_path, FLOOR + shape), renderer, {**SPP, **LIT_SPP}[renderer])
    assert_answer(found, KD * (factors @ colors))
