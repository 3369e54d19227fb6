"""For the tests of this folder: one child process for all that leave it alive."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from harness.strangers.process import Limits, Process


@pytest.fixture(scope="module")
def process() -> Iterator[Process]:
    """With limits that no test here reaches, on a machine that is busy."""
    with Process(Limits(memory=1 << 30)) as process:
        yield process
