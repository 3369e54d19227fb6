"""What a diagnosis found, as plain values, and its sentences."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from harness.diagnosis.causes.bounces import Factors
from harness.diagnosis.causes.where import Place, told

Outcome = Literal["right", "cause", "several", "near", "unknown"]


@dataclass(frozen=True)
class Cause:
    """One explanation of an image: a slip of ours' making (`kind` 'defect'), something that was done to a right image
    ('transform'), or factors of bounces ('bounces').

    `id`: of the defect, empty for others. `says` goes on after "ours with" or "right but for"; `family`, `formula`:
    what may be given away besides, the topic and how it should be. `chi2`: see `match.Fit`; `same`: its picture is not
    excluded. `behind`: the log-likelihood that it lacks of the best one's. `alike`: the ids of defects whose pictures
    cannot be told from this one on this scene.
    """

    kind: Literal["defect", "transform", "bounces"]
    id: str
    says: str
    family: str
    formula: str
    chi2: float
    same: bool
    behind: float
    alike: tuple[str, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """Why an image is not the reference.

    `outcome`: 'right', the reference is not excluded; 'cause', one picture fits and no other; 'several', as many fit as
    `causes` has marked `same`; 'near', none fits, but one is much nearer than the right picture; 'unknown', none of the
    known causes. `causes`: the likeliest first, three at most. `right`: the chi2 of the reference. `factors` of bounces
    and `places` where they were asked for; `tried`: how many pictures the image was held against.
    """

    outcome: Outcome
    causes: tuple[Cause, ...]
    right: float
    tried: int
    factors: Factors | None = None
    places: tuple[Place, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The finding in one sentence."""
        if self.outcome == "right":
            return f"the right picture (χ²/dof {self.right:.2f}): nothing to explain"
        if self.outcome == "unknown" or not self.causes:
            return (f"none of the known causes: of {self.tried} pictures none fits (the right one has χ²/dof "
                    f"{self.right:.2f})")
        best = self.causes[0]
        if self.outcome == "near":
            return (f"none of the known causes alone; nearest is {_picture(best)} (χ²/dof {best.chi2:.2f}, the right "
                    f"picture {self.right:.2f})")
        fitting = [cause for cause in self.causes if cause.same]
        if self.outcome == "several":
            said = ", or ".join(_picture(cause) for cause in fitting)
            return (f"{said}: which of them cannot be told here (χ²/dof {best.chi2:.2f}; the right picture is "
                    "excluded)")
        others = [cause.chi2 for cause in self.causes[1:]]
        after = f"; the next cause {others[0]:.2g}" if others else ""
        return f"{_picture(best)} (χ²/dof {best.chi2:.2f}; the right picture is excluded{after})"

    @property
    def sentences(self) -> tuple[str, ...]:
        """The finding, the factors of bounces, the places, and what else is to be said."""
        lines = [self.sentence]
        if self.factors is not None:
            lines.append(_bounces(self.factors))
        if self.places and (where := told(self.places)):
            lines.append(where)
        return (*lines, *self.notes)

    def as_json(self) -> dict[str, Any]:
        """Plain values, NaN as None."""
        content = {"outcome": self.outcome, "sentence": self.sentence, "sentences": list(self.sentences),
                   "right_chi2": self.right, "pictures": self.tried,
                   "causes": [dataclasses.asdict(cause) for cause in self.causes],
                   "factors": dataclasses.asdict(dataclasses.replace(self.factors, picture=None))
                   if self.factors else None,
                   "places": [dataclasses.asdict(place) | {"wrong": place.wrong} for place in self.places]}
        return {key: _plain(value) for key, value in content.items()}


def _picture(cause: Cause) -> str:
    if cause.kind == "transform":
        return f"the picture is right but for {cause.says}"
    return f"the same picture as ours with {cause.says}"


def _bounces(factors: Factors) -> str:
    shown = ", ".join("–" if math.isnan(value) else f"{value:.3g}" for value in factors.values[:-1])
    if factors.says:
        return f"factors of bounces {shown} (χ²/dof {factors.fit.chi2:.2f}): {factors.says}"
    verdict = "fits" if factors.fit.same else "no factors of bounces explain it, so the defect depends on directions"
    return f"factors of bounces {shown} (χ²/dof {factors.fit.chi2:.2f}): {verdict}"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
