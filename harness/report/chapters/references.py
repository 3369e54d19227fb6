"""The chapter of the works that the report cites, from references.toml."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report.blocks import Chapter, Works
from harness.report.inputs import Inputs
from harness.report.texts import works

PLACE = 80
TITLE, ANCHOR = "References", "references"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, the same for all inputs."""
    yield Chapter(TITLE, ANCHOR, (Works(tuple(works().values())),), follows_on=True)
