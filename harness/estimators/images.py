"""Renders of any program as they lie in files: each file one independent run, which is one batch."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from glob import glob
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, StoreError
from harness.estimators.independence import duplicate, require_independent
from harness.files import PARTIAL_PREFIX
from harness.progress import Advance
from harness.samples.cost import total as total_cost
from harness.samples.estimate import Batch, Estimate
from harness.samples.readers import SUFFIXES, ReadImage, read_image
from harness.samples.traits import Traits
from harness.scene.file import SceneFile

# From so many files on, the scatter between them tells the variance as well as what the files know of it themselves.
ENOUGH_RUNS = 16


@dataclass(frozen=True)
class Images:
    """Files that hold one independent render each, all of one scene at one size."""

    files: tuple[Path, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "files", tuple(Path(file) for file in self.files))
        if not self.files:
            raise HarnessError("no image: name a file, a folder or a quoted pattern such as 'mine_*.exr'")

    @classmethod
    def found(cls, word: str, folder: Path | None = None) -> Images:
        """The images that a word names: a file, a folder, or a pattern such as `mine_*.exr`; see `find_images`."""
        return cls(find_images(word, folder))

    @property
    def name(self) -> str:
        """The file's name, or the first of them and how many."""
        first = self.files[0].name
        return first if len(self.files) == 1 else f"{first} and {len(self.files) - 1} more"

    def check(self, scene: SceneFile) -> str:
        """They say nothing of the scene."""
        return ""

    @contextmanager
    def open(self, scene: SceneFile | None = None) -> Iterator[StoredRuns]:
        """All files, read. HarnessError, in one line that names them, where some cannot be read, sizes differ, or two
        are not independent."""
        runs = StoredRuns(self.files)
        if scene is not None:
            film = scene.film
            runs.require_size((film.width, film.height))
        yield runs


class StoredRuns:
    """Images read from files: replica k is the k-th file.

    `traits.fixed` is the whole answer where the files themselves know their variance, or are exact. A batch has as many
    samples as its file says, where all of them say it, and otherwise 1: files weigh alike then.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = tuple(files)
        _require_distinct(self.files)
        self.images = tuple(_read_all(self.files))
        _require_one_size(self.files, [image.pixels for image in self.images])
        self._samples = [image.spp for image in self.images]
        self.warnings = require_independent([str(file) for file in self.files],
                                            [image.pixels for image in self.images], self._samples)
        known = all(self._samples)
        spp = self._samples[0] if known and len(set(self._samples)) == 1 else 1
        self.traits = Traits(streams="runs", counts=False, replicas=len(self.files), spp=spp,
                             fixed=_pooled(self.images))
        self._known = known

    @property
    def identity(self) -> dict[str, str]:
        """The pixels of all files."""
        whole = hashlib.sha256()
        for image in self.images:
            whole.update(np.ascontiguousarray(image.pixels).tobytes())
        return {"renderer": "images", "files": str(len(self.files)), "pixels": whole.hexdigest()}

    @property
    def notes(self) -> list[str]:
        """What a reader of the numbers should know, each with the first file that it is so of."""
        told: dict[str, tuple[Path, str]] = {}
        count: Counter[str] = Counter()
        for file, image in zip(self.files, self.images, strict=True):
            for note in image.notes:
                kind = re.sub(r"[\d.]+", "", note)
                told.setdefault(kind, (file, note))
                count[kind] += 1
        more = {kind: f" (and {count[kind] - 1} more)" if count[kind] > 1 else "" for kind in told}
        return [f"{file}{more[kind]}: {note}" for kind, (file, note) in told.items()]

    def require_size(self, size: tuple[int, int]) -> None:
        """HarnessError unless the images have so many columns and rows."""
        height, width = self.images[0].pixels.shape[:2]
        if (width, height) != size:
            raise HarnessError(f"{self.files[0]} is {width} x {height}, expected {size[0]} x {size[1]}; render both at "
                               "the same size")

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """The image of one file, whole; HarnessError where there is no such file."""
        if not 0 <= replica < len(self.files) or start:
            raise HarnessError(f"run {replica + 1} is asked for from sample {start} on; there are {len(self.files)}, "
                               f"each whole: add files to {self.files[0].parent}")
        samples = self._samples[replica] if self._known else None
        if advance is not None:
            advance(count)
        return Batch(self.images[replica].pixels.astype(np.float32), samples or 1)


def find_images(word: str, folder: Path | None = None) -> tuple[Path, ...]:
    """The files that a word names, sorted: one file, all images of a folder, or those that match a pattern (`*`, `?`,
    `[…]`, `**`). Relative to `folder`. HarnessError where there are none."""
    path = (folder or Path()) / word
    if path.is_dir():
        found = [file for file in path.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file()]
        lack = f"{path}: no image in this folder; expected files such as {', '.join(SUFFIXES)}"
    elif re.search(r"[*?\[]", word) and not path.is_file():
        found = [file for file in map(Path, glob(str(path), recursive=True)) if file.is_file()]
        lack = f"{path}: no file matches this pattern; check it, and render first"
    else:
        return (path,)
    files = tuple(sorted((file for file in found if not file.name.startswith(PARTIAL_PREFIX)), key=_natural))
    if not files:
        raise HarnessError(lack)
    return files


def _natural(path: Path) -> list[tuple[int, str]]:
    """So that mine_10 comes after mine_9."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", str(path))]


def _read_all(files: Sequence[Path]) -> Iterator[ReadImage]:
    """All images; where some cannot be read, one StoreError that counts them and tells of the first."""
    images: list[ReadImage] = []
    wrong: list[StoreError] = []
    for file in files:
        try:
            images.append(read_image(file))
        except StoreError as error:
            wrong.append(error)
    if wrong and len(files) > 1:
        raise StoreError(f"{len(wrong)} of {len(files)} images cannot be read, first of all {wrong[0]}")
    if wrong:
        raise wrong[0]
    return iter(images)


def _require_distinct(files: Sequence[Path]) -> None:
    seen: dict[Path, Path] = {}
    for file in files:
        real = file.resolve()
        if real in seen:
            raise HarnessError(f"{file} is given twice{'' if seen[real] == file else f', also as {seen[real]}'}; each "
                               "file counts as a run of its own: name it once")
        seen[real] = file


def _require_one_size(files: Sequence[Path], images: Sequence[np.ndarray]) -> None:
    shapes = [image.shape[:2] for image in images]
    usual = Counter(shapes).most_common(1)[0][0]
    for file, shape in zip(files, shapes, strict=True):
        if shape != usual:
            raise HarnessError(f"{file} is {shape[1]} x {shape[0]}, {files[shapes.index(usual)]} is {usual[1]} x "
                               f"{usual[0]}; render all at the same size")


def _pooled(images: Sequence[ReadImage]) -> Estimate | None:
    """All images as one estimate where each knows its own variance, and there are too few to tell it between them.

    Weighted by samples, or alike where they are exact. Between two files there is one degree of freedom; within them
    there are those of all their batches.
    """
    estimates = [image.estimate for image in images if image.estimate is not None]
    if len(estimates) < len(images) or len(images) >= ENOUGH_RUNS:
        return None
    if len(estimates) == 1:
        return estimates[0]
    samples = np.array([estimate.samples for estimate in estimates], dtype=np.float64)
    if not samples.all() or not all(estimate.batches for estimate in estimates):
        return None
    weights = samples / samples.sum()

    def summed(name: str, power: int) -> np.ndarray:
        return np.asarray(sum(weight**power * getattr(estimate, name)
                              for weight, estimate in zip(weights, estimates, strict=True)))

    # Degrees of freedom are batches less one of each file, and readers of an estimate take one off.
    freedom = sum(estimate.batches - 1 for estimate in estimates)
    merged = Estimate(summed("mean", 1), summed("variance", 2), summed("luminance_variance", 2),
                      summed("image_mean", 1), summed("image_variance", 2), int(samples.sum()), freedom + 1)
    known = all(estimate.image_third is not None for estimate in estimates)
    return replace(merged, rejected=sum(estimate.rejected for estimate in estimates),
                   cost=total_cost(estimate.cost for estimate in estimates),
                   image_third=summed("image_third", 3) if known else None)


def shared(ours: StoredRuns, theirs: StoredRuns) -> tuple[str, str] | None:
    """Two files, one of each side, that hold the same pixels; None where there are none."""
    names = [str(file) for file in (*ours.files, *theirs.files)]
    images = [image.pixels for image in (*ours.images, *theirs.images)]
    return duplicate(names, images, split=len(ours.files))
