"""The renderer of what is there from the beginning."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.progress import Advance
from harness.samples.estimate import Batch, Estimate
from harness.samples.traits import Traits


class Exact:
    """Gives the same image whatever is asked; `traits.fixed` is all that there is to know."""

    def __init__(self, estimate: Estimate, identity: Mapping[str, str]) -> None:
        self.identity = identity
        self.traits = Traits(fixed=estimate)
        self._mean = estimate.mean

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """The image, as a batch of `count` samples."""
        return Batch(self._mean.astype(np.float32), count)
