"""Batches of one renderer through the store, in its fixed schedule, and what they merge into."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence

import numpy as np

from harness.errors import HarnessError
from harness.estimators.base import Renderer, scene_name
from harness.progress import Advance
from harness.samples.cost import total as total_cost
from harness.samples.estimate import Accumulator, Batch, Estimate
from harness.samples.store import Store, portions, schedule

# Equal batches that a run is cut into at the least, for its variance; see `equal_batches`.
MIN_EQUAL_BATCHES = 8


def batches(renderer: Renderer, samples: int, *, replica: int = 0, store: Store | None = None,
            advance: Advance = lambda n: None, prefixes: bool = True) -> Generator[Batch]:
    """The first `samples` samples per pixel of one replica, batch by batch in the store's fixed schedule.

    What the store already holds is read, the rest rendered and kept, but for the first samples of a long run where
    they are the same when they are drawn again (`samples.store.portions`; `prefixes` as there). HarnessError for fewer
    than one sample.
    """
    if samples < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {samples}")
    identity = dict(renderer.identity)
    told = 0.0

    def tell(n: float) -> None:
        nonlocal told
        told += n
        advance(n)

    for start, count, keep in portions(samples, prefixes=prefixes, repeats=renderer.traits.repeats):
        def render(start: int = start, count: int = count) -> Batch:
            return renderer.render_batch(replica, start, count, tell)

        yield store.get_or_render(identity, replica, start, count, render, keep=keep,
                                  scene=scene_name(renderer)) if store else render()
        if start + count > told:  # it was read, or drawn by a renderer that tells nothing
            tell(start + count - told)


def equal_batches(run: Iterable[Batch], samples: int, *, independent: bool = True) -> Iterator[Batch]:
    """The small batches that a run begins with, merged until all are about equal and there are enough of them; all of
    them into one where they are not `independent` (`Traits.independent_batches`), for nothing can then be told of one
    run's noise from within.

    The variance by batch means is unbiased for unequal batches too, but the smallest batches of a heavy-tailed
    estimator are the noisiest witnesses of its variance, and merging them loses no more than a few degrees of freedom.
    """
    size = min(max(1, samples // MIN_EQUAL_BATCHES), schedule(samples)[-1][1]) if independent else samples
    pending: list[Batch] = []
    for batch in run:
        pending.append(batch)
        if sum(b.samples for b in pending) >= size:
            yield _merged(pending)
            pending = []
    if pending:
        yield _merged(pending)


def render_estimate(renderer: Renderer, samples: int, *, replica: int = 0, store: Store | None = None,
                    advance: Advance = lambda n: None, seen: Callable[[Batch], None] = lambda batch: None) -> Estimate:
    """Mean and variance of `samples` samples per pixel of one replica; the variance is NaN where its batches are not
    independent of each other: it takes replicas, then. `seen` is shown every batch as it comes."""
    accumulator = Accumulator()
    run = _shown(batches(renderer, samples, replica=replica, store=store, advance=advance), seen)
    for batch in equal_batches(run, samples, independent=renderer.traits.independent_batches):
        accumulator.add(batch)
    return accumulator.estimate()


def _shown(run: Iterable[Batch], seen: Callable[[Batch], None]) -> Iterator[Batch]:
    for batch in run:
        seen(batch)
        yield batch


def _merged(parts: Sequence[Batch]) -> Batch:
    if len(parts) == 1:
        return parts[0]
    samples = sum(part.samples for part in parts)
    total = sum(part.mean.astype(np.float64) * part.samples for part in parts)
    return Batch(np.asarray(total / samples), samples, sum(part.rejected for part in parts),
                 total_cost(part.cost for part in parts))
