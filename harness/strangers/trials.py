"""Trials of an author's text: something in it is changed, and what that does to the picture tells what it does there.

Each leaves the process with the author's own text open.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.errors import ShaderError
from harness.gpu.frames import Moment
from harness.samples.estimate import luminance
from harness.shader.contract import Contract, Law
from harness.strangers import counts, generator, lines
from harness.strangers.findings import Finding
from harness.strangers.process import Process
from harness.strangers.single import Encoding

# Frames that are compared with and without a line of the author's, and where the pictures' noise has to be small.
TRIAL_FRAMES, MANY_FRAMES = 4, 64
# Means that must agree: standard errors, and part of the mean.
CERTAIN, MATTERS = 8.0, 0.02
# Seconds of the processor beyond which no larger number of samples is tried.
SLOW = 4.0


class Trials:
    """The trials of one shader whose law is known, on a film of `size` (width, height)."""

    def __init__(self, contract: Contract, law: Law, process: Process, size: tuple[int, int]) -> None:
        self.contract, self.law, self.process, self.size = contract, law, process, size
        self.first = contract.first_frame
        # A host that gives the weight can give each frame the whole of it.
        self.count = 0 if law.count == "uniform" else None

    def alone(self, numbers: range) -> np.ndarray:
        """Samples of single frames of what is open, (F, H, W, 3)."""
        stack = self.process.singles(self.law, numbers, keep=True, count=self.count).stack
        assert stack is not None
        return stack

    def unset(self, stack: np.ndarray) -> Iterator[Finding]:
        """Is it another picture where every variable starts at zero?"""
        try:
            self.process.open(lines.with_zeros(self.contract), self.size)
            numbers = range(self.first + 1, self.first + 1 + TRIAL_FRAMES)
            zeroed = self.alone(numbers)
        except ShaderError:  # a text that cannot be changed so
            self.process.open(self.contract, self.size)
            return
        self.process.open(self.contract, self.size)
        share = float((~np.isclose(zeroed, stack[:TRIAL_FRAMES], rtol=1e-3, atol=1e-6, equal_nan=True)).mean())
        if share > 0:
            warned = self.process.unset()
            where, name = warned[0] if warned else ("", "")
            which = f"'{name}'" if name else "some variable"
            yield Finding("unset_variable", "fault", "shader",
                          f"{which} is read before it has a value: with all variables at zero {share:.1%} of the "
                          "samples are others, and every driver has its own", where, (("share", share),))

    def precision(self, stack: np.ndarray) -> Iterator[Finding]:
        """Is it another picture where `mediump` has 16 bits?"""
        lower = lines.with_own_precision(self.contract)
        if lower is None:
            return
        try:
            self.process.open(lower, self.size)
            other = self.alone(range(self.first + 1, self.first + 1 + MANY_FRAMES))
        except ShaderError:  # a type that has no such precision
            self.process.open(self.contract, self.size)
            return
        self.process.open(self.contract, self.size)
        away = difference(other, stack[:len(other)])
        if away:
            yield Finding("precision", "warning", "shader", f"its mediump is computed in 32 bits here, as browsers on "
                          f"desktop machines do; in 16 bits, as on phones, it is another picture ({away}): write "
                          "precision highp float; precision highp int;")
        else:
            yield Finding("precision_same", "note", "shader",
                          "its mediump is computed in 32 bits here; in 16, as on phones, it is the same picture")

    def samples_a_frame(self) -> Iterator[Finding]:
        """Does the picture depend on how many samples a frame has?"""
        slowest, where = 0.0, ""
        stacks: list[np.ndarray] = []
        tried: list[int] = []
        for trial in counts.varied(self.contract):
            if slowest * trial.samples / (tried[-1] if tried else 1) * counts.FRAMES > SLOW:
                break
            before = self.process.spent
            try:
                self.process.open(trial.contract, self.size)
                stacks.append(self.alone(range(self.first + 1, self.first + 1 + counts.FRAMES)))
            except ShaderError:  # an array of that size, perhaps
                break
            slowest = (self.process.spent - before) / counts.FRAMES
            tried.append(trial.samples)
            where = trial.where
        self.process.open(self.contract, self.size)
        if len(tried) < 2:
            return
        read = counts.read_counts(tried, stacks)
        if not read.linear:
            yield Finding("samples_a_frame", "fault", "estimator",
                          f"its mean depends on the samples of a frame ({read.told}): something that is not linear is "
                          "done to them before frames are averaged, such as a clamp, an encoding or a tone curve",
                          where)
            return
        if read.worth < counts.WORTH * tried[-1]:
            yield Finding("samples_shared", "warning", "seeds", f"{tried[-1]} samples a frame have the noise of "
                          f"{max(read.worth, 1.0):.2g}: they share random numbers, such as the place in the pixel",
                          where)
        listed = f"{', '.join(map(str, tried[:-1]))} and {tried[-1]} samples a frame"
        yield Finding("samples_agree", "note", "estimator",
                      f"{listed} give one mean" if not read.summed else f"{listed}: a frame is the sum of its samples")

    def random_numbers(self, stack: np.ndarray) -> Iterator[Finding]:
        """Does the picture depend on whose random numbers it is drawn with?"""
        other = generator.with_other_numbers(self.contract)
        if other is None:
            return
        try:
            self.process.open(other[0], self.size)
            drawn = self.alone(range(self.first + 1, self.first + 1 + MANY_FRAMES))
        except ShaderError:  # a text that cannot be changed so
            return
        finally:
            self.process.open(self.contract, self.size)
        if away := difference(stack[:len(drawn)], drawn):
            yield Finding("generator", "warning", "seeds",
                          f"with PCG's random numbers in place of its own the picture is another ({away}): its own "
                          "repeat within a path, or are bound to each other", other[1])

    def iterations(self) -> Iterator[Finding]:
        """Has the driver cut a loop short, in silence?"""
        wrapped = lines.with_sentinel(self.contract) if self.process.facts.get("iterations") else None
        if wrapped is None:
            return
        try:
            self.process.open(wrapped, self.size)
        except ShaderError:  # a text that cannot be wrapped
            return
        self.process.frame(Moment.of(self.first + 1, 1))
        counted = self.process.read(self.contract.radiance)[..., 0]
        self.process.open(self.contract, self.size)
        cut = float(((counted >= 0) & (counted < lines.SENTINEL)).mean())
        if cut > 0:
            where = lines.loops(self.contract)
            yield Finding("loop_cut", "fault", "shader",
                          f"a loop runs so long in {cut:.0%} of the pixels that the driver leaves it after "
                          f"{self.process.facts['iterations']} iterations, without a word: give it a bound",
                          where[0] if where else "", (("share", cut),))

    def lines(self) -> tuple[list[Finding], Encoding]:
        """What single lines of the author's do to the samples."""
        numbers = range(self.first + 1, self.first + 1 + TRIAL_FRAMES)
        usual = self.alone(numbers)
        found: list[Finding] = []
        encoding: Encoding = ""
        for trial in [*list(lines.encodings(self.contract))[:lines.MOST_LINES],
                      *list(lines.clamps(self.contract))[:lines.MOST_LINES]]:
            try:
                self.process.open(trial.contract, self.size)
                without = self.alone(numbers)
            except ShaderError:  # a text that does not compile without it
                continue
            if trial.encoding and lines.is_encoded(usual, without, trial.encoding):
                encoding = trial.encoding
                found.append(Finding("encodes_samples", "fault", "estimator",
                                     f"each frame is encoded before it is averaged (`{trial.line}`): the mean of roots "
                                     "is not the root of the mean; encode when you show it", trial.where))
                break
            if trial.bound and (share := lines.clamped(usual, without, trial.bound)):
                found.append(Finding("clamps_samples", "fault", "estimator",
                                     f"samples are clamped to {trial.bound:g} (`{trial.line}`), {share:.2%} of them: "
                                     "the mean is too dark wherever light is brighter", trial.where,
                                     (("share", share),)))
                break
        return found, encoding


def difference(one: np.ndarray, other: np.ndarray, matters: float = MATTERS) -> str:
    """How the pictures that two stacks of samples, (F, H, W, 3), are of part; empty where they may be one.

    The mean over the image, or what most pixels say: rare bright samples upset sums of squares, no medians.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        means = [np.nan_to_num(luminance(stack)).mean(axis=(1, 2)) for stack in (one, other)]
        error = np.sqrt(sum(float(each.var(ddof=1)) / len(each) for each in means))
        first, second = (float(each.mean()) for each in means)
        size = max(abs(first), abs(second))
        if abs(first - second) > max(CERTAIN * error, matters * size):
            return f"its mean is {first:.4g} instead of {second:.4g}"
        pixels = [np.nan_to_num(luminance(stack)) for stack in (one, other)]
        variance = sum(each.var(axis=0, ddof=1) / len(each) for each in pixels)
        away = np.abs(pixels[0].mean(axis=0) - pixels[1].mean(axis=0))
        parted = float((away > np.maximum(CERTAIN * np.sqrt(variance), matters * size)).mean())
    return f"{parted:.0%} of its pixels are others" if parted > 0.25 else ""
