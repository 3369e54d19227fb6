"""Processes that hear Ctrl-C, also where the tests themselves were started as a background job."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

# A shell without job control starts what stands before `&` with SIGINT ignored, as nohup and some CI runners do; the
# processes that it starts inherit that, and Python then leaves it so.
_HEAR = ("import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); "
         "os.execv(sys.argv[1], sys.argv[1:])")


def hearing(command: Sequence[object]) -> list[str]:
    """The command (its program as a path) started such that it hears SIGINT; in the same process, under the same id."""
    return [sys.executable, "-I", "-S", "-c", _HEAR, *map(str, command)]


@contextmanager
def this_process_hearing() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt in this process, as in a terminal, as long as the block lasts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
