"""Right at every scale: furnaces whose answer is known, and scenes that are one picture at every size and place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.reference.renderer import ReferenceRenderer
from harness.scene import Scene, load_scene
from harness.scene.frame import frame_of, seen
from tests.support.tracer import TracerRenderer

ALBEDO = 0.6
# Of an answer without variance: float32 sums of 16 samples.
EXACT = 1e-5
TURN = '<rotate x="0.48" y="0.6" z="0.64" angle="52"/>'
AXIS, ANGLE = np.array([0.48, 0.6, 0.64]), np.radians(52)
# Where a camera looks at each shape from, how wide its view is, and at what, in object space.
VIEWS = {"sphere": ((0.25, 0.1, 1), 0.6, (0, 0, 0)), "rectangle": ((0.25, 0.1, 1), 0.6, (0, 0, 0)),
         "disk": ((0.25, 0.1, 1), 0.5, (0, 0, 0)), "cube": ((0.3, 0.2, 1), 0.5, (0, 0, 0)),
         "cylinder": ((1, 0.3, 0), 0.4, (0, 0, 0.5))}
GREY = f'<bsdf type="diffuse"><rgb name="reflectance" value="{ALBEDO}, {ALBEDO}, {ALBEDO}"/></bsdf>'
FURNACE = '<emitter type="constant"><float name="radiance" value="1"/></emitter>'


def write(folder: Path, body: str, origin: np.ndarray, target: np.ndarray, fov: float, *, depth: int = 3,
          unit: float = 1.0, size: tuple[int, int] = (16, 16), up: str = "0.1, 1, 0.05", far: float = 1e4) -> Scene:
    """A scene around a body; clip planes are `unit` times Mitsuba's, the far one `far`."""
    path = folder / f"scene{len(list(folder.iterdir()))}.xml"
    eye, at = (", ".join(map(repr, map(float, point))) for point in (origin, target))
    path.write_text(f"""<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
<sensor type="perspective"><transform name="to_world"><lookat origin="{eye}" target="{at}" up="{up}"/></transform>
<float name="fov" value="{fov!r}"/><float name="near_clip" value="{0.01 * unit!r}"/>
<float name="far_clip" value="{far * unit!r}"/><film type="hdrfilm"><integer name="width" value="{size[0]}"/>
<integer name="height" value="{size[1]}"/><rfilter type="box"/></film></sensor>{body}</scene>
""", encoding="utf-8")
    return load_scene(path)


def image(scene: Scene, strategy: str = "cosine", spp: int = 16) -> np.ndarray:
    """The tracer's mean of samples 0 … spp-1 of replica 0, float64."""
    renderer = TracerRenderer(scene, strategy)
    try:
        return renderer.render_batch(0, 0, spp).mean.astype(np.float64)
    finally:
        renderer.release()


def reference(scene: Scene, spp: int = 16) -> np.ndarray:
    """Mitsuba's, without light sampling."""
    renderer = ReferenceRenderer(scene.file, "bsdf_path")
    try:
        return renderer.render_batch(0, 0, spp).mean.astype(np.float64)
    finally:
        renderer.release()


def turned() -> np.ndarray:
    """The rotation TURN, (3, 3)."""
    x, y, z = AXIS
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(ANGLE) * across + (1 - np.cos(ANGLE)) * across @ across


def tilted(folder: Path, kind: str, *, unit: float = 1.0, shift: float = 0.0, distance: float = 6.0,
           size: float = 1.0, behind: bool = False) -> Scene:
    """A tilted shape that fills the film; in a furnace every sample of it is its albedo, since it is convex.

    `behind`: there is a grain behind the camera, which so has to stay where it is.
    """
    towards, half, middle = VIEWS[kind]
    place = [shift, -shift, shift]
    target = np.array(place) + unit * turned() @ np.array(middle)
    direction = turned() @ (np.array(towards) / np.linalg.norm(towards))
    body = (f'<shape type="{kind}"><transform name="to_world">{TURN}<scale value="{size * unit!r}"/><translate '
            f'x="{place[0]!r}" y="{place[1]!r}" z="{place[2]!r}"/></transform>{GREY}</shape>')
    origin = target + unit * distance * direction
    if behind:
        x, y, z = map(float, origin + unit * direction)
        body += (f'<shape type="sphere"><point name="center" x="{x!r}" y="{y!r}" z="{z!r}"/>'
                 f'<float name="radius" value="{1e-3 * unit!r}"/></shape>')
    return write(folder, body + FURNACE, origin, target,
                 float(2 * np.degrees(np.arctan(half / distance))), unit=unit, far=1e6)


@pytest.mark.parametrize("case", ["x 1e-4", "x 1e4", "at 1e4", "from 2000", "from 100000"])
@pytest.mark.parametrize("kind", VIEWS)
def test_tilted_shapes_in_a_furnace(tmp_path: Path, kind: str, case: str) -> None:
    """Without noise. Before, from 2000 units 3 % (cube) to 36 % (sphere) were lost, from 100,000 half and more."""
    word, value = case.split()
    scene = tilted(tmp_path, kind, **{{"x": "unit", "at": "shift", "from": "distance"}[word]: float(value)})
    np.testing.assert_allclose(image(scene), ALBEDO, rtol=EXACT)


@pytest.mark.parametrize("kind", VIEWS)
def test_hits_that_rays_reach_from_afar(tmp_path: Path, kind: str) -> None:
    """There is something behind the camera, so its rays start where it is, and hits are projected onto the shapes."""
    scene = tilted(tmp_path, kind, distance=20000.0, size=2.0, behind=True)
    np.testing.assert_allclose(image(scene), ALBEDO, rtol=EXACT)


@pytest.mark.parametrize("radius", [100.0, 1000.0, 3000.0, 100000.0])
def test_the_ground_is_a_large_sphere(tmp_path: Path, radius: float) -> None:
    """As in Ray Tracing in One Weekend, tilted, from nearby. Before, both renderers lost light from radius 3000 on."""
    x, y, z = -radius * AXIS
    body = (f'<shape type="sphere"><point name="center" x="{x}" y="{y}" z="{z}"/><float name="radius" '
            f'value="{radius}"/>{GREY}</shape>{FURNACE}')
    scene = write(tmp_path, body, 1.6 * AXIS + np.array([1.6, 0, -1.2]), np.zeros(3), 30.0)
    np.testing.assert_allclose(image(scene), ALBEDO, rtol=EXACT)
    if radius <= 3000:  # beyond, the reference loses light, and warns
        np.testing.assert_allclose(reference(scene), ALBEDO, rtol=EXACT)


@pytest.mark.parametrize("radius", [2.0, 1000.0])
def test_a_dome_that_shines_on_itself(tmp_path: Path, radius: float) -> None:
    """From inside, near the wall: 1 + a + a² + a³ of its own light after four vertices."""
    light = '<emitter type="area"><rgb name="radiance" value="1, 1, 1"/></emitter>'
    body = (f'<shape type="sphere"><boolean name="flip_normals" value="true"/><float name="radius" value="{radius}"/>'
            f'{GREY}{light}</shape>')
    scene = write(tmp_path, body, np.array([0.2, 1 - radius, 0.1]), np.array([1.0, -radius, 0.5]), 50.0, depth=4)
    np.testing.assert_allclose(image(scene), np.polyval([1, 1, 1, 1], ALBEDO), rtol=EXACT)


def picture(folder: Path, *, unit: float = 1.0, shift: float = 0.0, turn: float = 0.0, size: tuple[int, int] = (32, 24),
            light: str = "0.8, 0.9, 1.0", colours: tuple[str, str] = ("0.6, 0.2, 0.1", "0.2, 0.5, 0.7")) -> Scene:
    """A ball and a cube that stand on a floor: light must not pass under them. One picture, whatever size and place.

    `turn` (degrees about y) turns everything.
    """
    after = f'<rotate y="1" angle="{turn}"/><scale value="{unit!r}"/><translate x="{shift!r}" z="{-shift!r}"/>'

    def shape(kind: str, place: str, colour: str) -> str:
        return (f'<shape type="{kind}"><transform name="to_world">{place}{after}</transform>'
                f'<bsdf type="diffuse"><rgb name="reflectance" value="{colour}"/></bsdf></shape>')

    body = (shape("rectangle", '<rotate x="1" angle="-90"/><scale value="8"/>', "0.5, 0.5, 0.5")
            + shape("sphere", '<scale value="0.8"/><translate x="-0.9" y="0.8"/>', colours[0])
            + shape("cube", '<scale value="0.6"/><rotate y="1" angle="25"/><translate x="1" y="0.6" z="0.3"/>',
                    colours[1])
            + f'<emitter type="constant"><rgb name="radiance" value="{light}"/></emitter>')
    angle, place = np.radians(turn), np.array([shift, 0, -shift])
    about = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    origin, target = (place + unit * about @ np.array(point) for point in ([0, 2.2, 6], [0, 0.6, 0]))
    return write(folder, body, origin, target, 40.0, depth=6, unit=unit, size=size, up="0, 1, 0", far=1e3)


def assert_one_picture(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal random numbers follow equal paths; a few part at edges. Before, a tile was off by a third."""
    off = np.abs(found / expected - 1).max(axis=2)
    assert (off < 1e-4).mean() > 0.9
    np.testing.assert_allclose(found.mean((0, 1)), expected.mean((0, 1)), rtol=1e-3)


PLACES = [{"unit": 10.0**k} for k in range(-4, 5) if k] + [{"shift": 1e3}, {"shift": 1e4}]


@pytest.mark.parametrize("place", PLACES, ids=str)
def test_scaled_and_shifted_scenes_are_one_picture(tmp_path: Path, place: dict[str, float]) -> None:
    """By 10^k and by 10,000 units."""
    assert_one_picture(image(picture(tmp_path, **place)), image(picture(tmp_path)))


@pytest.mark.parametrize("place", [{"unit": 1e-4}, {"unit": 1e4}, {"shift": 1e4}], ids=str)
def test_mitsubas_are_as_well(tmp_path: Path, place: dict[str, float]) -> None:
    """The same seeds, the same paths."""
    assert_one_picture(reference(picture(tmp_path, **place)), reference(picture(tmp_path)))


@pytest.mark.parametrize("change", [{"turn": 37.0}, {"size": (64, 48)}], ids=["turned", "film doubled"])
def test_means_stay(tmp_path: Path, change: dict[str, float]) -> None:
    """Of a scene that is turned with its camera, and of a film with four times the pixels."""
    means = []
    for options in ({}, change):
        found = image(picture(tmp_path, **options), spp=256)
        tall, wide = found.shape[0] // 4, found.shape[1] // 4
        means.append(found.reshape(4, tall, 4, wide, 3).mean((1, 3)))
    np.testing.assert_allclose(means[1], means[0], rtol=0.02)
    np.testing.assert_allclose(means[1].mean((0, 1)), means[0].mean((0, 1)), rtol=3e-3)


def test_twice_the_light_is_twice_the_image(tmp_path: Path) -> None:
    """Bit for bit: a factor of two rounds nothing."""
    once, twice = (image(picture(tmp_path, light=light)) for light in ("0.8, 0.9, 1.0", "1.6, 1.8, 2.0"))
    np.testing.assert_array_equal(twice, 2 * once)


def test_permuted_channels_permute_the_image(tmp_path: Path) -> None:
    """Bit for bit."""
    found = image(picture(tmp_path, light="0.8, 0.9, 1.0"))
    permuted = image(picture(tmp_path, light="1.0, 0.8, 0.9", colours=("0.1, 0.6, 0.2", "0.7, 0.2, 0.5")))
    np.testing.assert_array_equal(permuted, found[..., [2, 0, 1]])


def test_ordinary_scenes_keep_their_frame() -> None:
    """All that come with the harness, to the bit, but for those that are traps of scale."""
    others = {path.stem for path in (Path(__file__).parents[2] / "mitsuba_scenes").rglob("*.xml")
              if not frame_of(load_scene(path)).is_own}
    assert others == {"ground", "far_camera"}


def test_the_frame_of_a_tiny_scene_far_off(tmp_path: Path) -> None:
    """What is seen is a few units wide, about the origin."""
    scene = picture(tmp_path, unit=1e-3, shift=5.0)
    frame = frame_of(scene)
    assert 2.8 < 4.07e-3 * frame.scale < 5.7
    points, _ = seen(scene)
    np.testing.assert_allclose(frame.matrix[:3, :3] @ np.median(points, axis=0) + frame.matrix[:3, 3], 0, atol=1e-9)
    np.testing.assert_allclose(frame.inverse @ frame.matrix, np.eye(4), atol=1e-12)


def test_the_reference_warns_of_what_no_frame_mends(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A ground of radius 100,000, of which a few units are seen; not one of radius 1000."""
    for radius in (1e3, 1e5):
        body = (f'<shape type="sphere"><point name="center" x="0" y="{-radius}" z="0"/>'
                f'<float name="radius" value="{radius}"/>{GREY}</shape>{FURNACE}')
        ReferenceRenderer(write(tmp_path, body, np.array([0, 1.6, 2]), np.zeros(3), 30.0).file).release()
        assert ("of the width of what is seen" in caplog.text) == (radius == 1e5)
