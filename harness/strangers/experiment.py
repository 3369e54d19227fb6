"""The experiments on a stranger's shader, in their order: its law, its averaging, its samples, its random numbers.

None of them needs a reference: each holds the shader against itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from harness.gpu.frames import Moment
from harness.samples.estimate import luminance
from harness.shader.contract import Contract
from harness.strangers import lines
from harness.strangers.accumulation import FRAMES, judge_accumulation, radiance_of
from harness.strangers.findings import Accumulation, Finding, Findings
from harness.strangers.law import LawFound, find_law, inner, weight_is_of_the_new, with_weight_of_the_new
from harness.strangers.process import Process
from harness.strangers.seeds import ROUNDING, find_repeats
from harness.strangers.single import Encoding
from harness.strangers.state import state_pixels
from harness.strangers.trials import CERTAIN, MATTERS, Trials, difference

# Frames that random numbers are looked for repeats in.
SEED_FRAMES = 256
# Film that the experiments are drawn on, and the one to hold it against: (width, height).
SIZE = (32, 24)
# A share of samples that are not finite from which on it is a flood.
FLOOD = 0.5
# What the past holds that nobody cleared, and what a clock says that started long ago.
STALE, LATER = 7.0, 1000.25
# Quantile at which samples are clipped; the share of a first frame's pixels that lie outside all later ones.
CLIP, OUTSIDE = 0.95, 0.25
# Films of two sizes see other things at their edges; their means differ by less.
BY_SIZE = 0.15


def experiment(contract: Contract, process: Process, size: tuple[int, int] = SIZE, *,
               thorough: bool = True) -> Findings:
    """All that can be found out of a shader by itself, on a film of `size` (width, height) or the author's own.

    `thorough`: lines of the author's are tried too, and films of another size. ShaderError for a shader that does not
    compile, or whose frames take too much time or memory. The process has the contract open afterwards.
    """
    size = contract.size or size
    process.open(contract, size)
    law = find_law(process)
    if weight_is_of_the_new(law):
        contract = with_weight_of_the_new(contract)
        law = find_law(process.open(contract, size))
    contract = replace(law.contract, law=law.law, samples=_samples(law, contract))
    process.open(contract, size)
    return _Experiments(contract, law, process, size).run(thorough=thorough)


def _samples(law: LawFound, contract: Contract) -> int:
    """Of one frame, where alpha counts them."""
    counts = law.law.kind == "sum" and law.law.count == "alpha"
    return max(1, round(law.alpha_step)) if counts else contract.samples


class _Experiments:
    """The experiments on one shader whose law is known."""

    def __init__(self, contract: Contract, found: LawFound, process: Process, size: tuple[int, int]) -> None:
        self.contract, self.found, self.process, self.size = contract, found, process, size
        self.trials = Trials(contract, found.law, process, size)
        self.law, self.first, self.count = found.law, contract.first_frame, self.trials.count

    def run(self, *, thorough: bool) -> Findings:
        """All of them. What makes later ones pointless ends them."""
        cut = list(self.trials.iterations())
        frames = FRAMES if cut else SEED_FRAMES  # a loop that was cut short takes its time in every frame
        result = self.process.loop(FRAMES)
        alone = self.trials.alone(range(self.first, self.first + FRAMES))
        accumulation = self._accumulation(radiance_of(result, self.law, FRAMES), alone)
        stack = self.trials.alone(range(self.first + 1, self.first + 1 + frames))
        found = [*cut, *self._samples_alone(stack, result)]
        encoding: Encoding = ""
        if not any(one.kind in HOPELESS for one in found):
            found += self._joined(accumulation)
            clock = list(self._clock(stack))
            found += [*self._past(), *self._state(), *clock, *self._first_frame(alone[0], stack), *self._weights(stack)]
            if not any(one.kind == "clock" for one in clock):  # what moves repeats
                found += self._seeds(stack)
            if thorough and not cut:
                found += [*self.trials.unset(stack), *self._sizes(stack, found), *self.trials.precision(stack)]
                tried, encoding = self.trials.lines()
                found += [*tried, *self.trials.samples_a_frame(), *self.trials.random_numbers(stack)]
        self.process.open(self.contract, self.size)
        order = {"fault": 0, "warning": 1, "note": 2}
        return Findings(self.contract, self.found.told, accumulation,
                        tuple(sorted(found, key=lambda one: order[one.severity])), encoding, frames)

    def _accumulation(self, result: np.ndarray, alone: np.ndarray) -> Accumulation:
        verdict = judge_accumulation(result, alone, self.law)
        if self.found.shift:
            return replace(verdict, outcome="fail", told=f"a pixel of the past {self.found.shift}: it is read in "
                           "another place than it was written to")
        return verdict

    def _joined(self, accumulation: Accumulation) -> Iterator[Finding]:
        if self.found.shift:
            yield Finding("past_elsewhere", "fault", "accumulation",
                          f"a pixel of the past {self.found.shift}; read it at its own place: texelFetch(…, "
                          "ivec2(gl_FragCoord.xy), 0)")
        elif accumulation.outcome == "fail" and self.law.kind != "other":
            kind = "blend" if self.law.kind == "blend" else "counts_wrongly"
            yield Finding(kind, "fault", "accumulation", accumulation.told, evidence=(("factor", accumulation.factor),))
        if self.law.kind == "none" and any(channel.reads == "self" for one in self.contract.passes
                                           for channel in one.channels if one.name == self.contract.radiance):
            yield Finding("past_ignored", "fault", "accumulation",
                          "it has a sampler for its past, but what it draws does not depend on it: nothing is averaged")
        if self.law.kind == "other":
            yield Finding("law_unknown", "fault", "accumulation", self.found.told)

    def _samples_alone(self, stack: np.ndarray, result: np.ndarray) -> Iterator[Finding]:
        """Of single frames: are there any, are they finite, is there something in them?"""
        self.process.clear(STALE)
        self.process.frame(Moment.of(self.first, 0))
        drawn = self.process.read(self.contract.radiance)
        untouched = float((drawn == np.float32(STALE)).all(axis=-1).mean())
        broken = float((~np.isfinite(stack).all(axis=-1)).mean())
        if not lines.writes(self.contract) or (untouched == 1.0 and not np.nan_to_num(stack).any()):
            yield Finding("never_writes", "fault", "shader",
                          "it never writes its output: a frame leaves what was there")
            return
        if untouched > 0 and self.law.kind != "sum":
            yield Finding("leaves_pixels", "warning", "shader",
                          f"a frame leaves {untouched:.0%} of the pixels as they were: it discards them, or writes "
                          "nothing there")
        if broken < 1 and not np.nan_to_num(stack).any():
            yield Finding("black", "fault", "estimator", "every pixel of every frame is 0: it shows nothing")
        if broken > FLOOD:
            yield Finding("nan_flood", "fault", "estimator",
                          f"{broken:.0%} of all samples are not finite; look for a division by zero, a root or power "
                          "of a negative number, or normalize(vec3(0))", evidence=(("share", broken),))
        elif broken > 0:
            lost = float((~np.isfinite(result).all(axis=-1)).mean())
            if lost == 0:
                yield Finding("leaves_out", "warning", "estimator",
                              f"{broken:.2%} of all samples are not finite, or not counted; none of them got into the "
                              f"sum of {FRAMES} frames", evidence=(("share", broken),))
                return
            yield Finding("not_finite", "fault", "estimator",
                          f"{broken:.2%} of all samples are not finite, and {lost:.0%} of the pixels after {FRAMES} "
                          "frames: one such sample spoils its pixel for ever", evidence=(("share", broken),))
        if (stack < 0).any():
            share = float((stack < 0).mean())
            yield Finding("negative", "warning", "estimator", f"{share:.2%} of all samples are below zero",
                          evidence=(("share", share),))

    def _past(self) -> Iterator[Finding]:
        """Is the first frame's past read, though nobody cleared it?"""
        drawn = []
        for value in (0.0, STALE):
            self.process.clear(value)
            self.process.frame(Moment.of(self.first, 0))
            drawn.append(self.process.read(self.contract.radiance)[inner(self.size)][:, :3])
        if self.contract.host in STALE_HOSTS and not np.array_equal(drawn[0], drawn[1], equal_nan=True):
            yield Finding("stale_past", "fault", "accumulation",
                          "the first frame reads its past, which in Gratin holds whatever was drawn before; begin anew "
                          f"where the frame's number is {self.first}")

    def _state(self) -> Iterator[Finding]:
        """Pixels that hold something else than radiance."""
        rows, columns = np.nonzero(state_pixels(self.process, self.law))
        if len(rows):
            first = f"({columns[0]}, {rows[0]})"
            which = (f"pixel {first}, counted from the lower left, holds" if len(rows) == 1
                     else f"{len(rows)} pixels, the first of them {first}, hold")
            yield Finding("state", "note", "shader", f"{which} something of its own and no radiance; left out of the "
                          "picture", evidence=(("pixels", float(len(rows))),))

    def _seeds(self, stack: np.ndarray) -> Iterator[Finding]:
        values = luminance(stack)
        for repeat in find_repeats(values):
            kind = {"frames_equal": "ignores_seed"}.get(repeat.kind, f"repeats_{repeat.kind}")
            yield Finding(kind, "note" if repeat.harmless else "fault", "seeds", repeat.told,
                          evidence=(("correlation", repeat.size), ("standard errors", repeat.certain)))
        if float(np.nan_to_num(np.ptp(values, axis=0)).max()) == 0 and not find_repeats(values):
            yield Finding("no_noise", "note", "seeds", "frames do not differ, and pixels neither: there is no noise")

    def _weights(self, stack: np.ndarray) -> Iterator[Finding]:
        """A mean gives the new frame what it takes from the past: the samples of early frames are as bright as of
        later ones."""
        if self.law.kind != "mean":
            return
        values = np.nan_to_num(luminance(stack))
        # Rare bright samples, which may be in a few frames or in none of them, are cut off.
        each = np.minimum(values, np.quantile(values[len(values) // 2:], CLIP, axis=0)).mean(axis=(1, 2))
        early, late = each[:3], each[len(each) // 2:]
        error = float(late.std(ddof=1)) * np.sqrt(1 / len(early) + 1 / len(late))
        away = float(early.mean() - late.mean())
        if abs(away) > max(CERTAIN * error, MATTERS * abs(float(late.mean()))):
            yield Finding("weights_unequal", "fault", "accumulation",
                          f"the weight of the new frame is not what the past leaves: its first frames come out "
                          f"{early.mean() / late.mean():.3g} times as bright as later ones",
                          evidence=(("ratio", float(early.mean() / late.mean())),))

    def _first_frame(self, first: np.ndarray, stack: np.ndarray) -> Iterator[Finding]:
        """Is the first frame like the others? Of a right one, one pixel in some hundred is beyond all later ones."""
        values, begun = np.nan_to_num(luminance(stack)), np.nan_to_num(luminance(first))
        room = 1e-4 * np.abs(values).max()
        noisy = np.ptp(values, axis=0) > room
        beyond = (begun > values.max(axis=0) + room) | (begun < values.min(axis=0) - room)
        share = float(beyond.mean())
        if self.law.kind in ("sum", "mean") and noisy.any() and share > OUTSIDE and not self._thrown_away():
            yield Finding("first_frame", "fault", "accumulation",
                          f"the first frame is none like the others: {share:.0%} of its pixels lie outside all that "
                          "later frames have there, so the past that it begins from is not empty",
                          evidence=(("share", share),))

    def _thrown_away(self) -> bool:
        """Whether the first frame does not count anyway."""
        return bool(self.law.measured) and self.law.measured[0][1] < 1e-3

    def _clock(self, stack: np.ndarray) -> Iterator[Finding]:
        """Does the clock change the samples, or even the picture?"""
        numbers = range(self.first + 1, self.first + 1 + SEED_FRAMES // 4)
        frozen = self.process.singles(self.law, numbers, keep=True, seconds=LATER, count=self.count).stack
        assert frozen is not None
        then = stack[:len(frozen)]
        if np.array_equal(frozen, then, equal_nan=True):
            return
        if _equal_frames(frozen) and not _equal_frames(then):
            yield Finding("seeds_by_clock", "note", "seeds",
                          "the random numbers come from the clock alone: frames at the same time are the same")
            return
        if away := difference(frozen, then):
            yield Finding("clock", "fault", "estimator", f"the picture itself changes with the clock ({away}): frames "
                          "of different times cannot be averaged")

    def _sizes(self, stack: np.ndarray, found: Sequence[Finding]) -> Iterator[Finding]:
        """Is the picture the same on a larger film? Of noise that repeats nobody can tell."""
        if self.contract.size or any(one.kind in ("ignores_seed", "clock", "repeats_period") for one in found):
            return
        larger = (2 * self.size[0], 2 * self.size[1])
        self.process.open(self.contract, larger)
        other = self.trials.alone(range(self.first + 1, self.first + 1 + SEED_FRAMES // 4))
        self.process.open(self.contract, self.size)
        quarters = other.reshape(len(other), self.size[1], 2, self.size[0], 2, 3).mean(axis=(2, 4))
        if away := difference(quarters, stack[:len(other)], matters=BY_SIZE):
            yield Finding("resolution", "fault", "estimator", f"the picture is another on a film of {larger[0]} x "
                          f"{larger[1]} pixels ({away}): a size is written into the shader")


# What leaves nothing to look at.
HOPELESS = ("never_writes", "black", "nan_flood")
# Hosts whose ping-pong buffers nobody clears: Gratin's first frame reads what was there.
STALE_HOSTS = ("gratin", "body", "native")


def _equal_frames(stack: np.ndarray) -> bool:
    values = np.nan_to_num(stack)
    return bool((np.ptp(values, axis=0) <= ROUNDING * (np.abs(values).max(axis=0) + 1e-30)).all())
