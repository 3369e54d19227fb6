"""What gates leave behind: files that open, numbers that are the result's, a page that shows all of it."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
import shutil
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np
import pytest
from PIL import Image

from harness.errors import HarnessError
from harness.gates import Gate, GateResult, load_gates, run_gate
from harness.gates.artefacts import IMAGES, RESULT_FILE, command, error_record, record, save_result
from harness.gates.left import PICTURES
from harness.gates.records import as_json, from_json
from harness.gates.summary import counted, write_summary
from harness.results import GateRecord
from harness.samples.exr import read_estimate
from harness.stats.bias import percent
from tests.support.gates import Noise, judging, one_gate


@pytest.fixture(scope="module")
def gate(tmp_path_factory: pytest.TempPathFactory) -> Gate:
    return one_gate(tmp_path_factory.mktemp("gate"))


@pytest.fixture(scope="module")
def failed(gate: Gate) -> GateResult:
    return run_gate(judging(gate, Noise(0.01)))


@pytest.fixture(scope="module")
def passed(gate: Gate) -> GateResult:
    return run_gate(judging(dataclasses.replace(gate, name="right"), Noise()))


@pytest.fixture(scope="module")
def folder(failed: GateResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "sky"
    save_result(failed, folder)
    return folder


class TestFiles:
    """The folder of a gate."""

    def test_are_all_there(self, folder: Path) -> None:
        assert {path.name for path in folder.iterdir()} == {*IMAGES, *PICTURES, RESULT_FILE}

    def test_images_are_the_estimates(self, folder: Path, failed: GateResult) -> None:
        for name, estimate in (("test", failed.test), ("reference", failed.reference)):
            read, facts = read_estimate(folder / f"{name}.exr")
            np.testing.assert_allclose(read.mean, estimate.mean, rtol=1e-6)
            assert facts["gate"] == "sky"
            assert Image.open(folder / f"{name}.png").size == (40, 40)

    @pytest.mark.parametrize("name", ["z-map.png", "difference.png"])
    def test_maps_show_that_all_is_too_bright(self, folder: Path, name: str) -> None:
        """+1 % everywhere: the diverging map's red outweighs its blue."""
        pixels = np.asarray(Image.open(folder / name).convert("RGB"), dtype=float)
        middle = pixels[pixels.shape[0] // 4:-pixels.shape[0] // 4, pixels.shape[1] // 4:pixels.shape[1] // 2]
        assert middle[..., 0].mean() > middle[..., 2].mean() + 20

    def test_the_curve_needs_no_fonts(self, folder: Path) -> None:
        text = (folder / "curve.svg").read_text(encoding="utf-8")
        assert text.lstrip().startswith("<?xml")
        assert "<text" not in text

    def test_numbers_are_the_results(self, folder: Path, failed: GateResult) -> None:
        numbers = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        assert from_json(numbers) == record(failed)
        assert (numbers["outcome"], numbers["samples"], numbers["budget"]) == ("fail", 16, 64)
        assert numbers["error"] == pytest.approx([0.01] * 4, rel=0.05)
        told = record(failed).numbers
        assert told is not None and told.luminance == failed.verdict.luminance == (
            numbers["error"][3], numbers["low"][3], numbers["high"][3])
        assert numbers["tests"]["mean"]["outcome"] == "fail"
        assert [look["samples"] for look in numbers["looks"]] == [16]
        assert numbers["curve"][0]["low"] is None

    def test_hold_what_they_held_in_the_order_in_which_they_held_it(self, failed: GateResult) -> None:
        """Other programs read them."""
        numbers = as_json(record(failed))
        assert list(numbers) == [
            "gate", "outcome", "reason", "why", "scene", "strategy", "origin", "command", "error", "low", "high",
            "confidence", "tests", "looks", "curve", "samples", "budget", "not_finite", "fail_level", "seconds"]
        assert list(numbers["tests"]["mean"]) == ["outcome", "reason", "tolerance", "tile", "p", "largest_error",
                                                  "smallest_detectable"]
        assert list(numbers["looks"][0]) == ["samples", "reference_samples", "outcome", "reason", "error", "low",
                                             "high"]
        assert list(numbers["curve"][0]) == ["samples", "error", "low", "high", "tile_rmse"]
        assert as_json(GateRecord("odd", "error", "why")) == {"gate": "odd", "outcome": "error", "reason": "why"}

    def test_of_an_earlier_run_are_removed(self, tmp_path: Path, folder: Path, passed: GateResult) -> None:
        shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
        (tmp_path / "mine.txt").touch()
        save_result(passed, tmp_path, pictures=False)
        assert {path.name for path in tmp_path.iterdir()} == {RESULT_FILE, "mine.txt"}

    def test_of_pixels_that_are_not_finite_are_drawn(self, tmp_path: Path, failed: GateResult) -> None:
        mean = failed.test.mean.copy()
        mean[3, 4] = np.nan
        save_result(dataclasses.replace(failed, test=dataclasses.replace(failed.test, mean=mean)), tmp_path)
        assert (tmp_path / "difference.png").stat().st_size > 1000


class TestCommand:
    """The line that runs a gate again."""

    def test_names_file_and_gate(self, gate: Gate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.chdir(Path(gate.origin.rpartition(":")[0]).parent)
        assert command(gate) == "harness gate gates.toml --only sky"
        monkeypatch.chdir(tmp_path)
        words = shlex.split(command(gate))
        assert [item.name for item in load_gates(words[2]).select([words[4]])] == ["sky"]


class TestSummary:
    """The page and the JSON file of a run."""

    def test_shows_every_gate_and_the_failed_ones_first(
        self, failed: GateResult, passed: GateResult, folder: Path,
    ) -> None:
        error = GateRecord("odd", "error", "gates.toml:3: no <sky> file")
        page, numbers = write_summary([record(passed), error, record(failed)], folder.parent)
        text = page.read_text(encoding="utf-8")
        assert "1 fail, 1 error, 1 pass" in text
        rows = re.findall(r"<tr><td>(?:<a[^>]*>)?([a-z]+)(?:</a>)?</td><td class=\"([a-z]+)\">\2", text)
        assert rows[:3] == [("sky", "fail"), ("odd", "error"), ("right", "pass")]
        assert "no &lt;sky&gt; file" in text
        assert "<sky>" not in text
        assert "Nothing can go wrong." in text
        assert "--only sky" in text
        assert "None" not in text
        assert [item["gate"] for item in json.loads(numbers.read_text(encoding="utf-8"))["gates"]] == [
            "sky", "odd", "right"]

    def test_its_pictures_exist(self, failed: GateResult, folder: Path) -> None:
        page, = write_summary([record(failed)], folder.parent, ["html"])
        shown = re.findall(r'src="([^"]+)"', page.read_text(encoding="utf-8"))
        assert shown == [f"sky/{name}" for name in PICTURES]
        assert all((folder.parent / name).is_file() for name in shown)

    def test_takes_folders_of_any_name(self, failed: GateResult, folder: Path, tmp_path: Path) -> None:
        """Several gates files: each gate's folder lies below one of its file's name."""
        label = "bär ne/gates.toml/sky"
        shutil.copytree(folder, tmp_path / label)
        page, = write_summary([dataclasses.replace(record(failed), gate=label)], tmp_path, ["html"])
        text = page.read_text(encoding="utf-8")
        shown = re.findall(r'src="([^"]+)"', text)
        assert len(shown) == len(PICTURES)
        assert all((tmp_path / unquote(name)).is_file() and " " not in name for name in shown)
        assert f'id="{label}"' in text and f'href="#{quote(label)}"' in text

    def test_of_an_error_shows_reason_and_command(self, gate: Gate, tmp_path: Path) -> None:
        told = error_record(gate, HarnessError("own.frag:2: odd"))
        text = write_summary([told], tmp_path, ["html"])[0].read_text(encoding="utf-8")
        assert "own.frag:2: odd" in text and "--only sky" in text and "<img" not in text

    def test_leaves_no_page_of_an_earlier_run(self, passed: GateResult, tmp_path: Path) -> None:
        write_summary([record(passed)], tmp_path)
        write_summary([record(passed)], tmp_path, ["json"])
        assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]
        write_summary([record(passed)], tmp_path, [])
        assert not list(tmp_path.iterdir())

    def test_counts_in_words(self) -> None:
        assert counted([GateRecord("x", outcome, "") for outcome in ("pass", "fail", "pass")]) == "1 fail, 2 pass"
        assert counted([]) == "none"

    @pytest.mark.parametrize(("value", "signed", "text"), [
        (0.00123, True, "+0.123 %"), (-0.00123, False, "-0.123 %"), (None, True, "∞"),
        (float("nan"), True, "∞")])
    def test_of_a_share(self, value: float | None, signed: bool, text: str) -> None:
        assert percent(value, signed=signed) == text
