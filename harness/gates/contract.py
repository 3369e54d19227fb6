"""Does what is judged keep the contract: every sample counted, every replica another? Said before errors are."""

from __future__ import annotations

import numpy as np

from harness.gates.model import Gate
from harness.gpu.pingpong import FLUSH_SAMPLES, MAX_SAMPLES_PER_PASS
from harness.stats.bias import signed_percent
from harness.stats.channels import Channel
from harness.stats.verdicts import TileVerdict
from harness.work.run import Run

# What float32 sums of a pass may be off by, relative to the mean.
ROUNDING = 1e-5
# Pixels with noise that make a render one with noise: two replicas are equal in all of them by chance with a
# probability of about e^-32.
NOISY_PIXELS = 32
# How near to 1/n of the reference an image must be to be told that it is that.
NEAR = 0.05


def breach(gate: Gate, run: Run) -> str:
    """What the replicas so far show to be wrong with how samples are drawn or counted; empty where nothing is.

    Its error then tells nothing, nor does its noise: the gate fails with this, whatever the verdict.
    """
    estimate = run.estimate()
    drawn = estimate.samples * estimate.mean.shape[0] * estimate.mean.shape[1]
    if estimate.rejected > gate.not_finite * drawn:
        return _uncounted(estimate.rejected, drawn, run.renderer.traits.counts)
    if run.twins and run.renderer.traits.streams == "any" and _is_noisy(run):
        return _repeated(run)
    return ""


def remark(verdict: TileVerdict, run: Run) -> str:
    """What an image that is off by a known factor probably is; empty for any other error."""
    ratios = 1 + verdict.error[0, 0]
    for samples in sorted({run.spp, *(most for most in (MAX_SAMPLES_PER_PASS, FLUSH_SAMPLES) if most < run.spp)}):
        if samples > 2 and run.renderer.traits.counts and bool((np.abs(ratios * samples - 1) < NEAR).all()):
            return (f"; {signed_percent(verdict.error[0, 0, Channel.LUMINANCE])} is 1/{samples} - 1, as where a mean "
                    "is stored for a sum: pingpong0's rgb is the sum of all samples' radiance, alpha their number")
    return ""


def one_image(run: Run) -> bool:
    """Are all replicas the same pixels?"""
    return run.images == 1


def _uncounted(rejected: int, drawn: int, counts: bool) -> str:
    """What samples that alpha does not count tell: a few were not finite, most or all were never added."""
    found = f"{rejected} of {drawn} samples were not finite"
    look = ("look for a division by zero, a root or power of a negative number, or a random number that is exactly 0 "
            "or 1 (log(u), 1 - u)")
    if not counts:
        return f"{found}; {look}"
    if 2 * rejected > drawn:
        return (f"{found}, or not counted in alpha; to what pingpong0 holds (nothing at numpass 0) each of "
                "samples_per_pass samples must add its radiance, and 1 to alpha: one sample a pass is too few, a mean "
                "or a share is no count")
    return (f"{found}, or not counted in alpha; {look}; where samples are left out on purpose (adaptive sampling, "
            "paths that are given up) each counts in alpha all the same, with the radiance that it has")


def _repeated(run: Run) -> str:
    if run.images == 1:
        which = "all replicas are one image"
    else:
        assert run.twins is not None
        which = (f"replicas {run.twins[0]} and {run.twins[1]} are one image, and of {run.replicas} replicas only "
                 f"{run.images} differ")
    return (f"{which}, which is not without noise: the seed leaves out `replica`, or makes too little of it (a seed "
            "from numpass alone, say), so its error and its noise cannot be told apart; seed from the pixel, `replica` "
            "and first_sample + numpass * samples_per_pass")


def _is_noisy(run: Run) -> bool:
    """Does one sample differ from many by more than rounding, in so many pixels that chance makes no two images equal?

    Many are two passes or more, from the beginning and from further on, for a seed may leave out any part of what
    numbers a sample. A factor between two images is an error of its own kind, see `remark`.
    """
    count = max(run.spp, 2 * MAX_SAMPLES_PER_PASS)
    one = run.renderer.render_batch(0, 0, 1).mean
    return any(_differing(one, run.renderer.render_batch(0, start, count).mean) >= NOISY_PIXELS
               for start in (0, count))


def _differing(one: np.ndarray, other: np.ndarray) -> int:
    """How many pixels differ, but for a factor that all have in common."""
    one, other = one.astype(np.float64), other.astype(np.float64)
    lit = other != 0
    factor = float(np.median(one[lit] / other[lit])) if lit.any() else 1.0
    return int((np.abs(one - factor * other).max(axis=-1) > ROUNDING * np.abs(one).mean()).sum())
