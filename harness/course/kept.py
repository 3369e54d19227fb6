"""The handout's pictures as they are kept beside the report and shown by it: as JPEGs, with what they took."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.course.gallery import FIGURES, STRATEGY, Picture
from harness.errors import StoreError
from harness.files import data_dir
from harness.results import KeptPicture
from harness.samples import json
from harness.samples.exr import read_estimate
from harness.samples.images import write_jpeg
from harness.scene import Scene, file_of

RECORDS_FILE = "pictures.json"


def kept_folder() -> Path:
    """Those that come with the harness."""
    return data_dir("reports") / "pictures"


def keep(picture: Picture, scene: Scene, folder: Path) -> KeptPicture:
    """Write a finished picture as a JPEG into a folder, and its record into the folder's list, in place of one of the
    same scene. StoreError where that cannot be written, or the list is damaged."""
    mean = read_estimate(picture.exr)[0].mean
    asked = next((figure.spp for figure in FIGURES if figure.scene == scene.name), picture.samples)
    record = KeptPicture(scene.name, STRATEGY, mean.shape[1], mean.shape[0], picture.samples, asked, picture.rejected,
                         picture.seconds, picture.device, f"{datetime.datetime.now():%Y-%m-%d}")
    others = [each for each in load_kept(folder) if each.scene != scene.name]
    write_jpeg(folder / record.file, mean, file_of(scene).film.exposure)
    json.save(folder / RECORDS_FILE, {"pictures": sorted([*others, record], key=lambda each: each.scene)})
    return record


def load_kept(folder: Path) -> tuple[KeptPicture, ...]:
    """What is kept in a folder; nothing where there is no list. StoreError for a damaged one, or a missing JPEG."""
    path = folder / RECORDS_FILE
    if not path.exists():
        return ()
    records = json.load(path, _records, what="a list of pictures", mend="delete it, and keep the pictures again")
    for record in records:
        if not (folder / record.file).exists():
            raise StoreError(f"{folder / record.file}: the picture is missing that {RECORDS_FILE} names; keep it again")
    return records


def _records(held: Mapping[str, Any]) -> tuple[KeptPicture, ...]:
    return tuple(json.built(KeptPicture, each) for each in held["pictures"])
