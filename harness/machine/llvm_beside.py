"""Points drjit at the LLVM beside this Python as soon as the harness is imported: no more than a look into one folder.

drjit chooses its LLVM when it is imported, for good. A program that imports the harness and then Mitsuba by itself
would get the system's, which may be too old (see `mitsuba_runtime`, which judges what is found).
"""

from __future__ import annotations

import os
import re
import sys

# drjit 1.5 lowers dr.minimum to llvm.minimum, whose X86 selection came with LLVM 17: 15 and 16 abort the process with
# "Cannot select: fminimum" at the first render, 14 is refused by drjit itself; 17, 19 and 23 rendered correctly.
OLDEST_LLVM = 17
LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"
_LIBRARY = re.compile(r"libLLVM\.so\.(\d+)\.\d+|libLLVM\.dylib")


def library_beside() -> str | None:
    """The newest LLVM in the folder `lib` of this Python's environment, where the wheel puts it; None where none is
    new enough by its name."""
    folder = os.path.join(sys.prefix, "lib")
    try:
        found = [match for name in os.listdir(folder) if (match := _LIBRARY.fullmatch(name))]
    except OSError:
        return None
    fit = [match for match in found if match[1] is None or int(match[1]) >= OLDEST_LLVM]
    newest = max(fit, key=lambda match: int(match[1] or 0), default=None)
    return os.path.realpath(os.path.join(folder, newest[0])) if newest else None


def point_drjit_at_it() -> None:
    """Set `LLVM_VARIABLE` unless the user has, or drjit has been imported and chosen already."""
    if not os.environ.get(LLVM_VARIABLE) and "drjit" not in sys.modules and (library := library_beside()):
        os.environ[LLVM_VARIABLE] = library
