"""What was drawn of Mitsuba's image of a scene and kept: read back, and nothing rendered for it."""

from __future__ import annotations

from collections.abc import Iterator

from harness.estimators.mitsuba import Mitsuba
from harness.samples.estimate import Accumulator, Batch, Estimate
from harness.samples.store import LEAD_IN, LONGEST_BATCH, Store, schedule
from harness.scene.file import SceneFile

# Batches of one series that are looked for at most.
MOST = 1 << 12


def stored_reference(scene: SceneFile, store: Store | None) -> Estimate | None:
    """The longest series of Mitsuba's samples that the store holds of a scene at its size, of those that `harness
    reference`, studies and gates leave there; None where it has none. SceneError as `Mitsuba.open`."""
    if store is None:
        return None
    with Mitsuba().open(scene) as renderer:
        identity = dict(renderer.identity)
    best = max((_merged(series) for series in _series(store, identity)), key=lambda found: found.samples)
    return best.estimate() if best.batches else None


def _series(store: Store, identity: dict[str, str]) -> Iterator[list[Batch]]:
    """As `harness reference` leaves them, its first samples perhaps not kept; and as replicas of equal length."""
    one: list[Batch] = []
    for start, count in schedule(LONGEST_BATCH * MOST):
        batch = store.get(identity, 0, start, count)
        if batch is not None:
            one.append(batch)
        elif start + count > LEAD_IN:
            break
    yield one
    length = LONGEST_BATCH
    while length:
        found: list[Batch] = []
        while len(found) < MOST and (batch := store.get(identity, len(found), 0, length)) is not None:
            found.append(batch)
        yield found
        length //= 2


def _merged(batches: list[Batch]) -> Accumulator:
    total = Accumulator()
    for batch in batches:
        total.add(batch)
    return total
