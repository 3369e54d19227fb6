"""A study as a tidy table: every number once, beside what it depends on, and CSV that reads back."""

from __future__ import annotations

import csv
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from arro3.core import DataType
from arro3.io import read_parquet

from harness.errors import MachineError, StoreError
from harness.results import Record, StudyResult
from harness.stats.channels import CHANNELS
from harness.studies.costs import costs_of
from harness.studies.frames import to_pandas, to_xarray
from harness.studies.table import columns, records, write_csv, write_parquet

NAMES = [field.name for field in fields(Record)]


def written(rows: list[Record], folder: Path) -> list[dict[str, str]]:
    write_csv(rows, folder / "table.csv")
    with (folder / "table.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        found = list(reader)
    assert reader.fieldnames is not None and reader.fieldnames[:len(NAMES)] == NAMES
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
        cosine, costs = study.strategies[1], costs_of(study)
        _, cost, *_ = costs.lines
        assert cost.samples and cost.seconds and cost.ttuv
        found = {row.quantity: row for row in records(study) if row.estimator == "cosine" and row.replica is None
                 and not row.channel}
        assert {name: row.value for name, row in found.items()} == {
            **cosine.scores, "slope": cosine.slope.slope if cosine.slope else None,
            "seconds_per_spp": 0.011, "rejected": 0.0, "rmse_to_reach": costs.rmse,
            "samples_to_rmse": cost.samples.value, "seconds_to_rmse": cost.seconds.value,
            "time_to_unit_variance": cost.ttuv.value}
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
        assert (found["alpha"], found["kd"]) == ("10", "0.5")

    def test_has_a_column_for_a_parameter_that_only_some_have_and_that_is_called_like_a_field(
        self, study: StudyResult, tmp_path: Path,
    ) -> None:
        row = next(records(study))
        found = written([row, replace(row, parameters=(("samples", "4"),))], tmp_path)
        assert [(each["samples"], each["parameter_samples"]) for each in found] == [("1", ""), ("1", "4")]

    def test_keeps_numbers_that_are_not_finite(self, study: StudyResult, tmp_path: Path) -> None:
        first = next(records(study))
        found = written([replace(first, value=float("nan"), high=float("inf"))], tmp_path)
        assert (found[0]["value"], found[0]["low"], found[0]["high"]) == ("nan", "", "inf")

    def test_that_cannot_be_written_is_refused(self, study: StudyResult, tmp_path: Path) -> None:
        (tmp_path / "table.csv").mkdir()
        with pytest.raises(StoreError, match=r"table\.csv"):
            write_csv(records(study), tmp_path / "table.csv")


class TestParquet:
    """The same table with types."""

    def test_reads_back_as_what_was_measured(self, study: StudyResult, tmp_path: Path) -> None:
        rows = [replace(row, parameters=(("alpha", "10"), ("kd", "1 0 0"))) for row in records(study)]
        rows[0] = replace(rows[0], value=float("nan"), high=float("inf"))
        write_parquet(rows, tmp_path / "table.parquet")
        found = read_parquet(str(tmp_path / "table.parquet")).read_all()
        table = columns(rows)
        assert found.column_names == list(table)
        for name in ("scene", "parameters", "replica", "samples", "quantity", "low", "n", "kd"):
            assert [value.as_py() for value in found[name]] == table[name], name
        np.testing.assert_array_equal([value.as_py() for value in found["value"]], table["value"])
        assert {str(found.schema.field(name).type) for name in ("value", "alpha")} == {str(DataType.float64())}
        assert {value.as_py() for value in found["alpha"]} == {10.0}


class TestFrames:
    """For whoever computes with it."""

    def test_of_pandas_hold_a_number_a_row(self, study: StudyResult) -> None:
        rows = [replace(row, parameters=(("alpha", "10"),)) for row in records(study)]
        frame = to_pandas(rows)
        assert len(frame) == len(rows) and frame["alpha"].dtype == "float64"
        curve = frame[(frame["quantity"] == "rmse") & (frame["estimator"] == "uniform") & (frame["replica"] == 1)]
        np.testing.assert_array_equal(curve["value"], study.strategies[0].curves["rmse"][1])

    def test_of_xarray_hold_curves_over_all_that_they_depend_on(self, study: StudyResult) -> None:
        rows = [replace(row, parameters=(("alpha", alpha), ("kd", "1 0 0"))) for alpha in ("1", "10")
                for row in records(study)]
        found = to_xarray(rows)
        assert set(found.data_vars) == {"rmse", "mean_error", "ssim", "seconds_per_spp"}
        assert set(found.dims) == {"scene", "estimator", "alpha", "kd", "replica", "samples"}
        np.testing.assert_array_equal(
            found["rmse"].sel(scene="spheres", estimator="mixture", alpha=10.0, kd="1 0 0"),
            study.strategies[-1].curves["rmse"])

    def test_name_the_extra_where_it_is_not_installed(self, study: StudyResult,
                                                      monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "pandas", None)
        with pytest.raises(MachineError, match=r"pandas is not installed; pip install .*\[tables\]"):
            to_pandas(records(study))
