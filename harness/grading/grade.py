"""Submissions judged one by one, in processes of their own: nothing that one does disturbs the next."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from harness.diagnosis.checked import Checked, check_shader, draw_reference, sized
from harness.diagnosis.stranger import Judged
from harness.errors import HarnessError, MachineError, StoreError
from harness.estimators.shader import Shader
from harness.grading.records import Graded, Hints, Outcome, Part
from harness.grading.submissions import Submission
from harness.progress import Progress, quiet
from harness.report.figures.pictures import difference_map, difference_png, display_png, robust_limit
from harness.samples.store import Store
from harness.scene import SceneFile, present
from harness.shader.hosts.reading import Answer
from harness.strangers.findings import Finding
from harness.work.executors import executor

# What a part of the whole is worth: it runs and its samples are samples; frames are averaged rightly; the picture.
RUNS, AVERAGES, RIGHT = 0.1, 0.2, 0.7
# Of a picture that is right but for something outside of the path (a scale, a flip, an encoding), this much is earned.
TRANSFORMED = 0.5
# What a picture earns whose mean is undecided: no fault was found in it.
UNDECIDED = 1.0
# Differences below this are not drawn.
LEAST_DIFFERENCE = 0.02


@dataclass(frozen=True)
class Task:
    """What a submission is judged on: the scene, `values` of its uniforms, seconds for its frames, the tolerance, and
    whether causes are looked for."""

    scene: SceneFile
    host: str | None = None
    values: tuple[tuple[str, Answer], ...] = ()
    size: tuple[int, int] | None = None
    budget: float = 20.0
    tolerance: float | None = None
    store: Path | None = None
    causes: bool = True


def grade(submissions: Sequence[Submission], task: Task, *, jobs: int = 1, progress: Progress = quiet) -> list[Graded]:
    """Every submission judged, in order, in `jobs` processes, or in this one.

    A shader that cannot be judged is refused with its reason; what is wrong with the machine or the scene ends the run:
    MachineError, SceneError, StoreError.
    """
    draw_reference(sized(task.scene, task.size), task.tolerance, store=Store(task.store) if task.store else None,
                   progress=progress)  # once, before two processes draw it at the same time
    found: list[Graded] = []
    where = "processes" if jobs > 1 else "serial"
    with progress(len(submissions), "submissions") as advance, executor(where, jobs) as pool:
        for graded in pool.map(partial(graded_alone, task), submissions):
            found.append(graded)
            advance(1)
    return found


def graded_alone(task: Task, submission: Submission) -> Graded:
    """One submission. MachineError and StoreError as the renderers."""
    began = time.perf_counter()
    shader = Shader(submission.files, task.host, task.values)
    names = submission.names
    try:
        scene = sized(task.scene, task.size or shader.read().size)
        checked = check_shader(shader, scene, store=Store(task.store) if task.store else None, budget=task.budget,
                               tolerance=task.tolerance, causes=task.causes)
        graded = _graded(submission.name, names, checked, scene)
    except (MachineError, StoreError):
        raise
    except HarnessError as error:
        parts = (Part("it runs", RUNS, 0.0, str(error)), Part("frames are averaged", AVERAGES, 0.0, "not judged"),
                 Part("the picture is right", RIGHT, 0.0, "not judged"))
        graded = Graded(submission.name, names, "refused", str(error), parts)
    return replace(graded, seconds=time.perf_counter() - began)


def _graded(name: str, files: tuple[str, ...], checked: Checked, scene: SceneFile) -> Graded:
    found, judged = checked.found, checked.judged
    own = [fault for fault in found.faults if fault.part != "accumulation"]
    lost = _averaging(checked)
    parts = (Part("it runs", RUNS, 0.0 if own and judged is None else 1.0, _first(own) or "it does"),
             Part("frames are averaged", AVERAGES, float(not lost), lost or found.accumulation.told),
             _picture(checked, own))
    outcome: Outcome = "fail" if judged is None or found.faults else _outcome(judged)
    sentence = _sentence(checked)
    told = tuple(_hinted(one) for one in found.found if one.severity != "note")
    common = Graded(name, files, outcome, sentence, parts, findings=told,
                    contract=f"host {found.contract.host}; {found.law_told}")
    if judged is None:
        return common
    error, low, high = (float(value) for value in judged.verdict.luminance)
    worst = judged.worst
    place = "" if judged.is_right else (
        f"worst in x {worst.x} to {worst.x + worst.tile}, y {worst.y} to {worst.y + worst.tile}: {worst.channel} "
        f"{worst.error:+.2%}")
    family, formula = _cause(checked)
    return replace(common, error=(low, error, high), place=place, family=family, formula=formula,
                   pictures=tuple(_pictures(judged, scene)))


def _cause(checked: Checked) -> tuple[str, str]:
    """Of what kind the cause is, and which it is; nothing where that is not known."""
    judged, diagnosis = checked.judged, checked.diagnosis
    if judged is not None and judged.transform:
        return "the way from samples to pixels, not the paths", judged.transform
    if diagnosis is None or diagnosis.outcome not in ("cause", "several"):
        return "", ""
    families = dict.fromkeys(cause.family for cause in diagnosis.causes if cause.same)
    proof = f"; {checked.repaired.sentence}" if checked.repaired else ""
    return f"look at: {', '.join(families)}", diagnosis.sentence + proof


def _averaging(checked: Checked) -> str:
    """What is wrong with how frames are joined; nothing where all is well."""
    found = checked.found
    if found.accumulation.outcome == "fail":
        return found.accumulation.told
    return _first([fault for fault in found.faults if fault.part == "accumulation"])


def _picture(checked: Checked, faults: Sequence[Finding]) -> Part:
    title, judged = "the picture is right", checked.judged
    if judged is None:
        return Part(title, RIGHT, 0.0, _first(faults) or f"not judged: {checked.hopeless}")
    error, low, high = judged.verdict.luminance
    earned = {"pass": 1.0, "inconclusive": UNDECIDED}.get(judged.outcome, TRANSFORMED if judged.transform else 0.0)
    return Part(title, RIGHT, earned, f"mean luminance {error:+.2%} ({low:+.2%} to {high:+.2%}): {judged.outcome}")


def _outcome(judged: Judged) -> Outcome:
    return "pass" if judged.is_right else "fail" if judged.outcome == "fail" else "inconclusive"


def _sentence(checked: Checked) -> str:
    """The verdict in a sentence that tells neither place nor cause."""
    found, judged = checked.found, checked.judged
    wrong = [lost] if (lost := _averaging(checked)) else []
    if fault := _first([fault for fault in found.faults if fault.part != "accumulation"]):
        wrong.append(fault)
    if checked.hopeless:
        wrong.append(f"not judged: {checked.hopeless}")
    if judged is not None and not judged.is_right:
        error, low, high = judged.verdict.luminance
        wrong.append(f"mean luminance {error:+.2%} ({low:+.2%} to {high:+.2%})" if judged.outcome == "fail"
                     else "its noise leaves the picture undecided")
    return "; ".join(wrong) or "right within the tolerance"


def _hinted(one: Finding) -> tuple[Hints, str]:
    """What was found without a reference is told to all, the author's line only to those who may see the formula."""
    return ("formula", f"{one.where}: {one.told}") if one.where else ("none", one.told)


def _pictures(judged: Judged, scene: SceneFile) -> Iterator[tuple[str, bytes]]:
    exposure = present(scene).exposure
    test, truth = judged.found.mean, judged.reference.mean
    yield "submission", display_png(test, exposure)
    yield "reference", display_png(truth, exposure)
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = difference_map(test, truth)
    limit = robust_limit([difference], LEAST_DIFFERENCE)
    yield f"difference, ±{limit:.0%}", difference_png(difference, limit)


def _first(faults: Sequence[Finding]) -> str:
    """The first fault as anybody may read it: what is told of a line of the author's quotes it, which is a formula."""
    if not faults:
        return ""
    return "a line of its text is at fault, whatever the scene" if faults[0].where else faults[0].told
