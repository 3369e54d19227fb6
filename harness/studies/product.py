"""Studies over parameters: every scene with every combination of values, each a study, and one table of all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness import metrics
from harness.estimators.base import Estimator
from harness.results import Record, StudyResult
from harness.samples.estimate import Estimate
from harness.scene import SceneFile
from harness.shader.samplers import DEFAULT
from harness.studies.costs import require_error
from harness.studies.parameters import Axes, combinations
from harness.studies.plan import REFERENCE_FACTOR
from harness.studies.remaining import Schedule
from harness.studies.study import estimators_of, expect, study
from harness.studies.table import records


@dataclass(frozen=True, eq=False)
class StudyProduct:
    """Studies of every scene with every combination of parameters; `axes`: the parameters and their values.

    Images are left out of the studies (arrays of no pixels), so that what is held does not grow with the film: they are
    where the studies were kept.
    """

    axes: Axes
    studies: tuple[StudyResult, ...]

    @property
    def varied(self) -> tuple[str, ...]:
        """Parameters that have several values."""
        return tuple(name for name, values in self.axes if len(values) > 1)

    def records(self) -> Iterator[Record]:
        """The whole table, study by study."""
        for each in self.studies:
            yield from records(each)

    @property
    def good(self) -> bool:
        """Whether every line that suits its scene passes."""
        return all(item.outcome == "pass" for each in self.studies for item in each.strategies if item.suits)


def study_product(scenes: Sequence[SceneFile], strategies: Sequence[str | Estimator] | None = None, *,
                  axes: Axes = (), samplers: Sequence[str] = (DEFAULT,), spp: int = 1024, replicas: int = 8,
                  reference_spp: int | None = None, reference: Estimate | None = None, error: float | None = None,
                  schedule: Schedule | None = None, keep: Callable[[StudyResult], None] = lambda result: None,
                  **options: Any) -> StudyProduct:
    """A study of each combination of scenes and parameters, with the same estimators and settings.

    `keep` is given each study, images and all, as soon as it is there. `options`: of `study`. All verdicts share one
    rate of false alarms. Names, parameters and scenes are looked at before anything is rendered: raises what
    `parameters.combinations`, `study` and the estimators' `check` raise.
    """
    require_error(error)
    files = combinations(scenes, axes, strategies)
    schedule = schedule or Schedule()
    family = 0
    for file in files:
        estimators = estimators_of(file, strategies, samplers)
        family += sum(not estimator.check(file) for estimator in estimators)
        film = file.film
        metrics.require_ssim_size(film.height, film.width)
        expect(schedule, file, film, estimators, spp, replicas,
               0 if reference else reference_spp or REFERENCE_FACTOR * spp)
    held = []
    for file in files:
        result = study(file, strategies, samplers=samplers, spp=spp, replicas=replicas, reference_spp=reference_spp,
                       reference=reference, error=error, family=max(family, 1), schedule=schedule, **options)
        keep(result)
        held.append(without_pixels(result))
    return StudyProduct(axes, tuple(held))


def without_pixels(result: StudyResult) -> StudyResult:
    """The study without its images: estimates keep means and variances of the whole image, counts and cost."""
    return replace(result, reference=_without(result.reference), strategies=tuple(
        replace(item, estimate=_without(item.estimate)) for item in result.strategies))


def _without(estimate: Estimate) -> Estimate:
    none = np.empty((0, 0, 3))
    return replace(estimate, mean=none, variance=none, luminance_variance=np.empty((0, 0)),
                   third=None if estimate.third is None else none)
