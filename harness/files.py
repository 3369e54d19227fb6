"""Where files live: data that travels with the package, the cache, and writes that leave all or nothing behind."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

from harness.errors import HarnessError, StoreError

# Writers that die without a chance to clean up leave files of this name behind; readers of a folder ignore them.
PARTIAL_PREFIX = ".partial-"

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parent


def in_checkout() -> bool:
    """True when the package runs from a source checkout, False when from an installed wheel."""
    return (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / "glsl").is_dir()


def data_dir(name: Literal["glsl", "mitsuba_scenes", "reports"]) -> Path:
    """The folder of shaders, scenes or report templates, in a checkout and in an installed wheel alike.

    HarnessError when the installation is incomplete.
    """
    folder = _CHECKOUT / name if in_checkout() else _PACKAGE / "_data" / name
    if not folder.is_dir():
        raise HarnessError(f"{folder}: missing from this installation; install glsl-validation-harness again")
    return folder


def cache_dir() -> Path:
    """Where batches are cached: $HARNESS_CACHE, else reports/out/cache in a checkout, else the user's cache folder.

    The folder need not exist yet.
    """
    chosen = os.environ.get("HARNESS_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    if in_checkout():
        return _CHECKOUT / "reports" / "out" / "cache"
    # XDG Base Directory Specification 0.8: unset or empty means ~/.cache.
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glsl-validation-harness"


@contextmanager
def write_atomically(path: str | Path) -> Iterator[Path]:
    """A path to write to, in the same folder and with the same suffix, that replaces `path` when the block ends well.

    When the block raises, Ctrl-C included, nothing is left behind and an old `path` is untouched. Missing folders
    are made. StoreError when `path` is not a regular file, its folder cannot be written, or the disk is full.
    """
    target = _writable_target(Path(path))
    partial = _partial(target)
    try:
        try:
            yield partial
            os.replace(partial, target)
        except OSError as error:
            if error.filename in (None, str(partial)) or error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise _unwritable(target, error) from error
            raise
    finally:
        _remove(partial)


def create_files(files: Mapping[Path, bytes]) -> None:
    """Write files where there are none: all of them, or none where one is there already. Missing folders are made.

    HarnessError for a path that is taken, StoreError where one cannot be written.
    """
    for path in files:
        if os.path.lexists(path):
            raise HarnessError(f"{path}: is there already and is left as it is; choose another name, or move it away")
    made: list[Path] = []
    try:
        for path, content in files.items():
            target = _writable_target(path)
            try:
                with open(target, "xb") as file:  # which fails where another process was faster
                    made.append(target)
                    file.write(content)
            except OSError as error:
                raise _unwritable(path, error) from error
    except BaseException:
        for path in made:
            _remove(path)
        raise


def require_writable(path: str | Path) -> None:
    """StoreError when `path` could not be written; called before an hour of work rather than after it."""
    target = _writable_target(Path(path))
    probe = _partial(target)
    try:
        probe.touch()
    except OSError as error:
        raise _unwritable(target, error) from error
    finally:
        _remove(probe)


def _partial(target: Path) -> Path:
    return target.with_name(f"{PARTIAL_PREFIX}{os.getpid()}-{secrets.token_hex(4)}{target.suffix}")


def _remove(path: Path) -> None:
    """Remove a file that may not exist, in a folder that may not even be searchable."""
    with suppress(OSError):
        path.unlink()


def _writable_target(path: Path) -> Path:
    """`path` with links followed, its folder made; StoreError when it exists and is not a regular file."""
    target = Path(os.path.realpath(path))
    try:
        if target.exists() and not target.is_file():  # replacing a device such as /dev/null would destroy it
            kind = "a folder" if target.is_dir() else "not a regular file"
            raise StoreError(f"{path}: cannot be written, it is {kind}; name a file")
        target.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        taken = next(folder for folder in target.parents if folder.exists())
        raise StoreError(f"{path}: cannot be written, {taken} is not a folder; choose another place") from error
    except OSError as error:
        raise _unwritable(path, error) from error
    return target


def _unwritable(path: Path, error: OSError) -> StoreError:
    return StoreError(f"{path}: cannot be written ({error.strerror or error}); "
                      "choose another place, or free or unlock this one")
