"""What a device asks of those who draw on it, read once from its GL context."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from harness.shader.source import ShaderSource, with_defines

# What Mesa's software rasterisers call themselves; they draw on the CPU, in the process's own threads.
SOFTWARE = ("llvmpipe", "softpipe", "swr")
# Overrides which of a tracer's two shaders is run, "fragment" or "compute".
ENTRY = "HARNESS_GL_ENTRY"
# By which llvmpipe is told how many bits its vectors have, when a process makes its first context. At WIDE it crashes
# in every fragment shader, on Mesa 22 and 25 alike, and runs compute shaders with the bits that they have at USUAL.
WIDTH = "LP_NATIVE_VECTOR_WIDTH"
USUAL, WIDE = "256", "512"


@dataclass(frozen=True)
class Device:
    """A GL device and its ways.

    `clock`: the one that counts for it, the process's CPU time or the time of its timer queries.
    `max_iterations`: how many iterations of all its loops an invocation may make, where the driver has a limit that it
    keeps in silence. `least_rows`: bands of an image any lower would starve it. `compiles_twice`: whether it compiles a
    fragment shader once for tiles that a triangle covers whole and once for its edges, unless blending is on.
    `entry`: which of a tracer's two shaders the device runs faster, fragment or compute. `only_computes`: whether
    fragment shaders crash. `starts_ahead`: whether a path's camera ray is best made beside the path before it (see
    glsl/lib/path.glsl). `looks_up_ahead`: whether bitmaps are best one array, of which a vertex reads its shape's own
    (harness/shader/scene/layers.py).
    """

    name: str
    version: str
    vendor: str
    clock: Literal["cpu", "gpu"]
    max_iterations: int
    least_rows: int
    compiles_twice: bool
    entry: Literal["fragment", "compute"] = "fragment"
    only_computes: bool = False
    starts_ahead: bool = False
    looks_up_ahead: bool = False

    @classmethod
    def of(cls, info: Mapping[str, str], features: frozenset[str] = frozenset()) -> Device:
        """From the strings of a GL context, as moderngl's `info` has them, and the CPU's features."""
        name = info["GL_RENDERER"]
        wide = name.startswith("llvmpipe") and f"{WIDE} bits" in name
        software = name.startswith(SOFTWARE)
        # Past about 65,535 iterations of all loops of one invocation llvmpipe of Mesa 22 leaves the loop without an
        # error and the result is wrong; half of that leaves room for every loop the driver may add. Mesa 25 and
        # hardware have no such limit, but time, which bands and passes keep: the same bound is no hardship there.
        return cls(name, info["GL_VERSION"], info["GL_VENDOR"], "cpu" if software else "gpu",
                   max_iterations=32_768, least_rows=64, compiles_twice=name.startswith("llvmpipe"),
                   # At 256 bits the compute shader was 0 to 16 % faster on one machine and -1 to 2 % on another, so
                   # llvmpipe keeps the entry of the course; GPUs were not measured, and take what hosts take.
                   entry="compute" if wide else "fragment", only_computes=wide,
                   starts_ahead=software and "avx512vl" in features, looks_up_ahead=software)

    def fitted(self, source: ShaderSource) -> ShaderSource:
        """A tracer as this device runs it fastest; its bits are those of the source."""
        defines = {}
        if self.starts_ahead and "STARTS_AHEAD" in source.text:
            defines["STARTS_AHEAD"] = 1
        if self.looks_up_ahead and "#ifndef BITMAPS_AHEAD" in source.text:  # scenes for which it brings something
            defines["BITMAPS_AHEAD"] = 1
        return with_defines(source, defines) if defines else source

    def describe(self) -> dict[str, str]:
        """Renderer, version and vendor strings, for keys and provenance; no width that bits do not depend on."""
        name = self.name.replace(f"{WIDE} bits", f"{USUAL} bits") if self.only_computes else self.name
        return {"gl_renderer": name, "gl_version": self.version, "gl_vendor": self.vendor}


def cpu_features() -> frozenset[str]:
    """What Linux says that this machine's processor can do, by its own names; nothing elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return frozenset()
    return frozenset(next((line.partition(":")[2] for line in lines if line.startswith("flags")), "").split())
