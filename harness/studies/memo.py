"""The memory of studies: what was studied with the same scene, settings, code and versions is read back."""

from __future__ import annotations

from pathlib import Path

from harness.files import cache_dir, data_dir
from harness.progress import Progress, quiet
from harness.results import StudyResult
from harness.samples.keys import code_digest, digest, folder_digest
from harness.samples.memo import Warn, remembered
from harness.samples.store import Store
from harness.scene import Scene, describe, present
from harness.studies.plan import Profile, exhibited
from harness.studies.storage import STUDY_FILE, load_study, save_study
from harness.studies.study import study
from harness.work.provenance import versions


def remembered_study(scene: Scene, profile: Profile, family: int, store: Store | None, *, warn: Warn,
                     progress: Progress = quiet) -> tuple[StudyResult, bool]:
    """The study of one scene with the strategies that a report shows, and whether it was made now.

    It is read back where scene, settings and code are the same as when it was made, and as many verdicts (`family`)
    share the rate of false alarms. `warn` is told of a damaged one, which is made again. Raises what `study` raises.
    """
    def make() -> StudyResult:
        return study(scene, exhibited(scene, profile), spp=profile.spp, replicas=profile.replicas,
                     reference_spp=profile.reference_spp, family=family, store=store, progress=progress)

    return remembered(study_folder(scene, profile, family), STUDY_FILE, load=load_study, make=make,
                      save=save_study, warn=warn, loss="the study is made again")


def study_folder(scene: Scene, profile: Profile, family: int) -> Path:
    """Where the cache keeps that study, be it there or not."""
    lines, shown = exhibited(scene, profile), present(scene.file)
    key = {"scene": scene.content_hash, "name": scene.name, "exposure": shown.exposure, "notes": shown.notes,
           "strategies": [line.name for line in lines],
           "description": describe(scene.path) if scene.path else "", "spp": profile.spp, "replicas": profile.replicas,
           "reference_spp": profile.reference_spp, "family": family, "code": code_digest(__name__),
           "glsl": glsl_digest(), **versions()}
    return cache_dir() / "studies" / digest(key, 24)


def glsl_digest() -> str:
    """What the shaders say that come with the harness, comments included."""
    return folder_digest(data_dir("glsl"), ".glsl", ".frag", ".comp")
