"""`python -m harness.strangers.child`: draws a stranger's frames, one order a line, in a process that may be lost.

Orders come as JSON lines on standard input, answers go as JSON lines to standard output, and arrays lie in .npy files.
Nothing of the answers is taken for anything but numbers. What a driver prints goes to standard error.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from harness.errors import HarnessError, MachineError, ShaderError
from harness.gpu.context import describe_gl, device
from harness.gpu.frames import Frames, Moment, iterations_limit, unset_variables
from harness.strangers.single import draw_singles, loop

# Bytes of one file that the process may write: an image, or a stack of them.
FILE_BYTES = 1 << 29
# Handles that it may have open.
HANDLES = 256
KINDS = {ShaderError: "shader", MachineError: "machine"}


class Child:
    """The frames of one contract at a time; each order is a method's name and its arguments."""

    def __init__(self, memory: int) -> None:
        self._memory = memory
        self._frames: Frames | None = None

    def begin(self) -> dict[str, Any]:
        """The device; makes the context, and bounds what may be had from now on."""
        facts: dict[str, Any] = {**describe_gl(), "clock": device().clock, "iterations": iterations_limit()}
        limit_memory(self._memory)
        return facts

    def open(self, contract: str, size: list[int]) -> dict[str, Any]:
        """Compile a contract, in place of the one before."""
        if self._frames is not None:
            self._frames.release()
            self._frames = None
        # A pickle of our own process's, in a folder that nobody else may write to.
        self._frames = Frames(pickle.loads(Path(contract).read_bytes()), (size[0], size[1]))
        return {}

    def frame(self, moment: list[float]) -> dict[str, Any]:
        number, count, seconds, seed = moment
        self.frames.frame(Moment(int(number), int(count), seconds, int(seed)))
        return {}

    def read(self, name: str, to: str) -> dict[str, Any]:
        np.save(to, self.frames.read(name))
        return {}

    def write(self, name: str, pixels: str) -> dict[str, Any]:
        self.frames.write(name, np.load(pixels, allow_pickle=False))
        return {}

    def clear(self, value: float) -> dict[str, Any]:
        self.frames.clear(value)
        return {}

    def singles(self, law: str, to: str, stack: str, numbers: list[int], options: dict[str, Any]) -> dict[str, Any]:
        """See `single.draw_singles`."""
        found = draw_singles(self.frames, pickle.loads(Path(law).read_bytes()), numbers, keep=bool(stack), **options)
        np.save(to, np.concatenate([found.sum, found.counted[..., None]], axis=-1))
        if found.stack is not None:
            np.save(stack, found.stack)
        return {}

    def loop(self, frames: int, first: int | None, to: str) -> dict[str, Any]:
        np.save(to, loop(self.frames, frames, first=first))
        return {}

    def unset(self) -> dict[str, Any]:
        """Variables that the compiler takes for unset in any pass."""
        return {"found": [list(found) for one in self.frames.contract.passes for found in unset_variables(one)]}

    @property
    def frames(self) -> Frames:
        if self._frames is None:
            raise ValueError("nothing is open")
        return self._frames


def limit_memory(more: int) -> None:
    """At most so many bytes more than are taken now: of address space where the device is the CPU; a graphics card's
    driver maps more than it uses, and is bounded in its data alone."""
    software = device().clock == "cpu"
    which, column = (resource.RLIMIT_AS, 0) if software else (resource.RLIMIT_DATA, 5)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[column])
    limit = pages * resource.getpagesize() + more
    resource.setrlimit(which, (limit, limit))


def limit_processor(seconds: float) -> None:
    """At most so many seconds more of the processor, of all threads together."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))


def serve(orders: IO[bytes], answers: IO[bytes], child: Child) -> None:
    """Follow orders until there are no more."""
    for line in orders:
        order = json.loads(line)
        limit_processor(order.pop("seconds"))
        do: Callable[..., dict[str, Any]] = getattr(child, order.pop("do"))
        began, busy = time.perf_counter(), time.process_time()
        try:
            answer = do(**order)
        except HarnessError as error:
            answer = {"error": str(error), "kind": KINDS.get(type(error), "bad")}
        except MemoryError:
            answer = {"error": "memory", "kind": "memory"}
        except Exception as error:
            # A driver's or moderngl's own: whatever it was, the stranger's shader brought it about.
            answer = {"error": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}", "kind": "driver"}
        spent = {"took": time.perf_counter() - began, "cpu": time.process_time() - busy}
        answers.write(json.dumps({**answer, **spent}).encode() + b"\n")
        answers.flush()


def main() -> None:
    """Its argument: how many bytes of memory it may take."""
    for which, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_FSIZE, FILE_BYTES),
                        (resource.RLIMIT_NOFILE, HANDLES)):
        resource.setrlimit(which, (most, most))
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    serve(sys.stdin.buffer, answers, Child(int(sys.argv[1])))


if __name__ == "__main__":
    main()
