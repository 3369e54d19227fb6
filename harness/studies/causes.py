"""How often a diagnosis names the cause: every defect of the catalogue, presented as a stranger's picture; and whether
it accuses pictures that are right. Measured once, at length, and kept with its date."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path

from harness.diagnosis.causes import Defect, Diagnosis, diagnose, load_defects
from harness.diagnosis.causes.candidates import Candidate, applicable, candidates
from harness.diagnosis.causes.catalogue import Picture, defective
from harness.diagnosis.causes.drawn import Drawn
from harness.diagnosis.stranger import reference, tolerance_of
from harness.errors import HarnessError
from harness.files import data_dir
from harness.progress import Advance
from harness.samples import json
from harness.samples.estimate import Estimate, merge
from harness.samples.store import Store
from harness.scene import SceneFile, load
from harness.shader.library import OURS, Library

FILE = "causes.json"
# The shorter side of the images, in pixels, and the samples per pixel of each stranger, in so many batches.
SIDE, SPP, BATCHES = 48, 256, 16
# Replicas of one seed: more than batches, so that seeds share none.
REPLICAS = 1000
# What right shaders do otherwise, by their ids: a stranger with a defect does one of these as well. Where the defect
# is in the directions or in the numbers, only the first: in another basis half a circle is another half.
DISGUISES = ("other-hash", "cross-product-basis", "lobe-by-the-other-end", "term-by-the-other-end",
             "numbers-in-another-order")
# Strategies of which a stranger with a defect that the mixture draws takes one in turn.
OTHERS = ("uniform", "cosine", "lobes")
# Strategies that right strangers are drawn with.
ALL = (*OTHERS, "mixture")
# Lines (see lines.toml) by which strategies differ: what is wrong there is another picture under another of them.
OF_STRATEGIES = {"uniform_draw", "uniform_weight", "cosine_draw", "cosine_weight", "diffuse_weight", "choice", "draw",
                 "below", "lobes_weight", "mixture_pdf", "mixture_weight", "sample_lobe", "number", "advance"}


@dataclass(frozen=True)
class Missed:
    """A stranger whose cause does not come first.

    `defect`: its id; `strategy`, `disguise`: how it was drawn; `outcome`: of the diagnosis (see `Diagnosis`); `rank`:
    of the cause among those told, 0 where it is none of them; `told`: the first cause told, its defect's id or words.
    """

    defect: str
    strategy: str
    disguise: str
    outcome: str
    rank: int
    told: str


@dataclass(frozen=True)
class Accused:
    """A right shader, by its variant's id and strategy, of which a diagnosis says otherwise: its outcome, and what it
    told first."""

    shader: str
    strategy: str
    outcome: str
    told: str


@dataclass(frozen=True)
class CausesRecord:
    """One scene. `size`: (width, height); `spp`: of each stranger; `presented`: strangers with a defect; `visible`:
    those whose picture is not taken for the right one at that noise; of these `first` have their cause told first,
    `three` among the three told. Defects whose pictures cannot be told apart count as one. `missed`: not first.
    `right`: right strangers. `seconds`: CPU, what came from the store not counted."""

    scene: str
    size: tuple[int, int]
    spp: int
    presented: int
    visible: int
    first: int
    three: int
    missed: tuple[Missed, ...]
    right: int
    accused: tuple[Accused, ...]
    seconds: float


@dataclass(frozen=True)
class CausesFile:
    """All that was measured: the day (UTC, ISO 8601) when the last was, the versions of what measured, the seed of the
    strangers' numbers, and the defects in the catalogue."""

    date: str
    versions: dict[str, str]
    seed: int
    defects: int
    records: tuple[CausesRecord, ...]


@dataclass(frozen=True)
class Stranger:
    """Our tracer with a defect of the catalogue, or none, in disguise."""

    defect: str
    strategy: str
    disguise: str
    library: Library


def measure_causes(scenes: Sequence[SceneFile], right: Mapping[str, Library], *, spp: int = SPP, seed: int = 0,
                   store: Store | None = None, keep: Callable[[CausesFile], None] = lambda found: None,
                   advance: Advance = lambda n: None) -> CausesFile:
    """Have every defect that a scene has a use for, and every right shader with every strategy, diagnosed.

    `right`: right shaders by their ids, those of `DISGUISES` among them. `seed`: of the strangers' numbers, which no
    other seed shares. `keep` is given all that was found so far after each scene; what was drawn is in the `store`.
    HarnessError where there is no scene, SceneError for one that our tracer cannot hold.
    """
    if not scenes:
        raise HarnessError("there is no scene to present strangers on; name one or more")
    records: list[CausesRecord] = []
    for scene in scenes:
        records.append(_record(sized(scene), right, spp, seed, store, advance))
        keep(_file(records, seed))
    return _file(records, seed)


def sized(scene: SceneFile) -> SceneFile:
    """The scene with `SIDE` pixels along its shorter side, or as many as it has."""
    film = scene.film
    scale = min(1.0, SIDE / min(film.width, film.height))
    return scene.sized(*(max(1, round(scale * side)) for side in (film.width, film.height)))


def save_causes(found: CausesFile, path: str | Path) -> None:
    """Write as JSON; StoreError where that cannot be written."""
    json.save(Path(path), found)


def load_causes(path: str | Path) -> CausesFile:
    """The file that `save_causes` wrote; StoreError where it is not one."""
    return json.load(Path(path), lambda held: json.built(CausesFile, held),
                     what="a measurement of how often causes are named", mend="run `harness causes` again")


def causes_file() -> Path:
    """The measurement that comes with the harness, which was made once."""
    return data_dir("reports") / FILE


def wrong_strangers(scene: SceneFile, right: Mapping[str, Library], spp: int, seed: int,
                    store: Store | None) -> Iterator[tuple[Stranger, Estimate]]:
    """Every defect that shows on the scene, in each picture that it makes, in disguise; each picture of one once."""
    drawn_by = partial(Drawn, scene, load(scene), store=store, spp=spp // BATCHES, first=seed * REPLICAS)
    plain: dict[tuple[str, str], bytes] = {}  # first batches without the defect
    number = 0
    for defect in applicable(scene, load_defects()):
        seen: set[bytes] = set()
        for picture in defect.pictures:
            stranger = _disguised(defect, picture, number, right)
            number += 1
            key = (stranger.strategy, stranger.disguise)
            if key not in plain:
                with drawn_by(stranger.strategy, right.get(stranger.disguise, OURS)) as drawn:
                    plain[key] = drawn.batch(0).mean.tobytes()
            with drawn_by(stranger.strategy, stranger.library) as drawn:
                bits = drawn.batch(0).mean.tobytes()
                if bits != plain[key] and bits not in seen:
                    seen.add(bits)
                    yield stranger, merge(drawn.batches(BATCHES))


def right_strangers(scene: SceneFile, right: Mapping[str, Library], spp: int, seed: int,
                    store: Store | None) -> Iterator[tuple[Stranger, Estimate]]:
    """Every right shader with every strategy."""
    reading = load(scene)
    for name, library in right.items():
        for strategy in ALL:
            with Drawn(scene, reading, strategy, library, store, spp // BATCHES, seed * REPLICAS) as drawn:
                yield Stranger("", strategy, name, library), merge(drawn.batches(BATCHES))


def _record(scene: SceneFile, right: Mapping[str, Library], spp: int, seed: int, store: Store | None,
            advance: Advance) -> CausesRecord:
    began = time.process_time()
    truth = reference(scene, tolerance_of(scene, None), store=store).run.estimate()
    pictures = candidates(scene, store=store)
    outcomes: list[str] = []
    missed: list[Missed] = []
    for stranger, found in wrong_strangers(scene, right, spp, seed, store):
        told = _asked(scene, found, truth, pictures)
        outcomes.append(told.outcome)
        rank = next((place for place, cause in enumerate(told.causes, start=1)
                     if stranger.defect in (cause.id, *cause.alike)), 0)
        if told.outcome != "right" and rank != 1:
            missed.append(Missed(stranger.defect, stranger.strategy, stranger.disguise, told.outcome, rank,
                                 _first(told)))
    accused: list[Accused] = []
    for stranger, found in right_strangers(scene, right, spp, seed, store):
        told = _asked(scene, found, truth, pictures)
        if told.outcome != "right":
            accused.append(Accused(stranger.disguise, stranger.strategy, told.outcome, _first(told)))
    visible = len(outcomes) - outcomes.count("right")
    advance(1)
    film = scene.film
    return CausesRecord(scene.name, (film.width, film.height), spp, len(outcomes), visible, visible - len(missed),
                        visible - sum(each.rank == 0 for each in missed), tuple(missed), len(right) * len(ALL),
                        tuple(accused), time.process_time() - began)


def _asked(scene: SceneFile, found: Estimate, truth: Estimate, pictures: Sequence[Candidate]) -> Diagnosis:
    return diagnose(scene, found, truth, pictures=pictures, depths=False, where=False)


def _first(told: Diagnosis) -> str:
    return next((cause.id or cause.says for cause in told.causes), "")


def _disguised(defect: Defect, picture: Picture, number: int, right: Mapping[str, Library]) -> Stranger:
    """The defect under another strategy where its picture does not depend on that, and otherwise a right shader."""
    free = (len({each.strategy for each in defect.pictures}) == 1 and picture.strategy == "mixture"
            and not OF_STRATEGIES & {name for name, _ in picture.edits})
    strategy = OTHERS[number % len(OTHERS)] if free else picture.strategy
    turn = number % len(DISGUISES) if free else 0
    for name in (*DISGUISES[turn:], *DISGUISES[:turn]) if free else DISGUISES[:1]:
        if name in right:
            try:
                return Stranger(defect.id, strategy, name, defective(picture, right[name]))
            except HarnessError:  # both are in one line
                pass
    return Stranger(defect.id, strategy, "", defective(picture))


def _file(records: Sequence[CausesRecord], seed: int) -> CausesFile:
    versions = {name: metadata.version(name) for name in ("glsl-validation-harness", "mitsuba", "drjit")}
    return CausesFile(datetime.now(UTC).date().isoformat(), versions, seed, len(load_defects()), tuple(records))
