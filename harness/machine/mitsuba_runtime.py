"""Finds an LLVM that drjit can use, and only then imports Mitsuba: drjit would abort the process on an old one."""

from __future__ import annotations

import ctypes
import functools
import importlib
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from types import ModuleType

from harness.errors import MachineError
from harness.machine.llvm_beside import LLVM_VARIABLE, OLDEST_LLVM, library_beside
from harness.samples.spent import spent

LLVM_WHEEL = "karellen-llvm-core"
REFERENCE_VARIANT = "llvm_ad_rgb"
# Where Debian, Fedora, Arch, and LLVM's own packages put the library.
_SYSTEM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib",
    "/usr/lib/llvm-*/lib", "/usr/lib64/llvm*/lib*", "/opt/homebrew/opt/llvm/lib",
)
_LLVM_MEND = (f"run `make setup`, or `apt-get install libllvm19`, "
              f"or point {LLVM_VARIABLE} at LLVM {OLDEST_LLVM} or newer")


@dataclass(frozen=True)
class LLVM:
    """An LLVM shared library that drjit can use. `origin` says who chose it: the user, the wheel or the system."""

    path: Path
    version: tuple[int, int, int]
    origin: str

    def __str__(self) -> str:
        return f"{'.'.join(map(str, self.version))} ({self.path}, {self.origin})"


def find_llvm() -> LLVM:
    """The LLVM for drjit: the user's DRJIT_LIBLLVM_PATH, else the wheel's, else the newest system one.

    MachineError when the user's path is unusable (it is never silently replaced), or when none is new enough.
    """
    chosen = os.environ.get(LLVM_VARIABLE)
    if chosen and chosen != library_beside():  # that one the harness set itself when it was imported
        return _users_llvm(Path(chosen))
    unusable: list[str] = []
    for path, origin in [*_wheel_libraries(), *_system_libraries()]:
        try:
            version = llvm_version(path)
        except OSError as error:
            if "libatomic" in str(error):  # the wheel's LLVM needs it, as drjit does
                raise MachineError(_explain(error)) from None
            unusable.append(f"{path} ({error})")
            continue
        if version and version[0] >= OLDEST_LLVM:
            return LLVM(path, version, origin)
        unusable.append(f"{path} (too old)")
    found = f"only {', '.join(unusable)}" if unusable else "none"
    raise MachineError(f"drjit needs LLVM {OLDEST_LLVM} or newer, found {found}; {_LLVM_MEND}")


def llvm_version(path: Path) -> tuple[int, int, int] | None:
    """Version of an LLVM shared library; None before LLVM 16, which has no LLVMGetVersion. OSError: not a library."""
    library = ctypes.CDLL(str(path))
    if not hasattr(library, "LLVMGetVersion"):
        return None
    numbers = [ctypes.c_uint() for _ in range(3)]
    library.LLVMGetVersion(*map(ctypes.byref, numbers))
    major, minor, patch = (number.value for number in numbers)
    return major, minor, patch


@functools.cache
@spent("packages")
def import_mitsuba() -> ModuleType:
    """Mitsuba, imported with a usable LLVM; no variant is set.

    `mitsuba.scalar_rgb` is loaded as well: the properties of parsed scenes can then be read in any variant or none.
    MachineError when LLVM, libatomic or Mitsuba itself is missing.
    """
    if "drjit" not in sys.modules:
        os.environ[LLVM_VARIABLE] = str(find_llvm().path)
    try:
        mitsuba = importlib.import_module("mitsuba")
        importlib.import_module("mitsuba.scalar_rgb")
    except ImportError as error:
        raise MachineError(_explain(error)) from error
    # Warnings would go to stdout, among results; what matters of them the harness checks and says by itself.
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba


def use_reference_variant(variant: str = REFERENCE_VARIANT) -> ModuleType:
    """Mitsuba with `llvm_ad_rgb`, or another variant, set; MachineError when drjit has no usable LLVM.

    The version is asked of drjit again: a program that imported drjit before the harness chose its own LLVM.
    """
    mitsuba = import_mitsuba()
    try:
        mitsuba.set_variant(variant)
        version = importlib.import_module("drjit").detail.llvm_version()
    except ImportError as error:
        raise MachineError(_explain(error)) from error
    if version[0] < OLDEST_LLVM:
        raise MachineError(f"drjit runs on LLVM {version[0]}, which is older than {OLDEST_LLVM}, and keeps what it "
                           "found when it was imported; import harness before drjit and mitsuba, or start Python with "
                           f"{LLVM_VARIABLE}={find_llvm().path} in its environment")
    return mitsuba


def _users_llvm(path: Path) -> LLVM:
    try:
        version = llvm_version(path)
    except OSError as error:
        if "libatomic" in str(error):
            raise MachineError(_explain(error)) from None
        raise MachineError(f"{LLVM_VARIABLE}={path} cannot be loaded ({error}); correct or unset it") from None
    if version is None or version[0] < OLDEST_LLVM:
        found = "older than LLVM 16" if version is None else f"LLVM {version[0]}"
        raise MachineError(f"{LLVM_VARIABLE}={path} is {found}, drjit needs {OLDEST_LLVM} or newer; "
                           "point it at a newer one or unset it")
    return LLVM(path, version, LLVM_VARIABLE)


def _wheel_libraries() -> Iterator[tuple[Path, str]]:
    """The wheel's libLLVM: by its own list of files, so that it is found in any kind of environment."""
    try:
        distribution = metadata.distribution(LLVM_WHEEL)
    except metadata.PackageNotFoundError:
        return
    for file in distribution.files or ():
        if re.fullmatch(r"libLLVM\.so\.\d+\.\d+|libLLVM\.dylib", file.name):
            yield Path(str(distribution.locate_file(file))).resolve(), f"wheel {LLVM_WHEEL}"


def _system_libraries() -> Iterator[tuple[Path, str]]:
    """System libraries, newest first by their names."""
    found: dict[Path, int] = {}
    for folder in _SYSTEM_FOLDERS:
        for path in Path("/").glob(folder.lstrip("/") + "/libLLVM*"):
            match = re.fullmatch(r"libLLVM(?:-(\d+))?(?:\.so|\.dylib)(?:\.(\d+))?(?:\.\d+)*", path.name)
            if match:
                found.setdefault(path.resolve(), int(match[1] or match[2] or 0))
    for path in sorted(found, key=lambda path: -found[path]):
        yield path, "system"


def _explain(error: ImportError | OSError) -> str:
    """One line for the ways in which LLVM and Mitsuba fail to load."""
    reason = str(error).splitlines()[0]
    if "libatomic" in reason:
        return f"drjit and its LLVM need libatomic ({reason}); run `apt-get install libatomic1`"
    if "LLVM" in reason:
        return f"drjit found no usable LLVM; {_LLVM_MEND}"
    return f"Mitsuba cannot be imported ({reason}); run `make setup`"
