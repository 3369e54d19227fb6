"""`harness compare`: metrics for any two images, a verdict where both know their variance, a status that says which."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from harness.samples.estimate import Estimate
from harness.samples.exr import write_estimate
from harness.work.batches import render_estimate
from tests.cli.conftest import Harness, refusal
from tests.support.fakes import NoiseRenderer
from tests.support.metrics import register

SCENE = {"harness.scene": "0123456789abcdef"}
SHAPE = (16, 24)


def ours(name: str, mean: float = 0.5, samples: int = 4096, replica: int = 0, **metadata: object) -> str:
    """A file of the harness: noise around `mean`, of standard deviation 0.3 a sample."""
    estimate = render_estimate(NoiseRenderer(mean=mean, size=SHAPE), samples, replica=replica)
    write_estimate(name, estimate, {**SCENE, **metadata})
    return name


def foreign(name: str, channels: dict[str, np.ndarray] | None = None, **header: Any) -> str:
    """A file of another renderer."""
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels or {"RGB": colours()}) as file:
        file.write(name)
    return name


def colours(kind: type[np.generic] = np.float32) -> np.ndarray:
    return np.random.default_rng(1).random((*SHAPE, 3)).astype(kind)


class TestVerdict:
    """Status 0 for pass, 1 for fail and inconclusive alike."""

    @pytest.mark.parametrize(("mean", "samples", "tolerance", "outcome", "status"), [
        (0.5, 4096, 0.01, "pass", 0), (0.51, 4096, 0.002, "fail", 1), (0.5, 64, 0.0001, "inconclusive", 1)])
    def test_decides_the_status(
        self, harness: Harness, mean: float, samples: int, tolerance: float, outcome: str, status: int,
    ) -> None:
        test = ours("x.exr", mean, samples, replica=1)
        done = harness("compare", test, ours("truth.exr"), "--tolerance", tolerance, "--json")
        assert done.json["verdict"]["outcome"] == outcome
        assert done.status == status

    def test_is_told_with_each_channels_interval(self, harness: Harness) -> None:
        done = harness("compare", ours("x.exr", replica=1), ours("truth.exr"), "--tolerance", "0.01")
        lines = done.out.splitlines()
        assert [line.partition(": ")[0] for line in lines[-4:]] == ["verdict", "tiles of 4 px", "tiles of 1 px",
                                                                    "smallest bias sure to fail"]
        assert all(": pass: " in line for line in lines[-4:-1])
        assert [line.split(" ")[2] for line in lines if line.startswith("mean error, ")] == [
            "red", "green", "blue", "luminance"]
        assert done.err == ""

    def test_goes_against_an_image_that_is_wrong_in_one_place(self, harness: Harness) -> None:
        """The mean is right: what is too bright here is too dark there."""
        patched = np.full((*SHAPE, 1), 0.5)
        patched[4:8, 8:12], patched[8:12, 4:8] = 0.6, 0.4
        write_estimate("x.exr", render_estimate(NoiseRenderer(mean=patched, size=SHAPE), 4096, replica=1), SCENE)
        done = harness("compare", "x.exr", ours("truth.exr"), "--tolerance", "0.005", "--json")
        assert done.status == 1
        assert done.json["verdict"]["outcome"] == "pass"
        coarse = done.json["tiles"]["coarse"]
        assert (coarse["outcome"], coarse["tile"]) == ("fail", 4)
        assert (coarse["x"], coarse["y"]) in ((8, 4), (4, 8))
        assert abs(coarse["error"]) == pytest.approx(0.2, abs=0.02)

    def test_leaves_tiles_undecided_that_are(self, harness: Harness) -> None:
        done = harness("compare", ours("x.exr", replica=1), ours("truth.exr"), "--tolerance", "0.003")
        assert done.status == 0
        fine = done.out.splitlines()[-2]
        assert fine.startswith("tiles of 1 px: inconclusive: ")
        assert re.search(r"; draw more samples, about [\d.,]+ times as many$", fine)

    def test_is_inconclusive_for_a_render_of_ours_too_short_to_know_its_variance(self, harness: Harness) -> None:
        done = harness("compare", ours("x.exr", samples=1), ours("truth.exr"), "--json")
        assert done.status == 1
        assert done.json["verdict"]["outcome"] == "inconclusive"
        assert "variance" in done.json["verdict"]["reason"]
        assert all("variance of the test image is unknown" in tiles["reason"] for tiles in done.json["tiles"].values())

    @pytest.mark.parametrize("swapped", [False, True])
    def test_is_not_given_for_files_of_others(self, harness: Harness, swapped: bool) -> None:
        files = [foreign("theirs.exr"), ours("ours.exr")]
        done = harness("compare", *(reversed(files) if swapped else files))
        assert done.status == 0
        assert done.out.splitlines()[-1].startswith(
            "no verdict: theirs.exr is one render without variance; a second one with another seed, the two named "
            "'theirs_*.exr', gives the mean's error an interval of about ±")
        assert "rmse" in done.out

    def test_is_none_in_json_for_files_of_others(self, harness: Harness) -> None:
        done = harness("compare", foreign("theirs.exr"), ours("ours.exr"), "--json")
        assert done.json["verdict"] is done.json["tiles"] is None
        assert done.json["rmse"] > 0

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_goes_against_an_image_that_is_not_finite_whoever_made_it(self, harness: Harness, value: float) -> None:
        broken = colours()
        broken[3, 4, 1] = value
        done = harness("compare", foreign("x.exr", {"RGB": broken}), ours("truth.exr"), "--json")
        assert done.status == 1
        assert done.json["verdict"]["outcome"] == "fail"
        assert done.json["rmse"] is None
        assert done.err == ("warning: x.exr: pixels that are not finite: 1; metrics that see them are not either\n")

    def test_is_not_reached_by_a_reference_that_is_not_finite(self, harness: Harness) -> None:
        broken = colours()
        broken[3, 4, 1] = np.inf
        done = harness("compare", ours("x.exr"), foreign("truth.exr", {"RGB": broken}), "--json")
        assert done.json["verdict"] is None
        assert done.err.startswith("warning: truth.exr: pixels that are not finite: 1;")


class TestMetrics:
    """Of what the images show."""

    def test_of_an_image_with_itself_are_perfect(self, harness: Harness) -> None:
        done = harness("compare", foreign("x.exr"), "x.exr", "--json")
        assert [done.json[name] for name in ("rmse", "relmse", "ssim", "flip", "delta_e2000")] == [0, 0, 1, 0, 0]

    def test_that_are_new_in_the_registry_are_shown(self, harness: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
        register(monkeypatch)
        foreign("x.exr")
        foreign("y.exr", {"RGB": colours() + np.float32(0.5)})
        answer = harness("compare", "x.exr", "y.exr", "--json").json
        assert answer["largest_error"] == pytest.approx(0.5) and answer["share_off"] == 1.0
        lines = harness("compare", "x.exr", "y.exr").out.splitlines()
        assert [line.split() for line in lines if line.startswith(("largest", "share"))] == [
            ["largest_error", "0.5", *["largest", "difference", "of", "a", "pixel"]],
            ["share_off", "1", *["part", "of", "the", "values", "that", "differ"]]]

    def test_take_the_exposure_of_the_reference(self, harness: Harness) -> None:
        ours("x.exr", 0.4), ours("dark.exr", 0.5, exposure=-3.0), ours("plain.exr", 0.5)
        shown = {name: harness("compare", "x.exr", name, "--json").json for name in ("dark.exr", "plain.exr")}
        assert shown["dark.exr"]["exposure"] == -3.0
        assert shown["plain.exr"]["exposure"] == 0.0
        assert shown["dark.exr"]["delta_e2000"] < shown["plain.exr"]["delta_e2000"]
        told = harness("compare", "x.exr", "plain.exr", "--exposure", "-3", "--json").json
        assert told["delta_e2000"] == pytest.approx(shown["dark.exr"]["delta_e2000"])

    @pytest.mark.parametrize("exposure", ["bright", 1e30, float("nan"), 2.5])
    def test_take_no_exposure_from_files_of_others(self, harness: Harness, exposure: object) -> None:
        """What the name means there is not ours to know: a camera's seconds, say."""
        done = harness("compare", ours("x.exr"), foreign("truth.exr", exposure=exposure), "--json")
        assert done.status == 0
        assert done.json["exposure"] == 0.0

    @pytest.mark.parametrize("channels", [
        pytest.param(lambda: {"RGB": colours(np.float16)}, id="half floats"),
        pytest.param(lambda: {"RGBA": np.dstack([colours(), np.ones(SHAPE, dtype=np.float32)])}, id="alpha"),
        pytest.param(lambda: {"RGB": colours(), "Z": np.ones(SHAPE, dtype=np.float32)}, id="depth"),
        pytest.param(lambda: {name: (9 * colours()[..., 0]).astype(np.uint32) for name in "RGB"}, id="integers"),
    ])
    def test_read_what_other_renderers_write(
        self, harness: Harness, channels: Callable[[], dict[str, np.ndarray]],
    ) -> None:
        done = harness("compare", foreign("x.exr", channels()), foreign("truth.exr"), "--json")
        assert done.status == 0
        assert done.json["ssim"] > -1

    @pytest.mark.parametrize("kind", ["tiled", "multi-part", "data window"])
    def test_read_however_it_is_stored(self, harness: Harness, kind: str) -> None:
        if kind == "tiled":
            foreign("x.exr", type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription())
        elif kind == "data window":
            corners = [np.array(corner, dtype=np.int32) for corner in ((5, 5), (28, 20), (0, 0), (63, 63))]
            foreign("x.exr", dataWindow=tuple(corners[:2]), displayWindow=tuple(corners[2:]))
        else:
            with OpenEXR.File([OpenEXR.Part({"name": name}, {"RGB": colours()}) for name in "ab"]) as file:
                file.write("x.exr")
        done = harness("compare", "x.exr", foreign("truth.exr", {"RGB": colours()}), "--json")
        assert done.status == 0
        assert done.json["rmse"] == 0


class TestRefusals:
    """What is no image to compare."""

    @pytest.mark.parametrize(("content", "complaint"), [
        (None, "no such file; check the name, or render it first"),
        (b"", "an empty file; render it again"),
        (struct.pack("<I", 20000630), "truncated or damaged EXR file"),
        (b"\x89PNG\r\n\x1a\n", "truncated or damaged image"),
    ])
    @pytest.mark.parametrize("position", [0, 1])
    def test_no_exr_file(
        self, harness: Harness, content: bytes | None, complaint: str, position: int,
    ) -> None:
        if content is not None:
            Path("bad.exr").write_bytes(content)
        files = [ours("good.exr")] * 2
        files[position] = "bad.exr"
        assert refusal(harness("compare", *files)).startswith(f"bad.exr: {complaint}")

    @pytest.mark.parametrize("write", [ours, foreign])
    def test_a_truncated_file(self, harness: Harness, write: Callable[[str], str]) -> None:
        whole = Path(write("x.exr")).read_bytes()
        Path("cut.exr").write_bytes(whole[:2 * len(whole) // 3])
        assert refusal(harness("compare", "cut.exr", "x.exr")) == (
            "cut.exr: truncated or damaged EXR file; remove it and render it again")

    def test_an_empty_folder_and_a_device(self, harness: Harness) -> None:
        """A device is not read, for it may never end."""
        Path("folder.exr").mkdir()
        assert refusal(harness("compare", "folder.exr", "x.exr")).startswith("folder.exr: no image in this folder")
        assert refusal(harness("compare", "/dev/zero", "x.exr")).startswith("/dev/zero: not a regular file")

    def test_a_pattern_without_files_and_one_that_the_shell_expanded(self, harness: Harness) -> None:
        assert refusal(harness("compare", "no_*.exr", "x.exr")).startswith("no_*.exr: no file matches this pattern")
        assert "found 3; quote patterns" in refusal(harness("compare", "a.exr", "b.exr", "c.exr"))

    @pytest.mark.parametrize(("names", "held"), [("Y", "Y"), (("a.R", "a.G", "a.B"), "a.B, a.G, a.R")])
    def test_channels_other_than_red_green_and_blue(self, harness: Harness, names: tuple[str, ...], held: str) -> None:
        foreign("x.exr", {name: np.ones(SHAPE, dtype=np.float32) for name in names})
        assert refusal(harness("compare", "x.exr", ours("truth.exr"))) == (
            f"x.exr: lacks channel R, G, B, holds {held}; write it as an RGB image")

    def test_images_of_two_sizes(self, harness: Harness) -> None:
        foreign("x.exr", {"RGB": np.ones((20, 20, 3), dtype=np.float32)})
        assert refusal(harness("compare", "x.exr", ours("truth.exr"))) == (
            "x.exr is 20 x 20, truth.exr is 24 x 16; render both at the same size")

    def test_images_smaller_than_the_window_of_ssim(self, harness: Harness) -> None:
        foreign("x.exr", {"RGB": np.ones((5, 20, 3), dtype=np.float32)})
        assert refusal(harness("compare", "x.exr", "x.exr")).startswith("SSIM needs images of at least 11 x 11 pixels")

    def test_one_image_only(self, harness: Harness) -> None:
        assert refusal(harness("compare", "x.exr")) == "Missing argument 'reference'; see `harness compare --help`"


def test_images_of_two_scenes_are_compared_with_a_warning(harness: Harness) -> None:
    ours("x.exr"), ours("truth.exr", **{"harness.scene": "fedcba9876543210"})
    done = harness("compare", "x.exr", "truth.exr", "--json")
    assert done.err == ("warning: truth.exr: rendered from another scene, or another size or version of it (scene hash "
                        "fedcba9876543210, not 0123456789abcdef)\n")
    assert done.json["verdict"] is not None
    assert harness("compare", "x.exr", "x.exr").err == ""


class TestRuns:
    """Several files a side are independent runs."""

    @staticmethod
    def runs(name: str, count: int, mean: float = 0.5, first: int = 0, samples: int = 64) -> str:
        for k in range(first, first + count):
            pixels = render_estimate(NoiseRenderer(mean=mean, size=SHAPE), samples, replica=k).mean
            foreign(f"{name}_{k}.exr", {"RGB": pixels.astype(np.float32)}, spp=samples)
        return f"{name}_*.exr"

    @pytest.mark.parametrize(("mean", "outcome", "status"), [(0.5, "pass", 0), (0.55, "fail", 1)])
    def test_decide(self, harness: Harness, mean: float, outcome: str, status: int) -> None:
        mine, truth = self.runs("mine", 12, mean), self.runs("truth", 12, first=100)
        done = harness("compare", mine, truth, "--tolerance", 0.02, "--json")
        assert (done.json["verdict"]["outcome"], done.status, done.err) == (outcome, status, "")
        assert done.json["sides"]["test"]["runs"] == 12
        assert done.json["sides"]["test"]["samples"] == 12 * 64
        assert done.json["smallest_detectable"]["mean"] == pytest.approx(0.02, abs=0.01)

    def test_are_told_with_what_was_sure_to_show(self, harness: Harness) -> None:
        done = harness("compare", self.runs("mine", 4), self.runs("truth", 4, first=100))
        assert done.out.splitlines()[-1].startswith("smallest bias sure to fail: ")
        assert done.out.splitlines()[-1].endswith("; from 4 runs against 4 runs")

    def test_weigh_by_their_samples_where_all_files_say_them(self, harness: Harness) -> None:
        noise = colours()
        foreign("mine_0.exr", {"RGB": 1.5 + noise}, spp=30)
        foreign("mine_1.exr", {"RGB": 3.5 - 3 * noise}, spp=10)
        done = harness("compare", "mine_*.exr", foreign("truth.exr", {"RGB": np.ones((*SHAPE, 3), "f4")}), "--json")
        assert done.json["rmse"] == pytest.approx(1.0)

    def test_of_a_folder(self, harness: Harness) -> None:
        self.runs("mine", 3)
        Path("folder").mkdir()
        for file in Path().glob("mine_*.exr"):
            file.rename(Path("folder") / file.name)
        done = harness("compare", "folder", self.runs("truth", 2, first=100), "--json")
        assert done.json["sides"]["test"]["runs"] == 3

    def test_of_ours_keep_the_variance_of_each(self, harness: Harness) -> None:
        ours("a_0.exr", replica=1), ours("a_1.exr", replica=2)
        done = harness("compare", "a_*.exr", ours("truth.exr"), "--tolerance", "0.01", "--json")
        assert done.json["verdict"]["outcome"] == "pass"
        assert done.json["sides"]["test"]["samples"] == 2 * 4096

    def test_of_one_seed_are_refused(self, harness: Harness) -> None:
        self.runs("mine", 3), self.runs("truth", 2, first=100)
        Path("mine_7.exr").write_bytes(Path("mine_1.exr").read_bytes())
        assert refusal(harness("compare", "mine_*.exr", "truth_*.exr")).startswith(
            "mine_1.exr and mine_7.exr hold the same pixels")

    def test_that_share_their_noise_are_refused(self, harness: Harness) -> None:
        self.runs("mine", 8), self.runs("truth", 2, first=100)
        twice = render_estimate(NoiseRenderer(size=SHAPE), 64, replica=2).mean * 1.001
        foreign("mine_9.exr", {"RGB": twice.astype(np.float32)})
        assert refusal(harness("compare", "mine_*.exr", "truth_*.exr")).startswith(
            "mine_2.exr and mine_9.exr share most of their noise")

    def test_that_are_a_copy_at_another_exposure_are_refused_of_two(self, harness: Harness) -> None:
        self.runs("mine", 1), self.runs("truth", 2, first=100)
        foreign("mine_1.exr", {"RGB": 2 * render_estimate(NoiseRenderer(size=SHAPE), 64).mean.astype(np.float32)})
        assert refusal(harness("compare", "mine_*.exr", "truth_*.exr")).startswith(
            "mine_0.exr and mine_1.exr hold the same pixels but for a factor")

    def test_on_both_sides_are_refused(self, harness: Harness) -> None:
        self.runs("mine", 3)
        assert "one on either side: a run may not be its own reference" in refusal(
            harness("compare", "mine_*.exr", "mine_[01].exr"))

    def test_one_file_given_twice_is_refused(self, harness: Harness) -> None:
        self.runs("mine", 2)
        Path("mine_2.exr").symlink_to("mine_0.exr")
        assert "mine_2.exr is given twice, also as " in refusal(harness("compare", "mine_*.exr", "mine_0.exr"))

    def test_of_two_sizes_name_the_odd_one(self, harness: Harness) -> None:
        self.runs("mine", 3)
        foreign("mine_1.exr", {"RGB": np.ones((20, 20, 3), "f4")})
        assert refusal(harness("compare", "mine_*.exr", "mine_0.exr")) == (
            "mine_1.exr is 20 x 20, mine_0.exr is 24 x 16; render all at the same size")

    def test_half_of_them_unreadable_are_counted(self, harness: Harness) -> None:
        self.runs("mine", 4)
        for k in (1, 3):
            Path(f"mine_{k}.exr").write_bytes(b"")
        assert refusal(harness("compare", "mine_*.exr", "mine_0.exr")) == (
            "2 of 4 images cannot be read, first of all mine_1.exr: an empty file; render it again")

    def test_with_a_nan_pixel_name_the_file_and_fail(self, harness: Harness) -> None:
        self.runs("mine", 3), self.runs("truth", 2, first=100)
        broken = colours()
        broken[3, 4, 1] = np.nan
        foreign("mine_2.exr", {"RGB": broken})
        done = harness("compare", "mine_*.exr", "truth_*.exr")
        assert done.status == 1
        assert "warning: mine_2.exr: pixels that are not finite: 1" in done.err
        assert "verdict: fail: the test image holds pixels that are not finite" in done.out

    def test_of_png_say_once_what_clipping_hides(self, harness: Harness) -> None:
        for k in range(3):
            pixels = np.random.default_rng(k).integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(f"mine_{k}.png")
        done = harness("compare", "mine_*.png", foreign("truth.exr"))
        assert done.err.startswith("note: mine_0.png (and 2 more): PNG is taken as sRGB of 8 bits: ")
        assert done.err.count("\n") == 1


PROGRAM = """import sys, time
import numpy as np
scene, spp, seed, out, behaviour = sys.argv[1:]
if behaviour == "hangs":
    time.sleep(60)
if behaviour == "fails":
    sys.exit("no such light\\n")
shape = (10, 10, 3) if behaviour == "another size" else (12, 16, 3)
rng = np.random.default_rng(1 if behaviour == "ignores its seed" else int(seed))
image = np.array([0.5, 0.25, 1.0]) * (1.1 if behaviour == "biased" else 1.0) + 0.01 * rng.standard_normal(shape)
if behaviour != "writes nothing":
    open(out, "wb").write(b"PF\\n%d %d\\n-1\\n" % (shape[1], shape[0]) + image[::-1].astype("<f4").tobytes())
"""


class TestCommand:
    """A program that renders the scene."""

    @staticmethod
    def template(behaviour: str) -> str:
        Path("program.py").write_text(PROGRAM.replace("\\\\n", "\\n"))
        return f"{sys.executable} program.py {{scene}} {{spp}} {{seed}} {{out}} '{behaviour}'"

    @pytest.mark.parametrize(("behaviour", "outcome", "status"), [("is right", "pass", 0), ("biased", "fail", 1)])
    def test_is_held_against_mitsubas_own_image(
        self, harness: Harness, sky: Path, behaviour: str, outcome: str, status: int,
    ) -> None:
        done = harness("compare", "--command", self.template(behaviour), "--scene", sky, "--spp", 4, "--replicas", 4,
                       "--tolerance", 0.02, "--json")
        assert (done.json["verdict"]["outcome"], done.status) == (outcome, status)
        assert done.json["sides"]["test"]["runs"] == 4

    def test_is_held_against_files(self, harness: Harness, sky: Path) -> None:
        truth = np.broadcast_to(np.array([0.5, 0.25, 1], "f4"), (12, 16, 3)).copy()
        write_estimate("truth.exr", Estimate.exact(truth))
        done = harness("compare", "truth.exr", "--command", self.template("is right"), "--scene", sky, "--replicas", 4,
                       "--tolerance", 0.02, "--json")
        assert done.json["verdict"]["outcome"] == "pass"

    @pytest.mark.parametrize(("behaviour", "complaint"), [
        ("hangs", "took longer than 0.5 s"), ("fails", "no such light"), ("writes nothing", "wrote no file"),
        ("another size", "10 x 10 pixels"), ("ignores its seed", "same image for seeds 1 and 2"),
    ])
    def test_that_misbehaves_is_one_line(self, harness: Harness, sky: Path, behaviour: str, complaint: str) -> None:
        limit = 0.5 if behaviour == "hangs" else 60
        done = harness("compare", "--command", self.template(behaviour), "--scene", sky, "--timeout", limit)
        assert complaint in refusal(done)

    def test_without_its_scene_is_refused(self, harness: Harness) -> None:
        assert refusal(harness("compare", "--command", "x {seed} {out}")).startswith("--command needs the scene")
        assert refusal(harness("compare", "a.exr", "b.exr", "--scene", "x.xml")).startswith(
            "--scene, --set, --size and --max-depth belong to --command")
        assert refusal(harness("compare", "a.exr", "b.exr", "--max-depth", 2)).startswith("--scene, --set, --size and")

    def test_is_told_the_depth(self, harness: Harness, sky: Path) -> None:
        """Or the depth is refused: the two sides would not be of one scene."""
        line = self.template("is right")
        done = harness("compare", "--command", line, "--scene", sky, "--max-depth", 1)
        assert "max_depth does not reach it; pass {max_depth} on to the program" in refusal(done)
