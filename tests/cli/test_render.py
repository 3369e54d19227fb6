"""`harness render` and `harness reference`: the files they write, what they say, and what they read back."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from harness.cli.render import _speed
from harness.errors import MachineError
from harness.files import data_dir
from harness.gpu.renderer import TracerRenderer
from harness.samples.cost import Cost
from harness.samples.estimate import Batch, merge
from harness.samples.exr import read_estimate
from harness.samples.tone import encode_srgb
from harness.scene import load_scene
from tests.cli.conftest import Harness
from tests.conftest import RunHarness

SPHERES = data_dir("mitsuba_scenes") / "spheres.xml"
SMALL = ("--size", "16x12", "--spp", "4")


@pytest.mark.parametrize("command", ["render", "reference"])
def test_the_depth_is_the_one_asked_for(harness: Harness, command: str) -> None:
    """Of the closed cube E at depth 1, E (1 + ρ) at depth 2: the tracer's exactly, Mitsuba samples the walls' light."""
    tolerance = 1e-4 if command == "render" else 0.05
    scene = data_dir("mitsuba_scenes") / "furnace_cube.xml"
    for depth, expected in ((1, (0.2, 0.4, 0.6)), (2, (0.36, 0.6, 0.78))):
        done = harness(command, scene, *SMALL, "--max-depth", depth, "--json", "-o", "x.exr")
        assert done.json["scene"] == f"furnace_cube max_depth={depth}"
        found = [done.json["mean"][name] for name in ("red", "green", "blue")]
        np.testing.assert_allclose(found, expected, rtol=tolerance)
    assert harness(command, scene, "--max-depth", 0).status == 2


def test_a_sampler_is_told_and_its_noise_is_not(harness: Harness) -> None:
    """Of one replica of evenly spread samples no variance is told; of several files `compare` finds it."""
    done = harness("render", SPHERES, *SMALL, "--sampler", "sobol", "--json", "-o", "s0.exr")
    assert done.json["harness.sampler"] == "sobol"
    assert done.json["standard_error"]["luminance"] is None
    assert "holds no variance; render it again with --replica 1" in done.err
    for replica in (1, 2):
        harness("render", SPHERES, *SMALL, "--sampler", "sobol", "--replica", replica, "-o", f"s{replica}.exr")
    harness("render", SPHERES, "--size", "16x12", "--spp", 64, "-o", "truth.exr")
    one, several = (harness("compare", name, "truth.exr", "--json").json for name in ("s0.exr", "s?.exr"))
    assert one["verdict"] is None
    assert several["verdict"]["dof"][3] > 0
    refused = harness("render", SPHERES, "--sampler", "halton")
    assert refused.status == 2
    assert "unknown sampler 'halton'; choose from independent, sobol" in refused.err


def test_samples_of_several_devices_have_no_speed() -> None:
    """Their seconds have no sum; the line says so in place of a NaN."""
    drawn = [Batch(np.ones((2, 2, 3), np.float32), 4, 0, Cost(1.0, 2.0, None, device, "cpu")) for device in "ab"]
    assert _speed(merge(drawn[:1])) == "8e-06 million samples a CPU second"
    assert _speed(merge(drawn)).startswith("speed unknown: ")


class TestExr:
    """Any viewer opens it, and it says where it comes from."""

    @pytest.mark.parametrize(("command", "strategy", "renderer"), [
        ("render", "mixture", "glsl"), ("reference", "mitsuba path", "mitsuba")])
    def test_carries_what_was_rendered_and_how(
        self, harness: Harness, command: str, strategy: str, renderer: str,
    ) -> None:
        assert harness(command, SPHERES, *SMALL, "--replica", 3, "-o", "x.exr").status == 0
        with OpenEXR.File("x.exr") as file:
            header = dict(file.header())
        assert header["spp"] == 4
        assert header["replica"] == 3
        assert header["strategy"] == strategy
        assert header["scene"] == "spheres"
        assert header["harness.scene"] == load_scene(SPHERES, width=16, height=12).content_hash
        assert header["harness.renderer"] == renderer

    def test_has_the_colours_as_its_image_and_the_variance_as_a_layer(self, harness: Harness) -> None:
        harness("render", SPHERES, *SMALL, "-o", "x.exr")
        with OpenEXR.File("x.exr") as file:
            assert list(file.channels()) == ["RGB", "third", "variance", "variance.Y"]
            pixels = file.channels()["RGB"].pixels
        estimate, _ = read_estimate("x.exr")
        np.testing.assert_array_equal(pixels, estimate.mean)
        assert estimate.samples == 4
        assert (estimate.variance > 0).any()

    def test_is_put_into_folders_yet_to_be_made_under_any_name(self, harness: Harness, sky: Path) -> None:
        scene = sky.with_name("schöner Himmel.xml")
        sky.rename(scene)
        target = Path("ein Ordner", "für Bilder", "größer.EXR")
        done = harness("render", scene, "--spp", 2, "-o", target)
        assert done.status == 0
        assert done.out.startswith(f"{target}: 16 x 12, 2 spp, ")
        assert read_estimate(target)[1]["scene"] == "schöner Himmel"

    @pytest.mark.parametrize(("command", "name"), [("render", "sky.exr"), ("reference", "sky-reference.exr")])
    def test_is_named_after_the_scene_unless_told_otherwise(
        self, harness: Harness, sky: Path, here: Path, command: str, name: str,
    ) -> None:
        assert harness(command, sky, "--spp", 2).status == 0
        assert [path.name for path in here.iterdir()] == [name]


def test_a_png_is_ready_to_look_at(harness: Harness, sky: Path) -> None:
    """Radiance 0.5, 0.25, 1 at -1 stops, as sRGB."""
    assert harness("render", sky, "--spp", 2, "-o", "x.png").status == 0
    with Image.open("x.png") as image:
        assert image.mode == "RGB"
        pixels = np.asarray(image)
    expected = np.round(255 * encode_srgb([0.5, 0.25, 1.0], exposure=-1.0))
    np.testing.assert_array_equal(pixels, np.broadcast_to(expected, (12, 16, 3)))


def test_replicas_are_independent_and_repeatable(harness: Harness) -> None:
    for name, replica in (("a", 0), ("b", 1), ("again", 0)):
        harness("render", SPHERES, *SMALL, "--no-cache", "--replica", replica, "-o", f"{name}.exr")
    first, second, again = (read_estimate(f"{name}.exr")[0].mean for name in ("a", "b", "again"))
    np.testing.assert_array_equal(first, again)
    assert (first != second).any()


@pytest.mark.parametrize("command", ["render", "reference"])
def test_json_is_one_object_with_the_means_of_the_image(harness: Harness, sky: Path, command: str) -> None:
    done = harness(command, sky, "--spp", 4, "-o", "x.exr", "--json")
    assert done.json["output"] == "x.exr"
    assert done.json["size"] == [16, 12]
    assert done.json["mean"]["red"] == 0.5
    assert done.json["standard_error"]["blue"] == 0
    assert done.err == ""


class TestCache:
    """Samples are rendered once."""

    @pytest.mark.parametrize(("command", "spp"), [("render", 8), ("reference", 8), ("reference", 256)])
    def test_a_second_run_renders_nothing(
        self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, command: str, spp: int,
    ) -> None:
        harness(command, sky, "--spp", spp, "-o", "x.exr")

        def refuse(*arguments: object) -> Batch:
            raise AssertionError("rendered again")

        for name in ("gpu.renderer.TracerRenderer", "reference.renderer.ReferenceRenderer"):
            monkeypatch.setattr(f"harness.{name}.render_batch", refuse)
        assert harness(command, sky, "--spp", spp, "-o", "again.exr").status == 0
        np.testing.assert_array_equal(read_estimate("again.exr")[0].mean, read_estimate("x.exr")[0].mean)

    def test_is_neither_read_nor_written_where_not_wanted(self, harness: Harness, sky: Path, tmp_path: Path) -> None:
        harness("render", sky, "--spp", 2, "--no-cache")
        assert not (tmp_path / "cache").exists()

    @pytest.mark.parametrize("damage", [
        pytest.param(lambda data: data[:100], id="truncated"), pytest.param(lambda data: b"", id="empty"),
        pytest.param(lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:], id="a bit"),
        pytest.param(lambda data: b"\x89PNG" + data[4:], id="another format"),
    ])
    def test_a_damaged_file_is_said_and_rendered_again(
        self, harness: Harness, tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: object,
    ) -> None:
        harness("render", SPHERES, *SMALL, "-o", "x.exr")
        files = sorted((tmp_path / "cache").rglob("*.exr"))
        assert len(files) == 3
        files[1].write_bytes(damage(files[1].read_bytes()))  # type: ignore[operator]
        with caplog.at_level(logging.WARNING):
            done = harness("render", SPHERES, *SMALL, "-o", "again.exr", "--json")
        assert json.loads(done.out)["output"] == "again.exr"
        assert len(caplog.records) == 1
        assert str(files[1]) in caplog.text
        assert "set aside as set-aside/" in caplog.text and "its samples are rendered again" in caplog.text
        np.testing.assert_array_equal(read_estimate("again.exr")[0].mean, read_estimate("x.exr")[0].mean)
        assert harness("render", SPHERES, *SMALL, "-o", "again.exr").err == "", "the damage was mended"


def test_notes_and_warnings_leave_stdout_alone(harness: Harness, sky: Path) -> None:
    """A replaced filter and a strategy that misses light are said on stderr."""
    sky.write_text(sky.read_text().replace('type="box"', 'type="tent"').replace("</scene>", """
        <shape type="sphere"><bsdf type="phong"/></shape></scene>"""))
    done = harness("render", sky, "--spp", 2, "--strategy", "phong", "--json")
    assert done.status == 0
    assert done.json["strategy"] == "phong"
    assert f"{sky}: note: reconstruction filter 'tent' replaced by box in both renderers\n" in done.err
    assert f"{sky}: warning: strategy 'phong': " in done.err


@pytest.mark.parametrize("command", ["render", "study"])
def test_samples_that_were_not_finite_are_counted_aloud(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, command: str,
) -> None:
    def broken(renderer: TracerRenderer, replica: int, start: int, count: int, advance: object = None) -> Batch:
        cost = Cost(0.1, 0.1, None, "cpu: test", "cpu")
        return Batch(np.full((12, 16, 3), 0.5, dtype=np.float32), count, rejected=7, cost=cost)

    monkeypatch.setattr(TracerRenderer, "render_batch", broken)
    options = ("--replicas", 2, "--strategies", "mixture") if command == "study" else ()
    done = harness(command, sky, "--spp", 4, *options)
    batches = 3 * (2 if command == "study" else 1)
    assert f"samples that were not finite and were left out: {7 * batches}; look for a division by zero" in done.err


def test_speed_is_by_the_clock_that_counts_on_the_device(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """16 x 12 pixels of 8 samples in 3 ms of a card's time, whatever the process spent beside it."""
    def drawn(renderer: TracerRenderer, replica: int, start: int, count: int, *more: object) -> Batch:
        cost = Cost(1.0, 2.0, 3e-3 * count / 8, "a card", "gpu")
        return Batch(np.zeros((12, 16, 3), dtype=np.float32), count, cost=cost)

    monkeypatch.setattr("harness.gpu.renderer.TracerRenderer.render_batch", drawn)
    assert harness("render", sky, "--spp", 8).out.endswith(" 0.512 million samples a GPU second\n")
    told = harness("render", sky, "--spp", 8, "--json").json
    assert (told["clock"], told["device"], told["seconds"]) == ("gpu", "a card", pytest.approx(3e-3))


def test_the_machine_short_of_opengl_is_one_line_and_status_3(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, here: Path,
) -> None:
    def lacking() -> None:
        raise MachineError("no headless OpenGL 4.3; type: apt-get install -y libegl1")

    monkeypatch.setattr("harness.gpu.pingpong.context", lacking)
    monkeypatch.setattr("harness.gpu.context.context", lacking)
    done = harness("render", sky, "--spp", 2)
    assert done.status == 3
    assert done.err == "harness: error: no headless OpenGL 4.3; type: apt-get install -y libegl1\n"
    assert list(here.iterdir()) == []


def test_a_folder_with_a_main_of_its_own_is_drawn(run_harness: RunHarness, tmp_path: Path) -> None:
    """Where the processor has AVX-512 the tracer alone would be given 512 bits, at which fragment shaders crash."""
    (tmp_path / "own").mkdir()
    main = (data_dir("glsl") / "path_tracer.frag").read_text(encoding="utf-8")
    (tmp_path / "own" / "path_tracer.frag").write_text(main + "// own\n", encoding="utf-8")
    scene = data_dir("mitsuba_scenes") / "spheres.xml"
    done = run_harness("render", str(scene), "--size", "16x12", "--spp", "1", "--library", "own", "-o", "own.exr")
    assert (done.returncode, done.stderr.count("error")) == (0, 0)
    assert (tmp_path / "own.exr").exists()
