"""Programs that are run in sessions of their own: how they are ended with all that they started, and what they said."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import suppress
from typing import IO

# How long a program that is told to end may go on before it is killed, in seconds.
GRACE = 2.0
# Characters of what a program said that a message holds.
SAID = 300


def end(process: subprocess.Popen[bytes], grace: float = GRACE) -> None:
    """End a program and all that it started; what does not listen is killed, at once where Ctrl-C is pressed again."""
    try:
        if grace > 0:
            _signal_all(process, signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(grace)
    finally:
        _signal_all(process, signal.SIGKILL)  # its children may be left, whether it listened or not
        with suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)


def last_line(said: IO[bytes]) -> str:
    """The last thing that a program said before it ended."""
    said.seek(0)
    lines = [line.strip() for line in said.read().decode(errors="replace").splitlines()]
    return next((line[:SAID] for line in reversed(lines) if line), "it said nothing")


def _signal_all(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)
