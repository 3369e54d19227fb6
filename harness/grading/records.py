"""What is known of a submission once it is judged, and how much of it a student is told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

# How much is told: the verdict alone; where the image is wrong too; of what kind the cause is; the cause itself.
Hints = Literal["none", "place", "family", "formula"]
HINTS: tuple[Hints, ...] = get_args(Hints)
# refused: it does not compile, does not run, or its frames cannot be told apart; `sentence` says which.
Outcome = Literal["pass", "fail", "inconclusive", "refused"]


@dataclass(frozen=True)
class Part:
    """One thing that is graded by itself: `share` of all points, and what of it was earned, from 0 to 1."""

    name: str
    share: float
    earned: float
    sentence: str


@dataclass(frozen=True)
class Graded:
    """One submission.

    `name`: of its file or folder; `sentence`: the verdict in words; `error`: of the mean luminance with its interval,
    (low, error, high), relative, None where no image was judged. `place`, `family`, `formula`: where it is wrong, what
    kind of cause it has and which, empty where that is not known; `findings`: what was found without a reference, each
    with the level of hints at which it is told. `pictures`: PNG files by title, in the order in which they are shown.
    """

    name: str
    files: tuple[str, ...]
    outcome: Outcome
    sentence: str
    parts: tuple[Part, ...]
    error: tuple[float, float, float] | None = None
    place: str = ""
    family: str = ""
    formula: str = ""
    findings: tuple[tuple[Hints, str], ...] = ()
    pictures: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)
    contract: str = ""
    seconds: float = 0.0

    @property
    def points(self) -> float:
        """What of all points it earned, from 0 to 1."""
        whole = sum(part.share for part in self.parts)
        return sum(part.share * part.earned for part in self.parts) / whole if whole else 0.0


def told(graded: Graded, hints: Hints) -> Graded:
    """The submission with no more than `hints` tell: neither text nor picture leaks the rest.

    Pictures of differences show where an image is wrong, so they need `place`.
    """
    level = HINTS.index(hints)

    def shown(needed: Hints) -> bool:
        return level >= HINTS.index(needed)

    return replace(
        graded, place=graded.place if shown("place") else "", family=graded.family if shown("family") else "",
        formula=graded.formula if shown("formula") else "",
        findings=tuple((needed, text) for needed, text in graded.findings if shown(needed)),
        pictures=graded.pictures if shown("place") else ())
