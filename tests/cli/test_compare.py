"""`harness compare`: metrics for any two images, a verdict where both know their variance, a status that says which."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

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
        assert [line.partition(": ")[0] for line in lines[-3:]] == ["verdict", "tiles of 4 px", "tiles of 1 px"]
        assert all(": pass: " in line for line in lines[-3:])
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
        fine = done.out.splitlines()[-1]
        assert fine.startswith("tiles of 1 px: inconclusive: ")
        assert re.search(r"; draw more samples, about \d\.\d times as many$", fine)

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
        assert done.out.splitlines()[-1].startswith("no verdict: theirs.exr without variance")
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
        (b"", "not an OpenEXR file"),
        (struct.pack("<I", 20000630), "truncated or damaged EXR file"),
        (b"\x89PNG\r\n\x1a\n", "not an OpenEXR file"),
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

    def test_a_png(self, harness: Harness) -> None:
        Image.new("RGB", (24, 16)).save("x.png")
        assert refusal(harness("compare", "x.png", ours("truth.exr"))).startswith("x.png: not an OpenEXR file")

    def test_a_folder_or_a_device(self, harness: Harness) -> None:
        """A device is not read, for it may never end."""
        Path("folder.exr").mkdir()
        assert "cannot be read (Is a directory)" in refusal(harness("compare", "folder.exr", "x.exr"))
        assert refusal(harness("compare", "/dev/zero", "x.exr")).startswith("/dev/zero: not a regular file")

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
