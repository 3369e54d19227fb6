"""How long work tells how far it is: callbacks that know no terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

Advance = Callable[[float], None]
Progress = Callable[[float | None, str], AbstractContextManager[Advance]]


@contextmanager
def quiet(total: float | None, description: str) -> Iterator[Advance]:
    """The progress display that shows nothing."""
    yield lambda n: None
