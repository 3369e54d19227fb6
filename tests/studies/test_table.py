"""A study as a tidy table: every number once, beside what it depends on, and CSV that reads back."""

from __future__ import annotations

import csv
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from harness.errors import StoreError
from harness.results import Record, StudyResult
from harness.stats.channels import CHANNELS
from harness.studies.table import records, write_csv

NAMES = [field.name for field in fields(Record)]


def written(rows: list[Record], folder: Path) -> list[dict[str, str]]:
    write_csv(rows, folder / "table.csv")
    with (folder / "table.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        found = list(reader)
    assert reader.fieldnames == NAMES
    return found


class TestRecords:
    """One a number."""

    def test_hold_every_point_of_every_curve(self, study: StudyResult) -> None:
        mixture = study.strategies[-1]
        for name, curve in mixture.curves.items():
            found = [row for row in records(study)
                     if (row.estimator, row.quantity) == ("mixture", name) and row.replica is not None]
            assert [(row.replica, row.samples, row.value) for row in found] == [
                (replica, samples, value) for replica in range(3)
                for samples, value in zip(mixture.spp, curve[replica], strict=True)]
            assert {row.n for row in found} == {1}
            assert {row.channel for row in found} == {"luminance" if name == "mean_error" else ""}

    def test_hold_the_verdict_of_each_channel_with_its_interval(self, study: StudyResult) -> None:
        uniform = study.strategies[0]
        found = [row for row in records(study) if row.estimator == "uniform" and row.quantity == "mean_error"
                 and row.replica is None]
        assert [row.channel for row in found] == list(CHANNELS)
        np.testing.assert_array_equal([(row.value, row.low, row.high) for row in found], np.transpose(
            (uniform.verdict.error, uniform.verdict.low, uniform.verdict.high)))
        assert {(row.samples, row.n) for row in found} == {(uniform.estimate.samples, 3)}

    def test_hold_metrics_slope_and_cost_of_all_replicas_together(self, study: StudyResult) -> None:
        cosine = study.strategies[1]
        found = {row.quantity: row for row in records(study) if row.estimator == "cosine" and row.replica is None
                 and not row.channel}
        assert {name: row.value for name, row in found.items()} == {
            **cosine.scores, "slope": cosine.slope.slope if cosine.slope else None,
            "seconds_per_spp": 0.011, "rejected": 0.0}
        slope = found["slope"]
        assert slope.low is not None and slope.high is not None and slope.low < slope.value < slope.high
        assert slope.samples == 64 and found["flip"].low is None

    def test_name_scene_strategy_and_device(self, study: StudyResult, exact: StudyResult) -> None:
        rows = [*records(study), *records(exact)]
        assert {row.scene for row in rows} == {"spheres", "furnace_convex"}
        assert {row.estimator for row in rows} == {"uniform", "cosine", "phong", "lobes", "mixture"}
        assert {row.device for row in rows} == {"llvmpipe (LLVM 15.0.6, 256 bits)"}

    def test_are_what_a_result_is_a_view_of(self, study: StudyResult) -> None:
        """Another number in a row is another point of the curve; whatever order the rows come in."""
        first = study.strategies[0]
        row = next(row for row in first.measured if (row.replica, row.samples, row.quantity) == (1, 4, "rmse"))
        others = [replace(row, value=7.0) if each is row else each for each in reversed(first.measured)]
        found = replace(first, measured=tuple(others)).curves["rmse"]
        assert found[1, 2] == 7.0
        assert (found != first.curves["rmse"]).sum() == 1

    def test_of_a_strategy_without_noise_have_no_slope(self, exact: StudyResult) -> None:
        assert [row.estimator for row in records(exact) if row.quantity == "slope"] == ["uniform"]

    def test_are_one_a_place_of_the_table(self, study: StudyResult) -> None:
        """No two rows differ in their number alone: whoever pivots the table loses nothing."""
        keys = [(row.estimator, row.replica, row.samples, row.quantity, row.channel) for row in records(study)]
        assert len(set(keys)) == len(keys) > 100


class TestCsv:
    """For spreadsheets and data frames."""

    def test_reads_back_with_all_digits(self, study: StudyResult, tmp_path: Path) -> None:
        rows = list(records(study))
        found = written(rows, tmp_path)
        assert [float(each["value"]) for each in found] == [row.value for row in rows]
        assert [float(each["low"]) if each["low"] else None for each in found] == [row.low for row in rows]
        assert [each["replica"] for each in found] == ["" if row.replica is None else str(row.replica) for row in rows]

    def test_quotes_what_holds_commas_and_joins_parameters(self, study: StudyResult, tmp_path: Path) -> None:
        row = replace(next(records(study)), scene='a, "b"', parameters=(("alpha", "10"), ("kd", "0.5")))
        found, = written([row], tmp_path)
        assert (found["scene"], found["parameters"]) == ('a, "b"', "alpha=10 kd=0.5")
        assert found["device"] == "llvmpipe (LLVM 15.0.6, 256 bits)"

    def test_keeps_numbers_that_are_not_finite(self, study: StudyResult, tmp_path: Path) -> None:
        first = next(records(study))
        found = written([replace(first, value=float("nan"), high=float("inf"))], tmp_path)
        assert (found[0]["value"], found[0]["low"], found[0]["high"]) == ("nan", "", "inf")

    def test_that_cannot_be_written_is_refused(self, study: StudyResult, tmp_path: Path) -> None:
        (tmp_path / "table.csv").mkdir()
        with pytest.raises(StoreError, match=r"table\.csv"):
            write_csv(records(study), tmp_path / "table.csv")
