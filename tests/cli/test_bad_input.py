"""Bad input to any command: one line that names it, exit status 2, nothing rendered and nothing left behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cli import main
from harness.cli.options import MAX_EXPOSURE, MAX_SPP
from harness.errors import SceneError
from harness.reference.renderer import START_BITS
from harness.scene import load_scene, sensors
from tests.cli.conftest import SKY, Harness, refusal

pytestmark = pytest.mark.usefixtures("no_renderer")

LAMP = '<shape type="sphere"><emitter type="area"><rgb name="radiance" value="1, 1, 1"/></emitter></shape>'
RENDERING = ("render", "reference", "study", "report")  # the commands that take scenes


class TestScenes:
    """A scene that cannot be rendered."""

    @pytest.mark.parametrize("command", RENDERING)
    @pytest.mark.parametrize(("content", "complaint"), [
        (None, "bad.xml: no such scene file"),
        (b"", "bad.xml:1: No document element found"),
        (b"\x89<\0\xff\x80\n" * 100, "bad.xml:1: Could not determine tag type"),
        (b"a letter to the editor", "bad.xml:1: No document element found"),
        (b'<scene version="3.0.0">\n<shape type="sphere">', "bad.xml:2: Start-end tags mismatch"),
        (b'<scene version="3.0.0">\n</scene>', "bad.xml:1: the scene has no <sensor>"),
    ])
    def test_is_refused_with_file_and_line(
        self, harness: Harness, here: Path, command: str, content: bytes | None, complaint: str,
    ) -> None:
        if content is not None:
            Path("bad.xml").write_bytes(content)
        assert refusal(harness(command, "bad.xml")).startswith(complaint)
        assert {path.name for path in here.iterdir()} <= {"bad.xml"}

    @pytest.mark.parametrize("command", ["render", "study", "report"])
    def test_outside_our_subset_is_refused_where_our_tracer_renders(self, harness: Harness, command: str) -> None:
        """Mitsuba alone, which `reference` asks, may know the shape."""
        Path("bad.xml").write_text('<scene version="3.0.0">\n<shape type="cone"/></scene>')
        assert refusal(harness(command, "bad.xml")).startswith("bad.xml:2: shape 'cone' is not supported")

    @pytest.mark.parametrize("command", RENDERING)
    def test_that_is_a_folder_is_called_one(self, harness: Harness, command: str) -> None:
        Path("folder.xml").mkdir()
        assert refusal(harness(command, "folder.xml")).startswith("folder.xml: a folder, not a scene file")

    def test_with_a_name_that_is_no_text_is_refused(self) -> None:
        Path("n\udcff.xml").write_text(SKY)
        with pytest.raises(SceneError, match="the path must be UTF-8 text; rename the file or its folder"):
            load_scene("n\udcff.xml")

    def test_with_a_name_of_two_lines_is_refused_in_one(self, harness: Harness) -> None:
        assert refusal(harness("render", "a\nb.xml")).startswith("a b.xml: no such scene file")

    @pytest.mark.parametrize("strategy", ["nee", "mis"])
    def test_with_more_lights_than_are_sampled_is_refused(
        self, harness: Harness, monkeypatch: pytest.MonkeyPatch, strategy: str,
    ) -> None:
        monkeypatch.setattr("harness.scene.lights.MOST_LIGHTS", 2)
        Path("many.xml").write_text(SKY.replace("</scene>", 3 * LAMP + "</scene>"))
        assert refusal(harness("render", "many.xml", "--strategy", strategy)) == (
            "scene 'many' has 3 lights; strategies that sample them take 2 at most: use mixture, or join lights into "
            "fewer shapes")

    @pytest.mark.parametrize("exposure", ["1e30", "-65"])
    def test_shown_brighter_or_darker_than_numbers_reach_is_refused(self, harness: Harness, exposure: str) -> None:
        Path("bright.xml").write_text(SKY.replace('value="-1"', f'value="{exposure}"'))
        assert "bright.xml:5: 'exposure' must lie between -64 and 64 stops" in refusal(harness("render", "bright.xml"))

    def test_last_of_a_report_is_refused_before_the_first_is_rendered(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("report", sky, "typo.xml")).startswith("typo.xml: no such scene file")

    def test_two_of_one_name_are_refused_in_a_report(self, harness: Harness, sky: Path) -> None:
        Path("sky.xml").write_text(SKY)
        assert "sky.xml: a scene called 'sky' is in the report already" in refusal(harness("report", sky, "sky.xml"))

    @pytest.mark.parametrize("command", ["study", "report"])
    def test_too_small_for_the_metrics_are_refused(self, harness: Harness, sky: Path, command: str) -> None:
        Path("tiny.xml").write_text(SKY.replace('value="12"', 'value="8"'))
        before = [sky] if command == "report" else []
        assert refusal(harness(command, *before, "tiny.xml")) == (
            "SSIM needs images of at least 11 x 11 pixels, found 16 x 8; render a larger image")

    @pytest.mark.parametrize("command", ["render", "reference", "study"])
    def test_too_large_for_the_memory_are_refused(
        self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, command: str,
    ) -> None:
        monkeypatch.setattr("harness.machine.doctor.memory_limit", lambda: 2**30)
        assert "an image of 2000 x 1000 pixels takes about 1.1 GiB" in refusal(
            harness(command, sky, "--size", "2000x1000"))


class TestStrategies:
    """Names of sampling strategies."""

    @pytest.mark.parametrize("name", [
        "metropolis", "", "Mixture", "uniform,cosine", "mis-fast", "nee-power", "mis-", "cosine+mis-fast", "foo+nee",
        "mixture+", "+mis", "+", "mixture+met", "nee+mis", "mixture+nee+mis", "mixture-power", "mixture + nee",
    ])
    def test_unknown_to_render_are_refused_with_the_known(self, harness: Harness, sky: Path, name: str) -> None:
        assert refusal(harness("render", sky, "--strategy", name)) == (
            f"unknown strategy '{name}'; choose from uniform, cosine, phong, lobes, mixture, nee, mis, a draw with "
            "+nee or +mis (cosine+mis), or mis-balance, mis-power")

    @pytest.mark.parametrize("name", ["lobes+mis", "lobes+mis-power"])
    def test_without_a_density_to_weigh_by_are_refused_with_the_reason(
        self, harness: Harness, sky: Path, name: str,
    ) -> None:
        assert refusal(harness("render", sky, "--strategy", name)) == (
            f"'{name}': lobes divides each term by its own density and not the direction's, so there is no density to "
            "weigh against the lights'; use mixture+mis, or lobes+nee")

    @pytest.mark.parametrize("names", ["metropolis", "mixture,metropolis", "metropolis , mixture"])
    def test_unknown_to_a_study_are_refused_with_the_known(self, harness: Harness, sky: Path, names: str) -> None:
        assert refusal(harness("study", sky, "--strategies", names)).startswith("unknown strategy 'metropolis'; choose")

    @pytest.mark.parametrize("names", ["", ",", "mixture,", "mixture,,uniform", " "])
    def test_left_empty_are_refused(self, harness: Harness, sky: Path, names: str) -> None:
        assert refusal(harness("study", sky, "--strategies", names)) == (
            f"--strategies: expected names with commas between, such as uniform,mixture; found '{names}'")


class TestNumbers:
    """Counts, sizes and levels; the message shows what was found."""

    @pytest.mark.parametrize("spp", ["-1", "0", "1.5", "1e3", "many", "99999999999", "9" * 5000])
    @pytest.mark.parametrize("command", ["render", "reference", "study"])
    def test_of_samples(self, harness: Harness, sky: Path, command: str, spp: str) -> None:
        message = refusal(harness(command, sky, "--spp", spp))
        assert message.startswith("Invalid value for '--spp': ")
        assert f"found '{spp}'; see `harness {command} --help`" in message

    @pytest.mark.parametrize(("option", "values"), [
        ("--replicas", ["1", "0", "-3", "1001", "2.5"]), ("--reference-spp", ["1", "-5", "few"]),
        ("--tolerance", ["0", "-1", "nan", "inf", "2", "small"]), ("--confidence", ["0", "1", "95", "nan"]),
        ("--spp", ["3", str(MAX_SPP)]),
    ])
    def test_of_a_study(self, harness: Harness, sky: Path, option: str, values: list[str]) -> None:
        for value in values:
            message = refusal(harness("study", sky, option, value))
            assert message.startswith(f"Invalid value for '{option}': ")
            assert f"found '{value}'" in message

    @pytest.mark.parametrize("value", ["nan", "inf", "1e9", "-65", "bright"])
    def test_of_an_exposure(self, harness: Harness, value: str) -> None:
        assert refusal(harness("compare", "a.exr", "b.exr", "--exposure", value)).startswith(
            "Invalid value for '--exposure'")

    @pytest.mark.parametrize("size", ["0x5", "5x0", "5", "5x", "x", "", "-5x5", "1e3x5", "5 x 5", "5x5x5", "٣x3",
                                      "9" * 5000 + "x1"])
    def test_of_pixels(self, harness: Harness, sky: Path, size: str) -> None:
        assert refusal(harness("render", sky, "--size", size)) == (
            f"--size: expected WIDTHxHEIGHT with both at least 1, such as 640x480; found '{size}'")

    @pytest.mark.parametrize("size", ["99999x99999", "16385x1", "1x999999999"])
    def test_of_more_pixels_than_a_film_has(self, harness: Harness, sky: Path, size: str) -> None:
        assert "film size must be between 1 and 16384 pixels a side" in refusal(harness("render", sky, "--size", size))

    @pytest.mark.parametrize("rounds", ["1", "0", "lots"])
    def test_of_rounds(self, harness: Harness, rounds: str) -> None:
        assert f"found '{rounds}'" in refusal(harness("bench", "--rounds", rounds))

    @pytest.mark.parametrize("replica", ["-1", "99999999999", "first"])
    def test_of_replicas(self, harness: Harness, sky: Path, replica: str) -> None:
        assert f"found '{replica}'" in refusal(harness("render", sky, "--replica", replica))

    def test_of_a_profile_that_is_none(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("report", sky, "--profile", "slow")) == (
            "Invalid value for '--profile': 'slow' is not one of 'quick', 'full'; see `harness report --help`")

    def test_have_the_limits_of_what_they_are_passed_to(self) -> None:
        """The options' module must import fast, so it repeats limits of modules that do not."""
        assert MAX_SPP == 1 << START_BITS
        assert MAX_EXPOSURE == sensors.MAX_EXPOSURE


class TestOutputs:
    """Places that cannot be written are refused before the first sample, and no folder is made for them."""

    @pytest.mark.parametrize(("command", "name"), [
        ("render", "x.exr"), ("reference", "x.png"), ("study", ""), ("report", ""), ("bench", "x.json"),
    ])
    def test_under_a_regular_file(self, harness: Harness, sky: Path, here: Path, command: str, name: str) -> None:
        Path("file").write_text("kept")
        scene = [] if command == "bench" else [sky]
        message = refusal(harness(command, *scene, "-o", Path("file", "folder", name)))
        assert f"cannot be written, {here / 'file'} is not a folder; choose another place" in message
        assert [path.name for path in here.iterdir()] == ["file"]
        assert Path("file").read_text() == "kept"

    @pytest.mark.parametrize(("command", "name"), [("render", "x.exr"), ("reference", "x.png"), ("bench", "x.json")])
    def test_that_are_folders(self, harness: Harness, sky: Path, command: str, name: str) -> None:
        Path(name).mkdir()
        scene = [] if command == "bench" else [sky]
        message = refusal(harness(command, *scene, "-o", name))
        assert message == f"{name}: cannot be written, it is a folder; name a file"

    def test_that_are_devices(self, harness: Harness, sky: Path) -> None:
        """Replacing a device by a file, as an atomic write does, would destroy it."""
        Path("full.exr").symlink_to("/dev/full")
        assert "not a regular file" in refusal(harness("render", sky, "-o", "full.exr"))

    def test_in_a_file_system_that_takes_none(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("render", sky, "-o", "/proc/x.exr")).startswith("/proc/x.exr: cannot be written (")

    @pytest.mark.parametrize("name", ["x.jpg", "x", ".exr", "", "folder/.png", "/dev/null"])
    def test_of_a_format_unknown(self, harness: Harness, sky: Path, name: str) -> None:
        assert "unknown image format" in refusal(harness("render", sky, "-o", name))

    def test_of_a_name_too_long(self, harness: Harness, sky: Path) -> None:
        assert "File name too long" in refusal(harness("render", sky, "-o", "x" * 300 + ".exr"))

    def test_are_not_made_for_a_scene_that_is_refused(self, harness: Harness, here: Path) -> None:
        refusal(harness("render", "typo.xml", "-o", "new/folder/x.exr"))
        refusal(harness("reference", "typo.xml", "-o", "new/folder/x.exr"))
        refusal(harness("report", "typo.xml", "-o", "new/folder"))
        assert list(here.iterdir()) == []


class TestCache:
    """A cache folder that cannot be."""

    @pytest.mark.parametrize("cache", ["file", "file/deeper", "/proc/cache"])
    def test_is_refused_with_the_ways_out(
        self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, cache: str,
    ) -> None:
        Path("file").touch()
        monkeypatch.setenv("HARNESS_CACHE", cache)
        message = refusal(harness("study", sky))
        assert "the cache folder cannot be made (" in message
        assert message.endswith("set HARNESS_CACHE to a folder that you may write, or render with --no-cache")


def test_memory_that_runs_out_is_one_line_and_status_3(
    sky: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    def exhausted(*arguments: object, **options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("harness.scene.load", exhausted)
    assert main(["render", str(sky)]) == 3
    assert capsys.readouterr().err == "harness: error: not enough memory; choose a smaller --size\n"
