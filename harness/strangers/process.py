"""A child process that draws a stranger's frames: what it may take is bounded, and its end harms nobody.

Nothing of a stranger is compiled or run in this process. The child has an empty environment (but for what the driver
needs to be found), a temporary folder as its own, no standard input but ours, and a process group that is killed when
it takes too long. One child may draw one shader after the other; after one that was lost there is a new one.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

import harness
from harness.errors import HarnessError, MachineError, ShaderError
from harness.gpu.frames import Moment
from harness.machine.processes import end, last_line
from harness.shader.contract import Contract, Law
from harness.strangers.single import Encoding, Singles

# What of the environment the child keeps: where the driver and its settings are. All else is nobody's business.
KEPT = ("LD_LIBRARY_PATH", "LIBGL_", "MESA_", "GALLIUM_", "LP_", "EGL_", "__EGL_", "__GLX_", "DRI_", "HARNESS_GL_",
        "CUDA_", "NVIDIA_")
ROOT = Path(harness.__file__).resolve().parents[1]
# Seconds until the child can draw: Python, and a driver that may have to be read from a slow disk.
START_SECONDS = 120.0


@dataclass(frozen=True)
class Limits:
    """What a stranger may take.

    `first`: seconds for compiling and for its first frame, in which drivers compile too. Later frames may take `factor`
    times as long as the slowest before, and `least` seconds in any case. They are those of the processor, times
    `threads`; by the clock `patience` times as many pass on a machine that is busy. `memory`: bytes beyond what the
    driver takes.
    """

    first: float = 20.0
    factor: float = 20.0
    least: float = 5.0
    patience: float = 4.0
    memory: int = 4 << 30
    threads: int = os.cpu_count() or 1


@dataclass(frozen=True)
class Lost(Exception):
    """How a child went: by `signal`, or at the end of `seconds`; `said`: its last line."""

    signal: int
    seconds: float
    said: str


class Process:
    """The child, and the contract that it draws; has the methods of `gpu.frames.Frames`. Use as a context."""

    def __init__(self, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self.facts: dict[str, Any] = {}  # of the child's device
        self._child: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._contract: Contract | None = None
        self._size = (0, 0)
        self._slowest = 0.0  # seconds of a frame
        self.spent = 0.0  # of the processor, in the child, by all orders so far
        self._pending = b""

    def __enter__(self) -> Process:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    @property
    def contract(self) -> Contract:
        """What is drawn. ValueError where nothing is open."""
        if self._contract is None:
            raise ValueError("nothing is open")
        return self._contract

    @property
    def pid(self) -> int:
        """The child's process number; ValueError where there is none."""
        if self._child is None:
            raise ValueError("nothing is open")
        return self._child.pid

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self._size

    def open(self, contract: Contract, size: tuple[int, int]) -> Process:
        """Compile a contract, in place of the one before. ShaderError, naming the author's line, where it does not;
        MachineError where there is no GL."""
        self._contract, self._size, self._slowest = contract, size, 0.0
        if self._child is None or self._child.poll() is not None:
            self._start()
        self._ask("open", self.limits.first, contract=self._keep("contract.pickle", contract), size=list(size))
        return self

    def frame(self, moment: Moment) -> None:
        """Draw every pass once. ShaderError for a frame that takes too long, too much memory, or the driver with it."""
        self._timed(1, "frame", moment=[moment.number, moment.count, moment.seconds, moment.seed])

    def read(self, name: str) -> np.ndarray:
        """What a pass left last, (H, W, 4) float32, row 0 as GL has it."""
        self._ask("read", self.limits.first, name=name, to=self._path("read.npy"))
        return self._load("read.npy", (self._size[1], self._size[0], 4))

    def write(self, name: str, pixels: np.ndarray) -> None:
        """Put something else in place of what a pass left last."""
        np.save(self._path("write.npy"), np.ascontiguousarray(pixels, np.float32))
        self._ask("write", self.limits.first, name=name, pixels=self._path("write.npy"))

    def clear(self, value: float = 0.0) -> None:
        """Fill all that was ever left with one number."""
        self._ask("clear", self.limits.first, value=value)

    def singles(self, law: Law, numbers: Sequence[int], *, encoding: Encoding = "", keep: bool = False,
                seconds: float | None = None, count: int | None = None) -> Singles:
        """`single.draw_singles`, in the child."""
        width, height = self._size
        self._timed(len(numbers), "singles", law=self._keep("law.pickle", law), numbers=list(numbers),
                    to=self._path("sum.npy"), stack=self._path("stack.npy") if keep else "",
                    options={"encoding": encoding, "seconds": seconds, "count": count})
        stack = self._load("stack.npy", (len(numbers), height, width, 3)) if keep else None
        total = self._load("sum.npy", (height, width, 4))
        return Singles(total[..., :3], total[..., 3], len(numbers), stack)

    def loop(self, frames: int, first: int | None = None) -> np.ndarray:
        """`single.loop`, in the child: what the author's own loop leaves, (H, W, 4)."""
        self._timed(frames, "loop", frames=frames, first=first, to=self._path("loop.npy"))
        return self._load("loop.npy", (self._size[1], self._size[0], 4))

    def unset(self) -> list[tuple[str, str]]:
        """Variables that the compiler takes for unset: (file:line, name)."""
        found = self._ask("unset", self.limits.first)["found"]
        return [(str(where), str(name)) for where, name in found]

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            end(self._child, grace=0.0)
            for pipe in (self._child.stdin, self._child.stdout):
                if pipe:
                    with contextlib.suppress(BrokenPipeError):  # an order that nobody read is still in it
                        pipe.close()
            self._child = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _start(self) -> None:
        self.close()
        self._folder = tempfile.TemporaryDirectory(prefix="harness-stranger-")
        self._said = open(Path(self._folder.name) / "said.txt", "w+b")  # noqa: SIM115, closed with the folder
        self._pending = b""
        command = [sys.executable, "-P", "-s", "-B", "-m", "harness.strangers.child", str(self.limits.memory)]
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said,
                                       cwd=self._folder.name, env=_environment(self._folder.name),
                                       start_new_session=True)
        try:
            self.facts = self._answer("begin", START_SECONDS)
        except Lost as lost:
            self.close()
            raise MachineError(f"the process that draws strangers' shaders cannot start: {lost.said}; `harness doctor` "
                               "tells what is missing") from None

    def _timed(self, drawn: int, do: str, **arguments: Any) -> dict[str, Any]:
        """An order that draws so many frames: the more time they may take, the longer the slowest took."""
        if self._slowest == 0.0 and drawn > 1:
            self._timed(1, "frame", moment=[self.contract.first_frame, 0, 0.0, 0])
        allowed = drawn * self.limits.factor * self._slowest if self._slowest else self.limits.first
        answer = self._ask(do, max(allowed, self.limits.least) if self._slowest else allowed, **arguments)
        self.spent += answer["cpu"]
        self._slowest = max(self._slowest, answer["took"] / drawn)
        return answer

    def _ask(self, do: str, seconds: float, **arguments: Any) -> dict[str, Any]:
        """An order, and its answer. What went wrong is the shader's own doing."""
        try:
            answer = self._answer(do, seconds, **arguments)
        except Lost as lost:
            self.close()
            raise ShaderError(f"{self._name}: {_how(lost, do, self.limits)}") from None
        if "error" not in answer:
            return answer
        message, kind = str(answer["error"]), answer["kind"]
        if kind == "memory":
            raise ShaderError(f"{self._name}: {_memory(self.limits)}")
        if kind == "driver":
            raise ShaderError(f"{self._name}: the driver refuses it: {message}")
        raise {"shader": ShaderError, "machine": MachineError}.get(kind, HarnessError)(message)

    def _answer(self, do: str, seconds: float, **arguments: Any) -> dict[str, Any]:
        child = self._child
        if child is None or child.stdin is None or child.stdout is None:
            raise ValueError("nothing is open")
        order = {"do": do, "seconds": seconds * self.limits.threads, **arguments}
        try:
            child.stdin.write(json.dumps(order).encode() + b"\n")
            child.stdin.flush()
            line = self._line(child.stdout.fileno(), seconds * self.limits.patience)
        except BrokenPipeError:
            line = b""
        except BaseException:  # Ctrl-C: the child has a session of its own, and would go on
            end(child, grace=0.0)
            raise
        if not line:
            late = child.poll() is None and not _ends_soon(child)
            end(child, grace=0.0)
            raise Lost(0 if late else -(child.returncode or 0), seconds, last_line(self._said))
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _line(self, handle: int, seconds: float) -> bytes:
        """The next line of the child; empty where it ended or took too long."""
        until = time.monotonic() + seconds
        while b"\n" not in self._pending:
            left = until - time.monotonic()
            if left <= 0 or not select.select([handle], [], [], left)[0]:
                return b""
            more = os.read(handle, 1 << 16)
            if not more:
                return b""
            self._pending += more
        line, _, self._pending = self._pending.partition(b"\n")
        return line

    def _path(self, name: str) -> str:
        assert self._folder is not None
        return str(Path(self._folder.name) / name)

    def _keep(self, name: str, value: object) -> str:
        Path(self._path(name)).write_bytes(pickle.dumps(value))
        return self._path(name)

    def _load(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        found: np.ndarray = np.load(self._path(name), allow_pickle=False)
        if found.shape != shape:
            raise ValueError(f"expected {shape}, found {found.shape}")
        return found

    @property
    def _name(self) -> str:
        """The author's file, as messages begin."""
        contract = self.contract
        one = next((one for one in contract.passes if one.name == contract.radiance), contract.passes[0])
        return one.source.files[-1][0] if one.source.files else one.name


def _environment(folder: str) -> dict[str, str]:
    """What the child is told: where our modules are, and where the driver is. Its caches are its folder's."""
    kept = {name: value for name, value in os.environ.items() if name.startswith(KEPT)}
    return {**kept, "PYTHONPATH": str(ROOT), "HOME": folder, "TMPDIR": folder, "LANG": "C.UTF-8",
            "MESA_SHADER_CACHE_DISABLE": "true"}


def _ends_soon(child: subprocess.Popen[bytes]) -> bool:
    """Whether a child that closed its pipe is gone, and not just slow."""
    try:
        child.wait(0.2)
    except subprocess.TimeoutExpired:
        return False
    return True


def _memory(limits: Limits) -> str:
    return (f"takes more than {limits.memory / 2**30:.2g} GiB of memory; look for an array or a literal that is far "
            "too large")


def _how(lost: Lost, do: str, limits: Limits) -> str:
    """What to say of a shader with which its process was lost."""
    what = "compiling it" if do == "open" else "a frame"
    if lost.signal in (0, signal.SIGXCPU):
        return (f"{what} takes longer than {lost.seconds:.3g} s and was ended, as with a loop without end; give each "
                "loop a bound that ends it")
    if lost.signal == signal.SIGXFSZ:
        return "writes a file that is too large, and was ended"
    if lost.signal == signal.SIGABRT and ("bad_alloc" in lost.said or "memory" in lost.said.lower()):
        return _memory(limits)
    if lost.signal < 0:
        return f"{what} ended the process that draws it: {lost.said}"
    name = signal.Signals(lost.signal).name
    return (f"{what} crashes the driver ({name}), often for want of memory or stack; look for recursion, and for "
            "arrays or expressions that are far too large")
