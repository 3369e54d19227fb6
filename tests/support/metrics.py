"""Two metrics that nobody has: what a new entry of the registry must reach by itself."""

from __future__ import annotations

import numpy as np
import pytest

from harness import metrics
from harness.metrics import Metric

ALONG = Metric("largest_error", lambda test, reference, noise, exposure: float(np.abs(test - reference).max()),
               "largest error", "largest difference of a pixel", unit="radiance", at_prefixes=True)
ONCE = Metric("share_off", lambda test, reference, noise, exposure: float((test != reference).mean()),
              "share off", "part of the values that differ", explanation="It counts each colour.", decimals=2)


def register(patch: pytest.MonkeyPatch) -> None:
    """Both in the registry, until the test ends."""
    patch.setattr(metrics, "METRICS", (*metrics.METRICS, ALONG, ONCE))
