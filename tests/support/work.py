"""Pieces of work for the tests of executors, in a module that workers can import."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from harness.errors import SceneError


def square(number: int) -> int:
    return number * number


def picky(number: int) -> int:
    if number == 3:
        raise SceneError("three.xml:3: no such scene file")
    return number


def process(number: int) -> tuple[int, str | None]:
    """The process, and what its libraries were told of threads."""
    return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")


def mark() -> None:
    os.environ["HARNESS_TEST_MARK"] = "prepared"


def marked(number: int) -> str | None:
    return os.environ.get("HARNESS_TEST_MARK")


def deadly(number: int) -> int:
    """Ends every worker that meets it."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def warned(trace: str) -> int:
    """The number of this call, counted in a file; in the first and the third the worker is told to end soon."""
    with Path(trace).open("a+", encoding="utf-8") as file:
        file.write("called\n")
        file.seek(0)
        number = len(file.readlines())
    if number in (1, 3):
        os.kill(os.getpid(), signal.SIGUSR2)
    return number


def deadly_once(trace: str) -> str:
    """Ends the first worker that meets it. `trace`: a file that tells whether one has."""
    if trace and not Path(trace).exists():
        Path(trace).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return trace
