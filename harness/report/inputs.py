"""All that a report is made from, as one value."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from harness.errors import HarnessError
from harness.results import (
    AutopsyScore,
    Benchmark,
    CoupledRecord,
    Exhibit,
    FeatureImage,
    GateEvidence,
    KeptPicture,
    KillRecord,
    StudyResult,
)
from harness.stats.calibration import Calibration
from harness.studies.causes import CausesFile
from harness.studies.oracle import OracleFile

# Where gates leave their results, in the folder of the report.
GATES_FOLDER = "gates"


@dataclass(frozen=True, eq=False)
class Inputs:
    """What was studied and measured. HarnessError without results, and for two results of one scene.

    `profile`: the word for how thorough the studies were. `elapsed`: wall-clock seconds of the steps before the report,
    by name. The rest as far as it was measured: `bench`, `mutants`: what `harness bench` and `harness mutants` found;
    `exhibits`: the handout's errors; `calibration`: the verdicts' own errors; `coupled`: the tracer against the oracle
    that draws its random numbers; `autopsies`: what these name of mutants; `oracle`: that oracle against Mitsuba's own
    `path`, once and at length; `causes`: how often diagnoses name them; `pictures`: the handout's, with their JPEGs;
    `gates`: how each ended when it ran last, with what it left in `GATES_FOLDER` beside the report; `features`: scenes
    without one of their features, and by strategies at equal samples.
    """

    results: Sequence[StudyResult]
    profile: str
    bench: Benchmark | None = None
    elapsed: Mapping[str, float] = field(default_factory=dict)
    exhibits: Sequence[Exhibit] = ()
    calibration: Calibration | None = None
    mutants: KillRecord | None = None
    coupled: Sequence[CoupledRecord] = ()
    autopsies: AutopsyScore | None = None
    oracle: OracleFile | None = None
    causes: CausesFile | None = None
    pictures: Sequence[tuple[KeptPicture, bytes]] = ()
    gates: Sequence[GateEvidence] = ()
    features: Sequence[FeatureImage] = ()

    def __post_init__(self) -> None:
        names = [result.scene for result in self.results]
        if not names:
            raise HarnessError("a report needs at least one study, found none; run 'harness study' first")
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise HarnessError(f"two studies of a scene called '{twice}'; give each scene of a report its own name")

    @cached_property
    def stems(self) -> tuple[str, ...]:
        """For each result its scene's name as names of files and links begin with it; all are different."""
        return stems_of(result.scene for result in self.results)

    @property
    def anchors(self) -> tuple[str, ...]:
        """For each result the anchor of its scene's chapter, which no chapter on anything else can have."""
        return tuple(map(anchor_of, self.stems))


def stems_of(scenes: Iterable[str]) -> tuple[str, ...]:
    """For each scene's name, in the order of a report, how names of files and links begin."""
    stems: list[str] = []
    for scene in scenes:
        stem = base = re.sub(r"[^a-z0-9]+", "-", scene.lower()).strip("-") or "scene"
        number = 2
        while stem in stems:
            stem, number = f"{base}-{number}", number + 1
        stems.append(stem)
    return tuple(stems)


def anchor_of(stem: str) -> str:
    """The anchor of a scene's chapter."""
    return f"scene-{stem}"
