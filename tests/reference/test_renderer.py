"""The reference renderer against closed forms, and the promises about seeds, ranges and films that batches rest on."""

from __future__ import annotations

import dataclasses
import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, SceneError
from harness.reference import ReferenceRenderer
from harness.reference.prepare import instantiate
from harness.reference.renderer import REPLICA_BITS, START_BITS, average, call_seed
from harness.samples.estimate import Estimate, merge
from harness.samples.keys import code_digest
from harness.scene import SceneFile, load_scene

# Standard errors allowed between two means: seeds are fixed, so this asks how lucky the seeds are, once.
SIGMAS = 4.0
INTEGRATORS = ["path", "bsdf_path"]


def scene(name: str, size: int = 32) -> SceneFile:
    """A scene of the collection at `size` x `size` pixels."""
    return SceneFile.bundled(name, (size, size))


def estimate(renderer: ReferenceRenderer, spp: int = 64, batches: int = 16) -> Estimate:
    """`batches` batches of `spp` samples."""
    return merge(renderer.render_batch(0, i * spp, spp) for i in range(batches))


@pytest.mark.parametrize("max_depth", [1, 2, 8])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_closed_cube_is_a_geometric_series(mi: Any, integrator: str, max_depth: int) -> None:
    """Inside emissive walls L = E (1 + ρ + … + ρ^(N-1)) everywhere: N vertices, no Russian roulette, no lost ray."""
    emission, albedo = np.array([0.2, 0.4, 0.6]), np.array([0.8, 0.5, 0.3])  # as in the file
    expected = emission * (1 - albedo**max_depth) / (1 - albedo)
    found = estimate(ReferenceRenderer(scene("furnace_cube"), integrator, max_depth=max_depth), spp=16)
    # 4e-5: rays that slip through the cube's edges.
    allowed = SIGMAS * np.sqrt(found.image_variance[:3]) + 4e-5
    assert (np.abs(found.image_mean[:3] - expected) <= allowed).all(), (found.image_mean[:3] - expected, allowed)
    assert found.rejected == 0


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_convex_body_shows_its_albedo(mi: Any, integrator: str) -> None:
    """A diffuse sphere under a constant environment of 1 is its albedo, and the background is 1."""
    found = estimate(ReferenceRenderer(scene("furnace_convex"), integrator), spp=32)
    centre = found.mean[12:20, 12:20].mean((0, 1))
    error = np.sqrt(found.variance[12:20, 12:20].sum((0, 1))) / 64
    assert (np.abs(centre - [0.8, 0.5, 0.2]) <= SIGMAS * error + 1e-6).all()
    np.testing.assert_allclose(found.mean[0, 0], 1, rtol=1e-6)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_plates_show_the_lobes_albedo(mi: Any, integrator: str) -> None:
    """Phong plates seen head on are ks (α+1)/(α+2), exponents 1 and 10 above, 100 and 300 below."""
    found = estimate(ReferenceRenderer(scene("furnace_phong"), integrator))
    for (row, column), alpha in {(0, 0): 1, (0, 1): 10, (1, 0): 100, (1, 1): 300}.items():
        plate = np.s_[16 * row + 5:16 * row + 11, 16 * column + 5:16 * column + 11]
        error = np.sqrt(found.variance[plate].sum((0, 1))) / 36
        expected = np.array([0.9, 0.6, 0.3]) * (alpha + 1) / (alpha + 2)
        # 1e-4: the camera is 400 units away, not infinitely far.
        assert (np.abs(found.mean[plate].mean((0, 1)) - expected) <= SIGMAS * error + 1e-4).all(), alpha


@pytest.mark.parametrize("name", ["spheres", "glossy_ladder", "cornell"])
def test_the_two_integrators_agree(mi: Any, name: str) -> None:
    """With and without light sampling the mean is the same, in the whole image and in each of 16 tiles."""
    path, bsdf = (estimate(ReferenceRenderer(scene(name), integrator), spp=32) for integrator in INTEGRATORS)
    z = (path.image_mean - bsdf.image_mean) / np.sqrt(path.image_variance + bsdf.image_variance)
    assert (np.abs(z) <= SIGMAS).all(), z

    def tiles(image: np.ndarray) -> np.ndarray:
        return image.reshape(4, 8, 4, 8, 3).mean((1, 3))
    difference = tiles(path.mean) - tiles(bsdf.mean)
    error = np.sqrt(tiles(path.variance + bsdf.variance) / 64)
    assert (np.abs(difference) <= 5 * error + 1e-6).all(), np.abs(difference / error).max()


def test_equal_ranges_give_equal_batches(mi: Any) -> None:
    """A range of a replica is one set of numbers, whichever renderer object draws it."""
    one = ReferenceRenderer(scene("spheres")).render_batch(3, 16, 8)
    again = ReferenceRenderer(scene("spheres")).render_batch(3, 16, 8)
    np.testing.assert_array_equal(one.mean, again.mean)
    assert one.samples == 8 and one.mean.dtype == np.float32 and one.mean.shape == (32, 32, 3)
    assert one.cost.seconds > 0


def test_distinct_ranges_and_replicas_are_independent(mi: Any) -> None:
    """The noise of neighbouring ranges and replicas is uncorrelated."""
    renderer = ReferenceRenderer(scene("spheres"))
    truth = estimate(renderer).mean
    noise = [(renderer.render_batch(*place, 4).mean - truth).ravel() for place in ((1, 0), (1, 4), (2, 0), (2, 4))]
    correlation = np.corrcoef(noise) - np.eye(4)
    # Channels of one pixel share their noise, so a third of the values counts.
    assert np.abs(correlation).max() < SIGMAS / np.sqrt(noise[0].size / 3)


def test_a_range_may_be_cut_at_any_call(mi: Any) -> None:
    """One batch of several calls equals, in float64, the same range drawn in separate batches."""
    renderer = ReferenceRenderer(scene("spheres"))
    renderer.samples_per_call = 8
    told: list[int] = []
    whole = renderer.render_batch(0, 0, 20, told.append)
    assert told == [8, 8, 4]
    parts = merge(renderer.render_batch(0, start, count) for start, count in ((0, 8), (8, 8), (16, 4)))
    np.testing.assert_allclose(whole.mean, parts.mean, rtol=1e-6)
    assert whole.samples == parts.samples == 20


def test_large_images_are_drawn_in_short_calls(mi: Any) -> None:
    """A call stays within 2^22 samples, and within 256 a pixel."""
    assert ReferenceRenderer(scene("furnace_convex", 32)).samples_per_call == 256
    assert ReferenceRenderer(scene("furnace_convex", 1024)).samples_per_call == 4
    assert ReferenceRenderer(scene("furnace_convex", 8192)).samples_per_call == 1


def test_seeds_never_repeat() -> None:
    """Each replica and first sample has its own 32-bit seed, the corners of the range included."""
    starts = [0, 1, 2, 255, 256, (1 << START_BITS) - 1, *range(64, 1 << START_BITS, 4096)]
    replicas = [0, 1, 2, 3, (1 << REPLICA_BITS) - 1, *range(4, 1 << REPLICA_BITS, 97)]
    seeds = {call_seed(replica, start) for replica in replicas for start in starts}
    assert len(seeds) == len(set(replicas)) * len(set(starts))
    assert min(seeds) >= 0 and max(seeds) < 1 << 32


def test_samples_that_are_not_finite_are_left_out_and_counted() -> None:
    """A NaN spoils one call of one pixel, not the pixel; a pixel without any finite call is 0."""
    first, second = np.full((2, 2, 3), 1.0, np.float32), np.full((2, 2, 3), 4.0, np.float32)
    first[0, 0, 1] = np.nan
    first[1, 1], second[1, 1] = np.inf, np.nan
    mean, rejected = average([(first, 10), (second, 20)])
    assert mean.dtype == np.float64
    np.testing.assert_array_equal(mean[..., 0], [[4, 3], [3, 0]])
    np.testing.assert_array_equal(mean[0, 0], [4, 4, 4])
    assert rejected == 10 + 30


WINDOW = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="1"/></integrator>
    <sensor type="perspective"><float name="fov" value="90"/>
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="4"/>
            <float name="exposure" value="2"/>{filter}</film>
        <sampler type="multijitter"/>
    </sensor>
    <shape type="rectangle">
        <transform name="to_world"><rotate y="1" angle="180"/><scale value="0.2"/><translate x="{x}" y="{y}" z="1"/>
        </transform>
        <emitter type="area"><float name="radiance" value="1"/></emitter>
    </shape>
</scene>"""


@pytest.mark.parametrize(("x", "y", "row", "column"), [(0.375, 0.375, 0, 2), (-0.375, -0.375, 3, 5)])
def test_row_0_is_on_top_and_plus_x_on_the_left(mi: Any, tmp_path: Path, x: float, y: float, row: int,
                                                column: int) -> None:
    """A small light shows in the pixel where the camera's conventions put it, and in no other with the box filter."""
    path = tmp_path / "scene.xml"
    path.write_text(WINDOW.format(x=x, y=y, filter='<rfilter type="gaussian"/>').replace('"0.2"', '"0.1"'))
    image = ReferenceRenderer(SceneFile(path)).render_batch(0, 0, 64).mean[..., 0]
    assert image.shape == (4, 8)
    assert np.argwhere(image > 0).tolist() == [[row, column]]


def test_the_film_is_the_scenes(mi: Any, tmp_path: Path) -> None:
    """Size as asked for, box filter and independent sampler whatever the file says, and no hidden border."""
    path = tmp_path / "scene.xml"
    path.write_text(WINDOW.format(x=0, y=0, filter=""))
    sensor = instantiate(SceneFile(path, size=(10, 6))).sensors()[0]
    assert tuple(sensor.film().size()) == (10, 6)
    assert sensor.film().rfilter().is_box_filter()
    assert "IndependentSampler" in str(sensor.sampler())
    assert "component_format = float32" in str(sensor.film())


def test_meshes_of_one_material_may_face_different_ways(mi: Any, tmp_path: Path) -> None:
    """Mitsuba would merge the two cubes and then refuse them, since their `flip_normals` differ."""
    cubes = "".join(f"""<shape type="cube"><ref id="white"/><boolean name="flip_normals" value="{flip}"/>
        <transform name="to_world"><scale value="0.5"/><translate x="{x}"/></transform></shape>"""
                    for x, flip in ((-1, "false"), (1, "true")))
    path = tmp_path / "two.xml"
    path.write_text(f"""<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective">
            <transform name="to_world"><lookat origin="0,0,6" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/>
            <rfilter type="box"/></film></sensor>
        <emitter type="constant"><float name="radiance" value="1"/></emitter>
        <bsdf type="diffuse" id="white"/>{cubes}</scene>""")
    image = ReferenceRenderer(SceneFile(path)).render_batch(0, 0, 1024).mean
    assert image[14:18, 9:12].mean() == pytest.approx(0.5, rel=0.05), "the front of the one shows its albedo"
    assert image[16, 21] == pytest.approx(0.0, abs=1e-6), "the back of the other is black"


def test_russian_roulette_stays_off(mi: Any) -> None:
    """Beyond Mitsuba's default roulette depth the closed cube keeps the noise of its first bounces.

    Without light sampling every path of the cube is worth the same to the last bit; roulette would scatter them, and
    that it is off in `path` too is asked of its own description.
    """
    batch = ReferenceRenderer(scene("furnace_cube"), "bsdf_path", max_depth=30).render_batch(0, 0, 4)
    assert np.ptp(batch.mean, axis=(0, 1)).max() < 1e-6
    renderer = ReferenceRenderer(scene("furnace_cube"), max_depth=30)
    assert "rr_depth = 1048576" in str(renderer._integrator)


def test_identity_tells_apart_what_differs(mi: Any) -> None:
    """All values are strings; the scene, its size and the integrator each change the identity."""
    identities = [ReferenceRenderer(*arguments).identity for arguments in (
        (scene("spheres"),), (scene("spheres", 16),), (scene("cornell"),), (scene("spheres"), "bsdf_path"))]
    assert len({tuple(sorted(identity.items())) for identity in identities}) == 4
    assert all(isinstance(value, str) and value for identity in identities for value in identity.values())
    assert identities[0] == ReferenceRenderer(scene("spheres")).identity
    assert identities[0]["code"] == code_digest("harness.reference.renderer")


def test_a_scene_without_a_file_is_refused() -> None:
    """Mitsuba renders files; the message says how to make one."""
    made = dataclasses.replace(load_scene(scene("spheres").path), path=None)
    with pytest.raises(HarnessError, match=r"has no file.*load_scene"):
        ReferenceRenderer(made.file)


def test_the_file_is_what_is_rendered_whatever_became_of_a_reading(mi: Any, tmp_path: Path) -> None:
    """A file edited after loading is another scene to the store too; the depth may be another than the file's."""
    path = tmp_path / "scene.xml"
    path.write_text(WINDOW.format(x=0, y=0, filter=""))
    file = load_scene(path).file
    before = ReferenceRenderer(file).identity
    assert ReferenceRenderer(file, max_depth=5).identity == {**before, "max_depth": "5"}
    path.write_text(WINDOW.format(x=0.5, y=0, filter=""))
    assert ReferenceRenderer(file).identity["scene"] != before["scene"]


def test_a_refusal_by_mitsuba_is_one_line(mi: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """What Mitsuba says about a scene ends in the harness's error, without a Python plugin's traceback."""
    bad = """<scene version="3.0.0"><sensor type="perspective"/><shape type="sphere">
        <bsdf type="phong"><float name="ks" value="-1"/></bsdf></shape></scene>"""
    config = mi.parser.ParserConfig("llvm_ad_rgb")
    monkeypatch.setattr(SceneFile, "parsed", lambda file: mi.parser.parse_string(config, bad))
    with pytest.raises(SceneError, match=r"convex\.xml: Mitsuba refuses the scene: .*phong: ks is -1") as caught:
        ReferenceRenderer(scene("furnace_convex"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("replica", "start", "count", "message"), [
    (-1, 0, 1, "replica is -1"), (1 << REPLICA_BITS, 0, 1, "replica is 1024"),
    (0, -1, 1, "samples -1 to -1"), (0, 0, 0, "at least one"), (0, (1 << START_BITS) - 1, 2, "out of range"),
])
def test_ranges_that_seeds_cannot_tell_apart_are_refused(mi: Any, replica: int, start: int, count: int,
                                                         message: str) -> None:
    """The message holds what was asked and what is allowed."""
    with pytest.raises(HarnessError, match=message):
        ReferenceRenderer(scene("furnace_convex")).render_batch(replica, start, count)


def test_an_unknown_integrator_is_refused() -> None:
    """The message lists the known ones."""
    with pytest.raises(HarnessError, match=r"integrator 'metropolis' cannot be used \(.*\); allowed: path, bsdf_path"
                       ) as caught:
        ReferenceRenderer(scene("spheres"), "metropolis")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["spheres", "motion_blur"])
def test_a_renderer_that_is_released_holds_no_scene_and_goes_on(name: str) -> None:
    """Mitsuba's objects are gone, which drjit would compile into the kernels of all other scenes."""
    def living() -> int:
        gc.collect()
        return sum(type(thing).__name__ == "Phong" for thing in gc.get_objects())

    before = living()
    renderer = ReferenceRenderer(scene(name))
    first = renderer.render_batch(0, 0, 4)
    assert living() > before
    renderer.release()
    assert living() == before
    np.testing.assert_array_equal(renderer.render_batch(0, 0, 4).mean, first.mean)
    assert living() > before
