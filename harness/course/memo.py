"""The memory of exhibits: those measured with the same code, scenes and versions are read back."""

from __future__ import annotations

from pathlib import Path

from harness.course.collection import measure_exhibits
from harness.course.storage import WORDS_FILE, load_exhibits, save_exhibits
from harness.course.texts import TEXTS_FILE
from harness.files import cache_dir, data_dir
from harness.progress import Progress, quiet
from harness.results import Exhibit
from harness.samples.keys import code_digest, digest, folder_digest
from harness.samples.memo import Warn, remembered
from harness.samples.store import Store
from harness.studies.memo import glsl_digest
from harness.work.provenance import versions


def remembered_exhibits(store: Store | None, *, warn: Warn,
                        progress: Progress = quiet) -> tuple[tuple[Exhibit, ...], bool]:
    """The handout's errors, and whether they were measured now; `warn` is told of damaged ones, measured again."""
    return remembered(exhibits_folder(), WORDS_FILE, load=load_exhibits, make=lambda: measure_exhibits(store, progress),
                      save=save_exhibits, warn=warn, loss="the exhibits are measured again")


def exhibits_folder() -> Path:
    """Where the cache keeps them, be they there or not."""
    key = {"code": code_digest(__name__), "glsl": glsl_digest(), "texts": TEXTS_FILE.read_text(encoding="utf-8"),
           "scenes": folder_digest(data_dir("mitsuba_scenes"), ".xml", ".png", ".exr"), **versions()}
    return cache_dir() / "exhibits" / digest(key, 24)
