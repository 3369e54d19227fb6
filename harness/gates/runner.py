"""Runs one gate: draws samples, looks, and draws more until it is decided or its budget ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial

from harness.errors import HarnessError
from harness.estimators.base import Renderer
from harness.gates.budget import factor_needed, too_small
from harness.gates.contract import breach, one_image, remark
from harness.gates.coupled import agreed, dissected, require_budget, with_agreement
from harness.gates.curve import curve
from harness.gates.ladder import climb, told
from harness.gates.model import MAX_SIDE, Gate, GateResult, Look
from harness.gates.references import References
from harness.progress import Progress, quiet
from harness.scene import Film
from harness.stats.needed import times
from harness.stats.tiles import ImageMoments
from harness.work.run import FixedRun, Run


def run_gate(gate: Gate, references: References | None = None, *, progress: Progress = quiet,
             ladder: bool = True) -> GateResult:
    """Run one gate: look at a quarter, a half and all of its budget, and stop when it is decided.

    `references`: those of a run of several gates, which share them. The test is always rendered, never read from a
    store, which a gate must not trust. Test and reference grow together. `ladder`: where it fails, run it at lesser
    depths, and say from which on it is wrong (see `gates.ladder`); a coupled one is also dissected, to name the
    function that is wrong (`harness.diagnosis`). Raises HarnessError for a scene, estimator or
    reference that cannot be used, and for a budget that the variance (not the error) of the first look shows to be too
    small to decide.
    """
    began = time.perf_counter()
    film = check_gate(gate)
    with nullcontext(references) if references else References() as held:
        result, broken = _run(gate, film, held, progress, began)
        if ladder and result.outcome == "fail" and not broken:
            result = _with_ladder(result, held)
            if gate.agreement is not None:
                result = dissected(result)
        return result


def _run(gate: Gate, film: Film, references: References, progress: Progress, began: float) -> tuple[GateResult, bool]:
    """The result, and whether it is one of a contract that was not kept, which is so at every depth."""
    theirs = references.of(gate)
    with opened(gate) as renderer, progress(gate.spp * gate.replicas, gate.name) as advance:
        ours = Run(renderer, gate.spp)
        agreement = None
        if gate.agreement is not None:
            agreement = agreed(gate, renderer, theirs.renderer)
        looks = _look(gate, ours, theirs, advance, decided=agreement is not None and agreement.outcome == "fail")
        broken = breach(gate, ours)
        result = _result(gate, film, looks, ours, theirs, broken, time.perf_counter() - began)
        return (with_agreement(result, agreement) if agreement and not broken else result), bool(broken)


def _with_ladder(failed: GateResult, references: References) -> GateResult:
    """The result with the ladder of its depths, told in its reason."""
    ladder = climb(failed, references, partial(run_gate, ladder=False))
    said = told(ladder)
    return replace(failed, ladder=ladder, reason=f"{failed.reason}; {said}" if said else failed.reason)


def check_gate(gate: Gate) -> Film:
    """The film of the gate's scene. HarnessError where it cannot be read or is too large, or what is judged does not
    suit the scene."""
    film = gate.scene.film
    if max(film.width, film.height) > MAX_SIDE:
        raise gate.error(f"the scene's film has {film.width} x {film.height} pixels, a gate at most {MAX_SIDE} a "
                         "side; set 'size'")
    try:
        warning = gate.test.check(gate.scene)
    except HarnessError as error:
        raise gate.error(str(error)) if type(error) is HarnessError else error from None
    if warning:
        raise gate.error(f"strategy '{gate.strategy}' does not suit the scene: {warning}")
    return film


@contextmanager
def opened(gate: Gate) -> Iterator[Renderer]:
    """What the gate judges; errors that do not say where they arose say which gate it was."""
    with ExitStack() as stack:
        try:
            renderer = stack.enter_context(gate.test.open(gate.scene))
        except HarnessError as error:
            raise gate.error(str(error)) if type(error) is HarnessError else error from None
        yield renderer


def _look(gate: Gate, ours: Run, theirs: Run | FixedRun, advance: Callable[[float], None], *,
          decided: bool) -> list[Look]:
    """Looks until a verdict; a single one where all is `decided` before."""
    done: list[Look] = []
    for number, replicas in enumerate(gate.looks):
        ours.grow(replicas, advance)
        theirs.grow(replicas)
        test, reference = ours.tiles(replicas), theirs.tiles(replicas)
        verdict = (gate.paired or gate.sequence).decide(number, test, reference)
        done.append(Look(gate.spp * replicas, int(reference.samples.sum()), verdict))
        if verdict.outcome != "inconclusive" or decided or breach(gate, ours):
            break
        if number == 0 and not gate.at_once:
            if gate.paired is not None:
                require_budget(gate, test, reference)
            else:
                _require_budget(gate, theirs, ImageMoments.of(test), ImageMoments.of(reference))
    return done


def _require_budget(gate: Gate, theirs: Run | FixedRun, test: ImageMoments, reference: ImageMoments) -> None:
    if too_small(gate, test, reference):
        factor = gate.looks[0] / gate.replicas * factor_needed(gate.sequence, test, reference)
        also = " (of the reference as well)" if not isinstance(theirs, FixedRun) else ""
        raise gate.error(f"a budget of {gate.replicas} replicas of {gate.spp} samples per pixel is too small to "
                         f"decide; {times(factor)} the samples would do{also}, or wider tolerances")


def _result(gate: Gate, film: Film, looks: list[Look], ours: Run, theirs: Run | FixedRun, broken: str,
            seconds: float) -> GateResult:
    last = looks[-1].verdict
    outcome, reason = last.outcome, last.reason
    if broken:
        outcome, reason = "fail", broken
    elif outcome != "pass" and one_image(ours):
        reason += "; all batches are one image: without noise, or from a seed without `first_sample` and `replica`"
    elif outcome == "inconclusive":
        reason += f"; the budget of {gate.replicas} x {gate.spp} samples per pixel has ended"
    if outcome == "fail" and not broken:
        reason += remark(looks[-1].verdict.mean, ours)
    return GateResult(gate, outcome, reason, tuple(looks), curve(gate, ours, theirs), ours.estimate(),
                      theirs.estimate(), film.exposure, seconds)
