"""What commands print: results on stdout, as text or as one JSON object; logs and progress bars on stderr."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress

    from harness.samples.spent import Spending
    from harness.studies.remaining import Left

_UNWRAPPED = 1000  # columns, more than any line of a table needs

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]

# One bar display a process, which nested tasks share: nested displays overwrite each other.
_running: Progress | None = None


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout, in ASCII whatever the locale; see `to_json` for the types it takes."""
    print(json.dumps(to_json(value), indent=2, allow_nan=False))


def to_json(value: Any) -> Any:
    """`value` as JSON types: dataclasses become objects, arrays lists, paths strings, NaN and infinity null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif hasattr(value, "tolist"):  # numpy arrays and scalars, recognised without importing numpy
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def print_spending(spending: Spending) -> None:
    """On stderr: what a command's elapsed time went to, the most first, and the share outside the renderers."""
    from harness.samples.spent import unwatch

    unwatch()
    rows = spending.table()
    whole = sum(seconds for _, seconds in rows)
    for name, seconds in (*rows, ("elapsed", whole)):
        log(f"time: {seconds:9.2f} s {seconds / whole if whole else 0.0:6.1%}  {name}")
    log(f"time: {spending.outside():.1%} outside the renderers")


def print_rich(renderable: RenderableType) -> None:
    """Print a rich table or text on stdout: fitted to a terminal, unwrapped and without colours to a file or pipe."""
    from rich.console import Console

    console = Console(highlight=False, width=None if sys.stdout.isatty() else _UNWRAPPED)
    with console.capture() as text:  # rich ends the process by itself on a broken pipe; print() lets main() do it
        console.print(renderable)
    for line in text.get().splitlines():
        print(line.rstrip())


def log(message: str) -> None:
    """Print one line on stderr; a running progress bar moves down for it."""
    print(message, file=sys.stderr)


@contextmanager
def progress(total: float | None, description: str) -> Iterator[Callable[[float], None]]:
    """A progress bar on stderr where that is a terminal, and nothing elsewhere; yields the callback `advance(n)`.

    `total` is in the units of n, None where it is not known. Calls may be nested; the bar is gone when the block ends.
    """
    global _running
    if not sys.stderr.isatty():
        yield _ignore
        return
    outermost = _running is None
    if _running is None:
        _running = _new_display()
        _running.start()
    display = _running
    task = display.add_task(description, total=total)
    try:
        yield lambda n: display.advance(task, n)
    finally:
        display.remove_task(task)
        if outermost:
            display.stop()
            _running = None


@contextmanager
def time_left(title: str) -> Iterator[Callable[[Left], None] | None]:
    """A bar on stderr, where that is a terminal, of the time that a whole study has taken and has left; yields what to
    tell of it. Bars of `progress` stand below it."""
    global _running
    if not sys.stderr.isatty() or _running is not None:
        yield None
        return
    _running = display = _new_display()
    began = time.perf_counter()
    display.start()
    task = display.add_task(title, total=None)

    def tell(left: Left) -> None:
        elapsed = time.perf_counter() - began
        display.update(task, completed=elapsed, total=elapsed + left.seconds, description=f"{title}, {left.told}")

    try:
        yield tell
    finally:
        display.stop()
        _running = None


def _ignore(n: float) -> None:
    """`advance` where nobody watches."""


def _new_display() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    return Progress(TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(),
                    TimeRemainingColumn(), console=Console(stderr=True), transient=True,
                    redirect_stdout=False)  # results stay on stdout, whatever stderr is
