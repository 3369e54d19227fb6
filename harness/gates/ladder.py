"""The ladder of depths: a gate that failed is run again with short paths, to say from which bounce on it is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from harness.errors import HarnessError, MachineError, StoreError
from harness.estimators.base import no_depth
from harness.estimators.mitsuba import Mitsuba
from harness.gates.model import MAX_TILE, Gate, GateResult, Ladder, Rung
from harness.gates.references import References
from harness.stats.bias import signed_percent
from harness.stats.verdicts import Tolerance

# Depths are climbed one by one so far, where most defects show; then doubled, and the gap halved.
ONE_BY_ONE = 4
# The deepest rung where the scene sets no bound.
DEEPEST = 32
# Relative error of the mean up to which a dark rung may be off: see `_tolerance`.
WIDEST = 0.05
# Runs one gate without a ladder.
RunGate = Callable[[Gate, References], GateResult]


def climb(failed: GateResult, references: References, run: RunGate) -> Ladder:
    """The ladder of a gate that failed: depths 1, 2, 3, 4, 8, 16, … of its scene until one fails, then between that and
    the deepest that did not.

    Each rung is the gate at that depth, with its looks and budget, so it costs no more than the gate would at its
    longest; there are at most 4 + 2 log2(max_depth / 4). Tolerances are the gate's, wider where the image is darker
    than the scene's (`_tolerance`). `run` runs one. A reference that is a closed form or an image is true of one depth
    alone: Mitsuba takes its place, at the scene's own depth too. There are no rungs where what is judged cannot be
    asked for a depth (`reason` says why) and where the scene's is 1.
    """
    gate = failed.gate
    try:
        top = gate.scene.depth
        reason = no_depth(gate.test, gate.scene)
    except HarnessError as error:
        return Ladder((), top=None, reason=str(error))
    if reason or top == 1:
        return Ladder((), top=top, reason=reason)
    rungs: dict[int, Rung] = {}
    known = top if _goes_along(gate) else None  # to fail

    def wrong(depth: int) -> bool:
        rungs[depth] = _rung(failed, depth, references, run)
        return rungs[depth].outcome == "fail"

    right = 0
    for depth in _climbed(top):
        if depth == known or wrong(depth):
            while depth - right > 1:
                middle = (right + depth) // 2
                if wrong(middle):
                    depth = middle
                else:
                    right = middle
            break
        right = depth
    return Ladder(tuple(rungs[depth] for depth in sorted(rungs)), top=top)


def _climbed(top: int | None) -> Iterator[int]:
    """1, 2, 3, 4, 8, 16, … and, where the scene is bounded, its own, at which the gate is known to fail."""
    last = DEEPEST if top is None else top - 1
    depth = 1
    while depth <= last:
        yield depth
        depth = depth + 1 if depth < ONE_BY_ONE else 2 * depth
    if top is not None:
        yield top


def _rung(failed: GateResult, depth: int, references: References, run: RunGate) -> Rung:
    """The gate at one depth. What keeps it from deciding leaves it undecided; a lack of the machine is raised."""
    gate = failed.gate
    own = _goes_along(gate)
    at = replace(gate, scene=gate.scene.at_depth(depth), reference=gate.reference if own else Mitsuba(),
                 reference_spp=gate.reference_spp if own else gate.spp)
    try:
        reference = references.of(at)
        reference.grow(at.looks[0])
        all_light = float(failed.reference.mean.mean())
        share = float(reference.estimate().mean.mean()) / all_light if all_light > 0 else 1.0
        if not reference.estimate().mean.any():
            return _black(at, depth)
        whole = _tolerance(at.tolerance, share)
        rung = _judged(replace(at, tolerance=whole), depth, references, run)
        if rung.outcome != "inconclusive":
            return rung
        # Where few pixels see light, tiles at its edges stay noisy when the image has long been decided.
        mean = _judged(replace(at, tolerance=Tolerance(whole.mean, MAX_TILE, MAX_TILE)), depth, references, run)
        return replace(mean, reason=f"of the mean alone: {mean.reason}") if mean.outcome != "inconclusive" else rung
    except (MachineError, StoreError):
        raise
    except HarnessError as error:
        return Rung(depth, "inconclusive", str(error), 0)


def _judged(gate: Gate, depth: int, references: References, run: RunGate) -> Rung:
    """One run; a budget that is too small leaves it undecided."""
    try:
        result = run(gate, references)
    except (MachineError, StoreError):
        raise
    except HarnessError as error:
        return Rung(depth, "inconclusive", str(error).removeprefix(str(gate.error(""))), 0)
    return Rung(depth, result.outcome, result.reason, result.test.samples, *result.verdict.luminance, result=result)


def _goes_along(gate: Gate) -> bool:
    """Is the reference true at every depth?"""
    return not no_depth(gate.reference, gate.scene)


def _tolerance(tolerance: Tolerance, share: float) -> Tolerance:
    """What an image with that share of the scene's light is held to: errors as large as the gate's own, relative to all
    of the light, up to WIDEST of its own. A lamp in a corner, seen alone, is too noisy at its edges for more."""
    wider = max(1.0, min(1 / share, WIDEST / tolerance.mean))
    return Tolerance(*(min(wider * bound, MAX_TILE) for bound in (tolerance.mean, tolerance.coarse, tolerance.fine)))


def _black(gate: Gate, depth: int) -> Rung:
    """The rung of a black image, which has no mean that errors could be relative to: right where the test is black."""
    with gate.test.open(gate.scene) as renderer:
        batch = renderer.render_batch(0, 0, gate.spp)
    if np.any(batch.mean):
        return Rung(depth, "fail", "light where the reference has none at all", gate.spp)
    return Rung(depth, "black", "no light yet, on either side", gate.spp)


def told(ladder: Ladder) -> str:
    """The ladder in a sentence: 'right up to depth 2, wrong from 3 on (light scattered twice): −1.8 %'."""
    if not ladder.rungs:
        return f"no ladder of depths: {ladder.reason}" if ladder.reason else ""
    wrong = ladder.wrong
    before = [rung for rung in ladder.rungs if wrong is None or rung.depth < wrong.depth]
    undecided = [rung.depth for rung in before if rung.outcome == "inconclusive"]
    right = [rung.depth for rung in before if rung.outcome == "pass" and not any(d < rung.depth for d in undecided)]
    parts = []
    if any(rung.outcome == "black" for rung in before):
        parts.append(f"black up to depth {max(rung.depth for rung in before if rung.outcome == 'black')}")
    if right:
        parts.append(f"right up to depth {max(right)}")
    if undecided:
        parts.append(f"undecided at {', '.join(map(str, undecided))}")
    if wrong is not None:
        parts.append(f"wrong from {'' if before else 'depth '}{wrong.depth} on ({_light(wrong.depth)}): {_size(wrong)}")
    elif ladder.rungs[-1].depth == ladder.top and right and not undecided:
        return "right at every depth against Mitsuba, so the reference is in doubt"
    elif ladder.top is not None and ladder.rungs[-1].depth != ladder.top:
        parts.append(f"wrong at {ladder.top}, the scene's ({_light(ladder.top)})")
    return ", ".join(parts)


def _light(depth: int) -> str:
    """What a path of so many vertices brings that shorter ones do not."""
    scattered = {1: "seen directly", 2: "scattered once", 3: "scattered twice"}
    return f"light {scattered.get(depth, f'scattered {depth - 1} times')}"


def _size(rung: Rung) -> str:
    if rung.result is not None and rung.result.verdict.mean.outcome == "fail":
        return signed_percent(rung.error)
    return rung.reason
