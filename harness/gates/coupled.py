"""What a coupled gate does that others do not: its reference draws the test's own random numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.diagnosis import AutopsyRecord, autopsy
from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.gates.model import Gate, GateResult
from harness.shader.samplers import DEFAULT
from harness.stats.agreement import AgreementVerdict, agreement_verdict
from harness.stats.needed import times
from harness.stats.tiles import TileSamples
from harness.stats.verdicts import GRAVITY

# Images of one sample per pixel whose samples are compared one by one, and the most where these do not decide.
SINGLES, MOST_SINGLES = 4, 32
# How often agreement is looked at, at the most: each look may raise a false alarm.
ROUNDS = (MOST_SINGLES // SINGLES).bit_length()
# Where more samples than this differ, paths do not follow at all: all that scatter differ then, and rays that meet
# nothing but sky never do.
ASTRAY = 0.25


def agreed(gate: Gate, test: Renderer, reference: Renderer) -> AgreementVerdict:
    """Do single samples of both sides agree?

    Drawn are the first samples of the first replicas, until that is decided or `MOST_SINGLES` are there.
    """
    assert gate.agreement is not None, "only coupled gates ask"
    ours: list[np.ndarray] = []
    theirs: list[np.ndarray] = []
    while True:
        for replica in range(len(ours), 2 * len(ours) or SINGLES):
            ours.append(test.render_batch(replica, 0, 1).mean)
            theirs.append(reference.render_batch(replica, 0, 1).mean)
        verdict = agreement_verdict(np.stack(ours), np.stack(theirs), gate.agreement,
                                    fail_level=gate.half_level / ROUNDS, pass_level=gate.pass_level)
        if verdict.outcome != "inconclusive" or len(ours) >= MOST_SINGLES:
            break
    if verdict.share > ASTRAY:
        verdict = replace(verdict, reason=f"{verdict.reason}: paths do not follow, as where the shader draws numbers "
                                          "of its own, or in another order")
    return verdict


def with_agreement(result: GateResult, agreement: AgreementVerdict) -> GateResult:
    """The result of both verdicts: the graver is that of the gate, and where both fail, both are told."""
    outcome = min((result.outcome, agreement.outcome), key=GRAVITY.index)
    told = [reason for its, reason in ((result.outcome, result.reason), (agreement.outcome, agreement.reason))
            if its == outcome]
    return replace(result, outcome=outcome, reason="; ".join(told), agreement=agreement)


def dissected(result: GateResult) -> GateResult:
    """A result with the autopsy of its paths, told in its reason.

    Of a sampler other than the usual one the library's paths are looked at with that: the autopsy knows its numbers.
    """
    test = result.gate.test
    assert isinstance(test, Tracer), "the parser couples nothing else"
    found = autopsy(result.gate.scene, test.strategy, replace(test, sampler=DEFAULT).whole_library())
    told = "" if test.sampler == DEFAULT else f" with the sampler '{DEFAULT}', whose numbers an autopsy knows"
    return replace(result, autopsy=found, reason=f"{result.reason}; {_named(found)}{told}")


def _named(found: AutopsyRecord) -> str:
    """What an autopsy names, in half a sentence."""
    if found.stage is None:
        return f"no stage of {found.paths} paths differs (`harness autopsy --samples` looks at more)"
    place = found.places[0] if found.places else None
    where = f", computed by {place.function}, {place.file}:{place.line}" if place else ""
    return f"the first stage that differs is '{found.stage}'{where}"


def require_budget(gate: Gate, test: TileSamples, reference: TileSamples) -> None:
    """HarnessError where a first look shows that the budget cannot decide, because what no sample of it has shown may
    alone be more than a tolerance."""
    assert gate.paired is not None, "only coupled gates ask"
    factor = gate.paired.too_small(0, test, reference)
    if factor is not None:
        raise gate.error(
            f"a budget of {gate.replicas} replicas of {gate.spp} samples per pixel is too small for its tolerance: a "
            f"sample that has not come yet may hide more; {times(factor)} the samples would do, or wider "
            "tolerances")
