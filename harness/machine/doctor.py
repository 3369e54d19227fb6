"""What this machine has and lacks for the harness: one check per need, each with the line that mends it."""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from harness.errors import HarnessError, MachineError
from harness.files import cache_dir, require_writable
from harness.machine.mitsuba_runtime import find_llvm

DISTRIBUTION = "glsl-validation-harness"
LEAST_MEMORY = 3 * 2**30  # bytes: 2 GB for the largest command (DESIGN), and room for the system
# Seconds for a probe to answer; a cold shader or kernel cache needs about two, a loaded machine many more.
_PROBE_TIMEOUT = 120
# The same for each EGL device after OpenGL was tried: one that hangs should not keep the others waiting for long.
_DEVICE_TIMEOUT = 20
_GIB = 2**30
MAX_DEVICES = 16  # of EGL, that are looked for
# Where Linux tells a container's limit: control groups version 2, and version 1.
_MEMORY_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")

_GL_PROBE = """
import json
from harness.gpu.context import device
from harness.gpu.width import verdict
found = device()
judged = verdict() if found.compiles_twice else None
print(json.dumps([found.name, found.version, found.clock == "cpu", f"{found.entry} shaders" if not judged else
                  f"{'compute' if judged.wide else found.entry} shaders ({judged.reason})"]))
"""
# A unit radiance environment seen through every pixel: the mean of the image is exactly 1.
_MITSUBA_PROBE = """
import json, numpy
from harness.machine.mitsuba_runtime import use_reference_variant
mi = use_reference_variant()
scene = mi.load_dict({"type": "scene", "integrator": {"type": "path"}, "emitter": {"type": "constant"},
                      "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4,
                                 "filter": {"type": "box"}, "component_format": "float32"}}})
print(json.dumps([mi.__version__, float(numpy.mean(mi.render(scene, spp=1)))]))
"""


@dataclass(frozen=True)
class Check:
    """One need of the harness. `mend`: the line to type when it is not met. `apt`: Debian packages that meet it.

    `needed` is False for what only makes things slower or tighter.
    """

    name: str
    ok: bool
    detail: str
    mend: str = ""
    apt: tuple[str, ...] = ()
    needed: bool = True


def examine() -> Iterator[Check]:
    """Every check, one after the other; the renderers are tried in processes of their own, which may crash."""
    yield check_python()
    yield check_packages()
    yield check_gl()
    yield check_devices()
    yield check_llvm()
    yield check_mitsuba()
    yield check_cores()
    yield check_memory()
    yield check_cache()


def check_python() -> Check:
    """A Python for which every dependency has a wheel."""
    version = platform.python_version()
    allowed = Requirement(f"python{_metadata()['Requires-Python']}").specifier
    return Check("python", version in allowed, f"{version} ({sys.executable}), allowed {allowed}",
                 mend="make setup, with python3.11, 3.12 or 3.13 on the PATH")


def check_packages() -> Check:
    """Every distribution that this one requires, at a version that it allows."""
    wrong: list[str] = []
    right: list[str] = []
    for line in _metadata().get_all("Requires-Dist", []):
        requirement = Requirement(line)
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{requirement} is not installed")
            continue
        if found in requirement.specifier:
            right.append(f"{requirement.name} {found}")
        else:
            wrong.append(f"{requirement} is needed, {found} is installed")
    return Check("packages", not wrong, ", ".join(wrong or right), mend="make setup")


def check_gl() -> Check:
    """A headless OpenGL 4.3 context through EGL."""
    answer = _probe(_GL_PROBE)
    apt = ("libegl1", "libgl1-mesa-dri")
    if isinstance(answer, str):
        return Check("OpenGL", False, answer.partition("; ")[0], mend=f"apt-get install {' '.join(apt)}", apt=apt)
    renderer, version, _, *told = answer
    return Check("OpenGL", True, "; ".join([f"{renderer}, {version}", *(f"the tracer runs as {way}" for way in told)]))


def check_devices() -> Check:
    """The EGL devices, each tried in a process of its own; the one in use is marked."""
    used = os.environ.get("HARNESS_GL_DEVICE", "").strip() or "0"
    lines: list[str] = []
    good: list[int] = []
    for index in range(MAX_DEVICES):
        answer = _probe(_GL_PROBE, {"HARNESS_GL_DEVICE": str(index)}, timeout=_DEVICE_TIMEOUT)
        if isinstance(answer, str) and "there is no EGL device" in answer:
            break
        told = answer if isinstance(answer, str) else f"{answer[0]} ({'software' if answer[2] else 'hardware'})"
        lines.append(f"{index}: {told}{', used' if str(index) == used else ''}")
        if not isinstance(answer, str):
            good.append(index)
        elif not index:
            break  # without EGL all fail alike
    mend = f"export HARNESS_GL_DEVICE={good[0]}" if good else "as for OpenGL"
    return Check("devices", used in map(str, good), "; ".join(lines), mend=mend, needed=False)


def check_llvm() -> Check:
    """An LLVM that drjit can use."""
    try:
        return Check("LLVM", True, str(find_llvm()))
    except MachineError as error:
        detail, _, mend = str(error).partition("; ")
        return Check("LLVM", False, detail, mend=mend, apt=_apt_for(detail))


def check_mitsuba() -> Check:
    """Mitsuba's LLVM variant compiles and renders an image whose value is known."""
    answer = _probe(_MITSUBA_PROBE)
    if isinstance(answer, str):
        detail, _, mend = answer.partition("; ")
        return Check("Mitsuba", False, detail, mend=mend or "make setup", apt=_apt_for(detail))
    version, value = answer
    return Check("Mitsuba", value == 1.0, f"{version}, llvm_ad_rgb renders {value:g} where 1 is right",
                 mend="make setup")


def check_cores() -> Check:
    """The cores that this process may use; one is enough, slowly."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Check("cores", cores > 1, str(cores), mend="more cores make everything faster", needed=False)


def check_memory() -> Check:
    """The memory that this process may use, a container's limit included."""
    memory = memory_limit()
    return Check("memory", memory >= LEAST_MEMORY,
                 f"{memory / _GIB:.1f} GiB, {LEAST_MEMORY / _GIB:g} GiB or more recommended",
                 mend="close other programs, or render smaller images", needed=False)


def check_cache() -> Check:
    """The folder of cached batches can be written."""
    folder = cache_dir()
    try:
        require_writable(folder / "probe")
    except HarnessError as error:
        return Check("cache", False, str(error), mend="export HARNESS_CACHE=/a/folder/you/may/write")
    return Check("cache", True, str(folder))


def memory_limit() -> int:
    """Bytes of memory: the machine's, or the control group's limit where that is smaller."""
    limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    for name in _MEMORY_LIMITS:
        try:
            limit = min(limit, int(Path(name).read_text()))
        except (OSError, ValueError):  # absent, or "max"
            continue
    return limit


def _apt_for(failure: str) -> tuple[str, ...]:
    return ("libatomic1",) if "libatomic" in failure else ()


def _metadata() -> metadata.PackageMetadata:
    return metadata.metadata(DISTRIBUTION)


def _probe(program: str, environment: Mapping[str, str] | None = None, *,
           timeout: float | None = None) -> list[Any] | str:
    """What `program` prints as JSON, or one line on how it failed: a driver may take the whole process with it.

    `timeout`: seconds that it may take, _PROBE_TIMEOUT where None.
    """
    limit = timeout or _PROBE_TIMEOUT
    try:
        done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True,
                              errors="replace", timeout=limit, stdin=subprocess.DEVNULL,
                              env={**os.environ, **(environment or {})})
    except subprocess.TimeoutExpired:
        return f"no answer within {limit:g} s"
    if done.returncode < 0:
        return f"crashed with signal {-done.returncode}: {_last_line(done.stderr)}"
    if done.returncode > 0:
        return re.sub(r"^[\w.]*(Error|Exception): ", "", _last_line(done.stderr))
    return json.loads(_last_line(done.stdout))


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "no output"
