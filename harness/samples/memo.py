"""Results in the cache: read back where there are any, else made and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from harness.errors import StoreError

Result = TypeVar("Result")
Warn = Callable[[str], None]


def remembered(folder: Path, last: str, *, load: Callable[[Path], Result], make: Callable[[], Result],
               save: Callable[[Result, Path], None], warn: Warn, loss: str) -> tuple[Result, bool]:
    """The result that `folder` holds, or a new one, then kept there; and whether it was made now.

    `last`: the file that `save` writes last. One that `load` refuses with a StoreError is made again, of which `warn`
    is told in one line that ends in `loss`.
    """
    if (folder / last).exists():
        try:
            return load(folder), False
        except StoreError as error:
            warn(f"{error.args[0].partition(';')[0]}; {loss}")
    result = make()
    save(result, folder)
    return result, True
