"""All exhibits, in the order in which the report shows them."""

from __future__ import annotations

from collections.abc import Callable

from harness.course.numbers import convergence, random_numbers, sine_noise
from harness.course.pictures import below_surface, lobe_pdf, reflect, tangent
from harness.progress import Progress, quiet
from harness.results import Exhibit
from harness.samples.store import Store

# What changes a picture most comes first.
EXHIBITS: tuple[Callable[[Store | None], Exhibit], ...] = (
    lobe_pdf, below_surface, tangent, reflect, random_numbers, sine_noise, convergence)


def measure_exhibits(store: Store | None = None, progress: Progress = quiet) -> tuple[Exhibit, ...]:
    """Every exhibit, measured; about half a minute of CPU time, less what the store holds."""
    found = []
    with progress(len(EXHIBITS), "the handout's errors") as advance:
        for exhibit in EXHIBITS:
            found.append(exhibit(store))
            advance(1)
    return tuple(found)
