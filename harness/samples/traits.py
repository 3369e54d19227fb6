"""What can be asked of whatever renders batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from harness.samples.estimate import Estimate


@dataclass(frozen=True)
class Traits:
    """What can be asked of a renderer.

    `streams`: 'any' where replicas are independent streams whose samples can be drawn in any order and any portion
    (ours, Mitsuba's); 'runs' where each replica is one whole run with a seed of its own (a command, a folder of
    images); 'one' where there is a single stream, drawn from its beginning (a Shadertoy).
    `independent_batches`: are the batches of one replica independent of each other? Where samples are spread evenly
    (Sobol's sequence) they are not: they agree better than chance would have them, in the mean of all, and what their
    scatter would tell is not its noise. Replicas always are.
    `counts`: does it say how many samples it summed, so that samples which were not finite are known?
    `repeats`: is a batch that is drawn again the same, bit for bit? What is not cannot be left out of the store.
    `replicas`: how many there are, None where there is no end. `spp`: samples per pixel of a replica where the
    renderer fixes it, else None. `fixed`: the whole answer where it is there from the beginning (a closed form, an
    image with its variance), so that nothing is ever drawn.
    """

    streams: Literal["any", "runs", "one"] = "any"
    independent_batches: bool = True
    counts: bool = True
    repeats: bool = True
    replicas: int | None = None
    spp: int | None = None
    fixed: Estimate | None = None
