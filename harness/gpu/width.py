"""llvmpipe at 512 bits, in processes that only run our own tracer, where this machine's driver is proven to take it.

Compute shaders then do 16 pixels at a time where fragment shaders do 8, with the same bits. But it is no setting that
Mesa stands by: at 512 bits every fragment shader crashes (LLVM 15 and 19). So it is tried in a process of its own,
against the usual width, once for a driver and a processor, and the answer is kept in the cache; where that process
crashes, draws other pixels or is no faster, all stays as it is.

The width is read once, when a process makes its first context, and Mesa's shader cache does not know it: code of one
width is taken for the other's. So a wide process has a folder of its own for that cache. Both are said in the
environment while the context is made, and taken back, so that no child process finds them there.
"""

from __future__ import annotations

import contextlib
import glob
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.files import cache_dir, write_atomically
from harness.gpu.device import ENTRY, USUAL, WIDE, WIDTH, cpu_features
from harness.samples.cost import cpu
from harness.samples.keys import digest

SHADER_CACHE = "MESA_SHADER_CACHE_DIR"
# What the processor must have: LLVM's vectors of 512 bits, and their masks for narrower numbers.
NEEDED = frozenset({"avx512f", "avx512vl", "avx512dq", "avx512bw"})
# How much faster wide vectors must be, for they are no setting that Mesa stands by.
LEAST_GAIN = 1.1
TRIAL_SECONDS = 120
# What a trial draws: a glossy scene, and one with the most of the library in it.
TRIAL_SCENES = ("spheres", "displaced")
DENORMAL = 1e-36  # less light than this is made of denormal numbers, which only rasterising threads flush
TRIAL_SIZE, TRIAL_SAMPLES = (48, 36), 64
_TRIAL = "import json; from harness.gpu.width import trial; print(json.dumps(trial()))"
# Where the parts of Mesa lie that make a driver's version: its drivers, and LLVM.
_DRIVERS = ("/usr/lib*/dri/swrast_dri.so", "/usr/lib/*/dri/swrast_dri.so", "/usr/lib*/libgallium-*.so",
            "/usr/lib/*/libgallium-*.so", "/usr/lib*/libLLVM*.so*", "/usr/lib/*/libLLVM*.so*")


@dataclass(frozen=True)
class Verdict:
    """Whether our tracer runs at 512 bits here, and why, or why not."""

    wide: bool
    reason: str


class _Process:
    """What this process has said and done about its width."""

    asked = False
    decided: Verdict | None = None  # when the first context was made


def ask() -> None:
    """Say that this process draws with our own tracer only: its first context may be a wide one.

    Of no effect once there is a context. What a worker begins with, where that is all that it will do.
    """
    _Process.asked = True


@contextlib.contextmanager
def environment() -> Iterator[None]:
    """The driver's settings of this process, while a context is made."""
    if _Process.decided is None:
        _Process.decided = verdict() if _Process.asked else Verdict(False, "this process draws fragments as well")
    settings = _settings(WIDE) if _Process.decided.wide else {}
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def verdict() -> Verdict:
    """Judge this machine: by what is known of it, by what was kept of a trial, or by a trial."""
    if os.environ.get(WIDTH):
        return Verdict(False, f"{WIDTH} is set, and left alone")
    if os.environ.get(ENTRY, "").strip() == "fragment":
        return Verdict(False, f"{ENTRY}=fragment")
    if missing := NEEDED - cpu_features():
        return Verdict(False, f"the processor has no {sorted(missing)[0]}")
    driver = _driver()
    if not driver:
        return Verdict(False, "no llvmpipe where Linux has it")
    key = digest([driver, cpu(), os.environ.get("HARNESS_GL_DEVICE", "")], 16)
    kept = _kept()
    if key not in kept:
        found = try_widths()
        kept = {**kept, key: [found.wide, found.reason]}
        with contextlib.suppress(HarnessError), write_atomically(_memory()) as partial:
            partial.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    wide, reason = kept[key]
    return Verdict(wide is True, str(reason))


def try_widths() -> Verdict:
    """Draw the same in two processes, one of each width."""
    usual, wide = (_tried(width) for width in (USUAL, WIDE))
    if isinstance(usual, str):
        return Verdict(False, f"at {USUAL} bits: {usual}")
    if isinstance(wide, str):
        return Verdict(False, f"at {WIDE} bits: {wide}")
    if f"{WIDE} bits" not in wide["name"]:
        return Verdict(False, f"the driver does not heed {WIDTH}: {wide['name']}")
    if wide["pixels"] != usual["pixels"]:
        return Verdict(False, f"other pixels at {WIDE} bits")
    gain = usual["seconds"] / max(wide["seconds"], 1e-9)
    if gain < LEAST_GAIN:
        return Verdict(False, f"{gain:.2f} times as fast at {WIDE} bits, at least {LEAST_GAIN:g} is asked for")
    return Verdict(True, f"{gain:.2f} times as fast at {WIDE} bits, same pixels")


def trial() -> dict[str, Any]:
    """What this process's driver draws: its name, a digest of the pixels, and the CPU time that drawing took."""
    from harness.gpu.context import device
    from harness.gpu.renderer import TracerRenderer
    from harness.scene import SceneFile, load

    pixels, seconds = [], 0.0
    for name in TRIAL_SCENES:
        renderer = TracerRenderer(load(SceneFile.bundled(name, TRIAL_SIZE)), "mixture")
        mean = renderer.render_batch(0, 0, TRIAL_SAMPLES).mean  # and the driver compiles
        pixels.append(digest(np.where(mean < DENORMAL, np.float32(0), mean)))
        began = time.process_time()
        renderer.render_batch(1, 0, TRIAL_SAMPLES)
        seconds += time.process_time() - began
        renderer.release()
    return {"name": device().name, "pixels": pixels, "seconds": seconds}


def _tried(width: str) -> dict[str, Any] | str:
    """What a trial found in a process of that width, or how it ended."""
    chosen = {ENTRY: "compute" if width == WIDE else "fragment"}
    try:
        done = subprocess.run([sys.executable, "-P", "-c", _TRIAL], capture_output=True, text=True, errors="replace",
                              timeout=TRIAL_SECONDS, stdin=subprocess.DEVNULL,
                              env={**os.environ, **_settings(width), **chosen})
    except subprocess.TimeoutExpired:
        return f"no answer within {TRIAL_SECONDS:g} s"
    if done.returncode < 0:
        return f"crashed with {signal.Signals(-done.returncode).name}"
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["failed without a word"])[-1]
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        return "no answer"
    return found


def _settings(width: str) -> Mapping[str, str]:
    return {WIDTH: width, SHADER_CACHE: str(cache_dir() / f"llvmpipe-{width}")}


def _memory() -> Path:
    return cache_dir() / "llvmpipe-width.json"


def _kept() -> dict[str, Any]:
    """Earlier verdicts by key; none where the file is missing or is not one of ours."""
    try:
        kept = json.loads(_memory().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    pairs = kept.items() if isinstance(kept, dict) else ()
    return {key: value for key, value in pairs if isinstance(value, list) and len(value) == 2}


def _driver() -> list[list[Any]]:
    """The files of Mesa and LLVM with their sizes and times: what makes a version, without a context."""
    own = [f"{folder}/swrast_dri.so" for folder in os.environ.get("LIBGL_DRIVERS_PATH", "").split(":") if folder]
    found = sorted({path for pattern in (*own, *_DRIVERS) for path in glob.glob(pattern)})
    return [[path, os.stat(path).st_size, os.stat(path).st_mtime_ns] for path in found]
