"""The chapter on steps, difficulties and choices; its words are steps.toml."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report.blocks import Chapter
from harness.report.inputs import Inputs
from harness.report.texts import prose

PLACE = 14
TITLE, ANCHOR = "Steps, difficulties and choices", "steps"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, the same for all inputs."""
    yield Chapter(TITLE, ANCHOR, tuple(prose("steps.toml", {})))
