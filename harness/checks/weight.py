"""Whether the weights f cos / pdf of a sampler have the mean that f cos integrates to."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from harness.checks.chi2 import COUNT
from harness.checks.finding import LEVEL, Finding, shared_level

# Of float32 weights, where there is no variance at all.
ROUNDING = 2e-5


def weight(draw: Callable[[np.ndarray], np.ndarray], expected: ArrayLike, *, count: int = COUNT, level: float = LEVEL,
           rounding: float = ROUNDING, seed: int = 0, names: Sequence[str] = ()) -> Finding:
    """Judge E[f cos / pdf] against ∫ f cos, as `quadrature` or a closed form has it.

    `draw` takes uniform numbers (N, 2), or draws its own, and returns weights (N,) or, by channel, (N, C); `expected`:
    a number or (C,). It joins sampler and pdf: a pdf that is wrong by a factor, or directions that do not follow it,
    move the mean. `value` and `expected` are those of the channel that is most standard errors off; `p` is its chance,
    which is held against the channel's share of `level`. Weights that are not finite fail. `names`: what the sentence
    calls the channels, in place of their numbers.
    """
    drawn = np.asarray(draw(np.random.default_rng(seed).random((count, 2), dtype=np.float32)), dtype=np.float64)
    weights = drawn.reshape(len(drawn), -1)
    if broken := int((~np.isfinite(weights)).any(axis=1).sum()):
        return Finding("weight", np.nan, float(np.ravel(expected)[0]), False,
                       f"{broken:,} of {len(weights):,} weights are not finite", p=0.0)
    exact = np.broadcast_to(np.asarray(expected, dtype=np.float64), weights.shape[1:])
    mean, error = weights.mean(axis=0), weights.std(axis=0, ddof=1) / np.sqrt(len(weights))
    off = np.maximum(np.abs(mean - exact) - rounding, 0) / np.maximum(error, 1e-300)
    channel = int(off.argmax())
    p = float(2 * special.ndtr(-off[channel]))
    passed = p > shared_level(level, len(off))
    of = f" of {names[channel] if names else f'channel {channel}'}" if len(off) > 1 else ""
    sentence = (f"the mean weight{of} is {mean[channel]:.6g} ± {error[channel]:.2g}, expected {exact[channel]:.6g}, "
                f"p = {p:.2g}")
    return Finding("weight", float(mean[channel]), float(exact[channel]), passed, sentence, p=p)
