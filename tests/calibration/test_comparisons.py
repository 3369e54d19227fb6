"""The calibration: pairs that are independent and agree, what is kept of it, and the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness import calibration
from harness.calibration import comparisons
from harness.cli import main
from harness.errors import StoreError
from harness.files import data_dir
from harness.gpu.renderer import TracerRenderer
from harness.samples.estimate import Estimate
from harness.scene import load_scene
from harness.stats.calibration import SUBJECTS
from harness.stats.limit import LimitError, limit_error
from harness.work.batches import render_estimate
from tests.support.calibration import calibration as made
from tests.support.gates import write


@pytest.fixture(scope="module")
def measured() -> comparisons.Measured:
    """Three comparisons of one case of each kind, in eight batches."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparisons, "BATCHES", 8)
        patch.setattr(comparisons, "RENDERED", (("spheres", "uniform", "mixture"),))
        patch.setattr(comparisons, "SYNTHETIC", (("normal", "normal"),))
        return comparisons.compare(3)


class TestMeasured:
    """A small calibration, whole."""

    def test_every_case_is_counted_and_the_sum_too(self, measured: comparisons.Measured) -> None:
        _, alarms, _ = measured
        counted = {(each.case, each.subject): each.trials for each in alarms}
        cases = "normal / normal", "spheres: uniform / mixture", "all cases"
        assert set(counted) == {(case, subject) for case in cases for subject in SUBJECTS}
        assert counted["normal / normal", "image"] == counted["spheres: uniform / mixture", "verdict"] == 3
        assert counted["all cases", "image"] == 6

    def test_power_is_measured_on_renders_and_to_a_decision(self, measured: comparisons.Measured) -> None:
        cases, _, powers = measured
        found = {each.case for each in powers}
        assert found == {"spheres: uniform / mixture", "normal / normal, to a decision"}
        assert found <= cases.keys()


def test_renders_of_a_pair_share_no_random_stream_and_are_drawn_once() -> None:
    """Neither with each other nor with the next pair: noise that is shared would make agreement look too good."""
    seen: list[tuple[str, int]] = []

    class Watched(TracerRenderer):
        def render_batch(self, replica: int, start: int, count: int, advance: object = None) -> object:  # type: ignore[override]
            seen.append((self.strategy.name, replica))
            return super().render_batch(replica, start, 1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.estimators.tracer.TracerRenderer", Watched)
        patch.setattr(comparisons, "BATCHES", 3)
        pairs = list(comparisons.rendered_pairs("diffuse", "uniform", "cosine", 2))
    assert len({replica for _, replica in seen}) == len(seen) == 2 * 2 * 3
    (first, _), (second, _) = pairs
    assert not np.array_equal(first.means, second.means)


def test_two_strategies_converge_to_the_same_image_and_not_to_one_beside_it() -> None:
    """A reference shifted by a pixel has the same mean; what the RMSE tends to gives it away."""
    scene = load_scene(data_dir("mitsuba_scenes") / "diffuse.xml", width=48, height=48)
    held = []
    for strategy, replica in (("uniform", 0), ("cosine", 1)):
        renderer = TracerRenderer(scene, strategy)
        held.append(render_estimate(renderer, 1024, replica=replica))
        renderer.release()
    ours, theirs = held

    def limit(reference: Estimate, shift: int) -> LimitError:
        return limit_error(ours.mean, ours.variance, np.roll(reference.mean, shift, axis=1),
                           np.roll(reference.variance, shift, axis=1))

    assert limit(theirs, 0).high <= 0.01
    assert limit(theirs, 1).low > 0.01


def test_it_comes_back_from_its_file(tmp_path: Path) -> None:
    calibration.save(made(), tmp_path / "new" / "calibration.json")
    assert calibration.load(tmp_path / "new" / "calibration.json") == made()


@pytest.mark.parametrize("content", [b"", b"\xff", b"[]", b"{}",
                                     b'{"cases": {}, "alarms": [], "powers": [], "facts": {}}',
                                     b'{"cases": {}, "alarms": [3], "powers": [], "facts": {}}',
                                     b'{"cases": {}, "alarms": [{"case": "a"}], "powers": [], "facts": {}}'])
def test_a_file_that_is_something_else_or_older_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    with pytest.raises(StoreError, match="not a calibration") as caught:
        calibration.load(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


class TestCommand:
    """`harness calibrate`."""

    @pytest.fixture(autouse=True)
    def alarms(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, int]:
        """How many alarms the last rate (of 300) and the suite (of 1,000) shall have; a gates file to work in."""
        alarms = {"excessive": 0, "failed": 2}
        monkeypatch.setattr(calibration, "calibrate", lambda *given, **options: made(**alarms))
        monkeypatch.chdir(tmp_path)
        (tmp_path / "tests").mkdir()
        write(tmp_path / "tests")
        return alarms

    def test_prints_every_rate_and_keeps_the_result(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = tmp_path / "calibration.json"
        assert main(["calibrate", "-o", str(path)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[1].split() == ["normal", "/", "normal", "0.05", *["0.0500"] * 5]
        assert lines[8].split()[-7:] == ["patch", "2.5e-04", "6", "0", "60", "50", "%"]
        assert lines[10].split() == ["sharp", "2", "0", "25", "%", "0.15", "%", "4.5", "%"]
        assert lines[11].split() == ["blind", "0", "10", "75", "%", "0.5", "%", "-"]
        assert lines[12] == ("gates.toml, 1000 simulated runs on good renders: a gate failed in 2, a rate of 0.0002 to "
                             "0.0072, where 0.01 was asked for; some gate did not pass in 12")
        assert len(lines) == 13
        assert calibration.load(path) == made()

    def test_a_rate_above_what_was_asked_for_is_told_and_ends_with_status_1(
        self, alarms: dict[str, int], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        alarms["excessive"] = 30
        assert main(["calibrate", "-o", str(tmp_path / "c.json")]) == 1
        assert "box: a / b, verdict with looks: 30 of 300 alarms, a rate of 0.0685 to 0.1397, where 0.01 was" in (
            capsys.readouterr().out)

    def test_so_does_a_suite_that_alarms_too_often(self, alarms: dict[str, int], tmp_path: Path) -> None:
        alarms["failed"] = 30
        assert main(["calibrate", "-o", str(tmp_path / "c.json")]) == 1

    def test_json_is_one_object(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["calibrate", "-o", str(tmp_path / "c.json"), "--json"]) == 0
        answer = json.loads(capsys.readouterr().out)
        assert answer["alarms"][0] == {"case": "normal / normal", "subject": "image", "level": 0.05, "hits": 15,
                                       "trials": 300, "judgement": "nominal"}
        assert len(answer["powers"]) == len(made().powers)
        assert answer["suite"]["gates"][1]["sure_patch"] is None

    def test_a_gates_file_that_is_not_there_is_refused_first(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        assert main(["calibrate", "--gates", "mine.toml", "-o", str(tmp_path / "c.json")]) == 2
        assert capsys.readouterr().err.startswith("harness: error: mine.toml: the gates file cannot be read")
        assert not (tmp_path / "c.json").exists()
