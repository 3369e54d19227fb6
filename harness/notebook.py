"""A study over parameters as Python and notebooks have it: run or read back, shown, drawn, and handed on as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from harness.api import scene_file
from harness.estimators.base import Estimator
from harness.files import write_atomically
from harness.metrics import shown_in
from harness.report.figures import product as figures
from harness.report.figures.svg import png, svg
from harness.results import Record, StudyResult
from harness.samples.store import Store
from harness.scene import Scene, SceneFile
from harness.studies.costs import costs_of
from harness.studies.frames import to_pandas, to_xarray
from harness.studies.kept import Kept, load_studies
from harness.studies.parameters import axes_of, combinations
from harness.studies.product import StudyProduct, study_product


@dataclass(frozen=True)
class Chart:
    """A figure that a notebook shows; `figure` draws it anew, for whoever would change it."""

    name: str
    draw: Callable[[], Figure]

    def __repr__(self) -> str:
        return f"Chart('{self.name}')"

    def figure(self) -> Figure:
        """The figure as matplotlib's."""
        return self.draw()

    def save(self, path: str | Path) -> None:
        """Write it as SVG, or as PNG where the suffix says so. StoreError where it cannot be written."""
        whole = png(self.draw) if Path(path).suffix.lower() == ".png" else self._svg()
        with write_atomically(path) as partial:
            partial.write_bytes(whole)

    def _svg(self) -> bytes:
        return svg(self.draw, self.name, letters_as_shapes=True)

    def _repr_svg_(self) -> str:
        return self._svg().decode("utf-8")


@dataclass(frozen=True, eq=False)
class ParameterStudy:
    """Studies of scenes with every combination of parameters. Iterating gives each `StudyResult`, without its images.

    A notebook shows it as a table; charts and tables are made when they are asked for.
    """

    product: StudyProduct

    def __repr__(self) -> str:
        names = [each.scene for each in self]
        return f"ParameterStudy of {', '.join(names[:4])}{f' and {len(names) - 4} more' if len(names) > 4 else ''}"

    def __iter__(self) -> Iterator[StudyResult]:
        return iter(self.product.studies)

    def __len__(self) -> int:
        return len(self.product.studies)

    def records(self) -> tuple[Record, ...]:
        """The whole table, one number a row."""
        return tuple(self.product.records())

    def to_pandas(self) -> Any:
        """The whole table as a pandas.DataFrame; it takes the extra `tables`."""
        return to_pandas(self.records())

    def to_xarray(self) -> Any:
        """The curves as an xarray.Dataset over scene, estimator, parameters, replica and samples; as above."""
        return to_xarray(self.records())

    def error_by_samples(self) -> Chart:
        """RMSE against samples per pixel."""
        return self._chart("error-by-samples", figures.error_by_samples)

    def error_by_time(self) -> Chart:
        """RMSE against seconds by the device's clock."""
        return self._chart("error-by-time", figures.error_by_time)

    def ssim(self) -> Chart:
        """SSIM against samples per pixel."""
        return self._chart("ssim", figures.ssim_by_samples)

    def mean_error(self) -> Chart:
        """Signed error of the mean against samples per pixel."""
        return self._chart("mean-error", figures.mean_error_by_samples)

    def efficiency(self) -> Chart:
        """1 / (variance × time) of each estimator, with its interval."""
        return self._chart("efficiency", figures.efficiency)

    def error_by(self, parameter: str) -> Chart:
        """RMSE against a parameter's value. ValueError unless it has several, all numbers."""
        self._require_numeric(parameter)
        return self._chart(f"error-by-{parameter}", lambda held: figures.error_by_parameter(held, parameter))

    def efficiency_by(self, parameter: str) -> Chart:
        """Efficiency against a parameter's value. ValueError as above."""
        self._require_numeric(parameter)
        return self._chart(f"efficiency-by-{parameter}", lambda held: figures.efficiency_by_parameter(held, parameter))

    def _chart(self, name: str, draw: Callable[[StudyProduct], Figure]) -> Chart:
        return Chart(name, lambda: draw(self.product))

    def _require_numeric(self, parameter: str) -> None:
        if parameter not in figures.numeric(self.product):
            figures.error_by_parameter(self.product, parameter)  # says what is wrong

    def _repr_html_(self) -> str:
        """One row an estimator and combination: verdict, error, cost."""
        names = [name for name, _ in self.product.axes]
        metrics = shown_in("study")
        head = ["scene", *names, "estimator", "verdict", "mean error", *(metric.heading for metric in metrics), "slope",
                "seconds/spp", "variance × time"]
        rows = []
        for study in self.product.studies:
            scene, given = study.cell
            for item, cost in zip(study.strategies, costs_of(study).lines, strict=True):
                error, low, high = item.verdict.luminance
                rows.append([
                    scene, *(dict(given).get(name, "") for name in names), item.strategy,
                    item.outcome if item.suits else "not suited",
                    f"{error:+.2%} [{low:+.2%}, {high:+.2%}]", *(metric.text(item.score(metric.name))
                                                                 for metric in metrics),
                    f"{item.slope.slope:.3f}" if item.slope else "–", f"{item.seconds_per_spp:.3g}",
                    f"{cost.ttuv.value:.3g} [{cost.ttuv.low:.3g}, {cost.ttuv.high:.3g}]" if cost.ttuv else "–"])
        body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in rows)
        return f"<table><thead><tr>{_cells('th', head)}</tr></thead><tbody>{body}</tbody></table>"


def parameter_study(scenes: Scene | SceneFile | str | Path | Iterable[Scene | SceneFile | str | Path],
                    estimators: Sequence[str | Estimator] | None = None, *,
                    parameters: Mapping[str, object] | None = None, output: str | Path | None = None,
                    store: Store | None = None, **options: Any) -> ParameterStudy:
    """A study of every scene with every combination of parameters: `{"alpha": [1, 10, 100]}`.

    `estimators`: strategies of the tracer by name, or any others; all strategies that suit where None. `output`: a
    folder that keeps the studies with their images, and the table as CSV and Parquet; `load_parameter_study` reads it.
    `options`: of `harness.study`. HarnessError as there, SceneError for a parameter that a scene does not declare.
    """
    several = [scenes] if isinstance(scenes, str | Path | Scene | SceneFile) else list(scenes)
    files = [scene_file(scene) for scene in several]
    axes = axes_of(parameters or {})
    kept = Kept(output, product=len(combinations(files, axes, estimators)) > 1) if output is not None else None
    product = study_product(files, estimators, axes=axes, store=store,
                            keep=kept.add if kept else lambda result: None, **options)
    if kept:
        kept.finish(product)
    return ParameterStudy(product)


def load_parameter_study(folder: str | Path) -> ParameterStudy:
    """What `parameter_study` or `harness study -o` left in a folder. StoreError, one line, where it is none."""
    return ParameterStudy(load_studies(folder))


def _cells(tag: str, values: Iterable[str]) -> str:
    return "".join(f"<{tag}>{escape(value)}</{tag}>" for value in values)
