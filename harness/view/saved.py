"""Waits for files to be saved, and does its work again each time: the loop of `harness render --watch`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

from harness.errors import HarnessError, MachineError
from harness.shader.library import SUFFIXES

# What installs the extra `live`, in whichever environment this is.
INSTALL = f"{sys.executable} -m pip install 'watchfiles>=1'"
# Milliseconds of quiet after which a save is told: editors write a file in several steps.
QUIET = 80


class Interrupted(Exception):
    """Work was left, for something that it depends on was saved."""


class Saved:
    """Notes which of `files` are saved while it is open, also by editors that put a new file in the old one's place.

    Of a folder among them every file with a suffix of shaders counts, one that is new there too. MachineError where the
    package watchfiles is missing, or the system watches no more folders.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        try:
            from watchfiles import watch
        except ImportError:
            raise MachineError(f"--watch needs the package watchfiles; type: {INSTALL}") from None
        self._files = {each for file in files for each in (file.absolute(), file.resolve())}
        folders = {file if file.is_dir() else file.parent for file in self._files}
        # The first answer comes at once, when the folders are being watched.
        self._over = threading.Event()
        self._changes = watch(*sorted(folder for folder in folders if folder.is_dir()), watch_filter=None,
                              stop_event=self._over, step=QUIET, rust_timeout=QUIET, yield_on_timeout=True,
                              recursive=False, raise_interrupt=False)
        self._names: set[str] = set()
        self._told, self._ready = threading.Event(), threading.Event()
        self._broken = ""
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Saved:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *raised: object) -> None:
        self._over.set()
        self._thread.join()

    @property
    def any(self) -> bool:
        """Whether one was saved since this was opened."""
        return self._told.is_set()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of those that were."""
        return tuple(sorted(self._names))

    def wait(self) -> None:
        """Until one is saved."""
        self._told.wait()
        if self._broken:
            raise MachineError(self._broken)

    def _listen(self) -> None:
        try:
            for changes in self._changes:
                self._names |= {path.name for _, name in changes if self._counts(path := Path(name))}
                if self._names:
                    self._told.set()
                self._ready.set()
        except OSError as error:
            self._broken = f"the files cannot be watched ({error}); raise fs.inotify.max_user_watches"
            self._told.set()
            self._ready.set()

    def _counts(self, path: Path) -> bool:
        return path in self._files or (path.parent in self._files and path.suffix in SUFFIXES)


def repeat(files: Callable[[], Iterable[Path]], work: Callable[[Callable[[], None]], None],
           tell: Callable[[str], None]) -> None:
    """Do the work, and do it again whenever one of `files` is saved, without end: KeyboardInterrupt ends it.

    `files` is asked anew each time, for a file may name others. `work` is given a function to call now and then, which
    raises `Interrupted` where its result would be stale; it lets that through. A HarnessError is told in one line, and
    a file that mends it is waited for; MachineError is raised.
    """
    while True:
        with Saved(files()) as saved:
            def check(saved: Saved = saved) -> None:
                if saved.any:
                    raise Interrupted

            try:
                work(check)
            except Interrupted:
                pass
            except MachineError:
                raise
            except HarnessError as error:
                tell(f"harness: error: {error}")
            if not saved.any:
                tell("waiting for a file to be saved; Ctrl-C ends")
            saved.wait()
            tell(f"saved: {', '.join(saved.names)}")
