"""Finds blocks in chapters, for tests of what chapters say."""

from __future__ import annotations

from typing import TypeVar

from harness.report.blocks import Chapter

Kind = TypeVar("Kind")


def blocks(chapter: Chapter, kind: type[Kind]) -> list[Kind]:
    """All blocks of one kind, in order."""
    return [block for block in chapter.blocks if isinstance(block, kind)]
