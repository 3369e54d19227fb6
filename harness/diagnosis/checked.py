"""A stranger's shader checked from end to end: what experiments find out, and the verdict on a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

from harness.diagnosis.causes import Diagnosis, diagnose
from harness.diagnosis.repaired import Repaired, repaired
from harness.diagnosis.stranger import Judged, judge_stranger, reference, tolerance_of
from harness.estimators.shader import Shader, require_known
from harness.progress import Progress, quiet
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.strangers.experiment import HOPELESS, SIZE, experiment
from harness.strangers.findings import Findings
from harness.strangers.process import Process

# Pixels of the width of the film that a shader is judged on unless somebody says otherwise.
WIDTH = 64


@dataclass(frozen=True, eq=False)
class Checked:
    """`found`: what the experiments say; `judged`: the verdict on a scene, None where none was asked for, or where the
    shader draws nothing that could be judged. `diagnosis`: why the picture is wrong, where it is and no transform
    explains it; `repaired`: a line with which it passes, where a known repair is one; `hopeless`: why there was
    nothing to hold against a scene."""

    found: Findings
    judged: Judged | None = None
    diagnosis: Diagnosis | None = None
    repaired: Repaired | None = None
    hopeless: str = ""

    @property
    def is_right(self) -> bool:
        """No fault, and a picture that passes where one was to be judged."""
        return not self.found.faults and not self.hopeless and (self.judged is None or self.judged.is_right)


def check_shader(shader: Shader, scene: SceneFile | None = None, *, size: tuple[int, int] | None = None,
                 store: Store | None = None, budget: float = 60.0, tolerance: float | None = None,
                 spp: int | None = None, causes: bool = True, progress: Progress = quiet) -> Checked:
    """Everything that can be found out of a shader; `size` of the experiments' film, which is small if None.

    `spp`: samples per pixel of the reference, enough for the film if None. `budget`: seconds for drawing the frames
    that are judged. `causes`: whether to look for the cause of a picture that is wrong, which on a scene's first time
    takes a minute or two. HarnessError where a uniform's use is unknown, ShaderError for a shader that does not
    compile, takes too long or ends its process.
    """
    read = shader.read()
    require_known(read)
    if scene is not None:
        shader.check(scene)
    with Process(shader.limits) as process:
        with progress(None, f"{shader.name} experiments"):
            found = experiment(read, process, size or SIZE)
        if scene is None:
            return Checked(found)
        if hopeless := _hopeless(found):
            return Checked(found, hopeless=hopeless)
        shader = replace(shader, contract=found.contract)
        judged = judge_stranger(shader, scene, store=store, budget=budget, tolerance=tolerance, encoding=found.encoding,
                                spp=spp, process=process, progress=progress)
        if not causes or judged.outcome != "fail" or judged.transform:
            return Checked(found, judged)
        diagnosis = diagnose(judged.scene, *judged.compared, store=store, progress=progress,
                             besides=judged.view.spread.defect if judged.view.spread else None)
        with progress(None, f"{shader.name} repairs"):
            proof = repaired(shader, diagnosis, scene, store=store, budget=budget, tolerance=tolerance, spp=spp,
                             view=judged.view, process=process)
        return Checked(found, judged, diagnosis, proof)


def _hopeless(found: Findings) -> str:
    """Why there is nothing to hold against a reference; empty where there is."""
    if found.law.kind == "other":
        return "what a frame adds cannot be told from its past"
    return "its frames show nothing" if any(found.has(kind) for kind in HOPELESS) else ""


def sized(scene: SceneFile, size: tuple[int, int] | None = None) -> SceneFile:
    """The scene at a size, (width, height), or at a small one of its film's shape."""
    if size is not None:
        return scene.sized(*size)
    film = scene.film
    return scene.sized(WIDTH, max(1, round(WIDTH * film.height / film.width)))


def draw_reference(scene: SceneFile, tolerance: float | None = None, *, store: Store | None = None,
                   progress: Progress = quiet) -> None:
    """Have the store hold what a verdict on the scene needs. SceneError as Mitsuba."""
    reference(scene, tolerance_of(scene, tolerance), store=store, progress=progress)
