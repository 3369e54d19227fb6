"""The headless GL context (one a thread, EGL) and program compilation with errors in our terms."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Mapping
from typing import Any

import moderngl

from harness.errors import MachineError
from harness.gpu.device import WIDTH, Device, cpu_features
from harness.gpu.width import environment
from harness.shader.source import ShaderSource

# One triangle that covers the viewport; texcoord is (0,0) at the bottom left and (1,1) at the top right.
_VERTEX_SHADER = """#version 420 core
out vec2 texcoord;
void main()
{
    texcoord = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(texcoord * 2.0 - 1.0, 0.0, 1.0);
}
"""
_LINE_PROBE = "#version 420 core\n#line 40 0\nthis is not GLSL\n"
_LINE_PROBE_NUMBER = 40

# Names the EGL device to draw on, by its number.
CHOICE = "HARNESS_GL_DEVICE"

_local = threading.local()


def context() -> moderngl.Context:
    """This thread's headless context, made on first use.

    Raises MachineError where EGL or a driver is missing, and in a forked child of a process that has a context:
    drivers hang there, so start workers with 'spawn' or 'forkserver'.
    """
    owner = getattr(_local, "owner", None)
    if owner is None:
        index = _chosen()
        try:
            options: dict[str, Any] = {"backend": "egl", "libgl": "libEGL.so.1", "device_index": index}
            with environment():
                created = moderngl.create_context(standalone=True, require=430, **options)
        except Exception as error:  # moderngl raises bare Exception
            if missing := re.search(r"requested device index .* found ([1-9]\d*) devices", str(error)):
                raise MachineError(f"{CHOICE}: there is no EGL device {index}; there are {missing[1]}, numbered from "
                                   "0; `harness doctor` lists them") from None
            raise MachineError(
                f"no headless OpenGL 4.3: {' '.join(str(error).split())}; on Debian or Ubuntu type: "
                "apt-get install -y libegl1 libgl1-mesa-dri") from None
        adopt(created)
    elif owner != os.getpid():
        raise MachineError("a forked process cannot use its parent's GL context; start workers with the "
                           "multiprocessing method 'spawn' or 'forkserver'")
    found: moderngl.Context = _local.context
    return found


def adopt(created: moderngl.Context) -> None:
    """Make a context this thread's, in which all is drawn from now on: a window's, say. GL objects of an earlier one
    must not be used any more."""
    _local.device = Device.of(created.info, cpu_features())
    if _local.device.compiles_twice:
        _halve_compilation(created)
    _local.owner, _local.context = os.getpid(), created


def _chosen() -> int:
    """The number of the EGL device to draw on, as the environment has it."""
    text = os.environ.get(CHOICE, "").strip() or "0"
    if not text.isdecimal():
        raise MachineError(f"{CHOICE}: expected the number of an EGL device, found '{text}'; `harness doctor` lists "
                           "them")
    return int(text)


def _halve_compilation(gl: moderngl.Context) -> None:
    """Blend what is drawn, times one, with what was there, times zero: on llvmpipe the same bits in half the time.

    llvmpipe compiles every fragment shader twice: for tiles that a triangle covers whole, and for those at its edges.
    With blending it has no use for the former (Mesa 22.3, generate_variant in lp_state_fs.c). The draw itself takes
    as long (64 samples of `spheres`: 0.050 CPU s against 0.055), its compilation 0.143 s against 0.235.
    """
    gl.enable(moderngl.BLEND)
    gl.blend_func = moderngl.ONE, moderngl.ZERO


def device() -> Device:
    """The device of this thread's context."""
    context()
    found: Device = _local.device
    return found


def describe_gl() -> dict[str, str]:
    """Renderer, version and vendor strings of this thread's context."""
    return device().describe()


def set_uniforms(program: Any, uniforms: Mapping[str, Any]) -> None:
    """Set uniforms of a program of moderngl's; one that the compiler optimised away is left alone."""
    for name, value in uniforms.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            member.value = value


def uniforms_of(program: Any) -> frozenset[str]:
    """Names of the uniforms and blocks that a program depends on; an array or a structure has one name."""
    kinds = moderngl.Uniform, moderngl.UniformBlock, moderngl.StorageBlock
    members = {name: program[name] for name in program}
    return frozenset(re.split(r"[.\[]", name)[0] for name, member in members.items()
                     if isinstance(member, kinds) and not name.startswith("gl_"))


class Program:
    """A fragment shader over the full-screen triangle, drawn into a framebuffer."""

    def __init__(self, source: ShaderSource) -> None:
        """Compile; raises ShaderError naming our file and line."""
        gl = context()
        if device().only_computes:
            raise MachineError(f"{source.files[0][0]}: a fragment shader, and in those {device().name} crashes; unset "
                               f"{WIDTH}")
        try:
            self._program = gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=source.text)
        except moderngl.Error as error:
            raise source.explain(str(error), line_offset(gl)) from None
        self._triangle = gl.vertex_array(self._program, [])

    def set(self, uniforms: Mapping[str, Any]) -> None:
        """Set uniforms; one that the compiler optimised away is left alone."""
        set_uniforms(self._program, uniforms)

    @property
    def uniforms(self) -> frozenset[str]:
        """Names of the uniforms and blocks that the picture depends on; an array or a structure has one name."""
        return uniforms_of(self._program)

    def draw(self) -> None:
        """Draw into the framebuffer in use."""
        self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GL objects."""
        self._triangle.release()
        self._program.release()


def line_offset(gl: moderngl.Context) -> int:
    """What this driver adds to the line that `#line` sets, asked of the driver by a shader that cannot compile."""
    try:
        gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=_LINE_PROBE).release()
    except moderngl.Error as error:
        if found := re.search(rf"\b({_LINE_PROBE_NUMBER}|{_LINE_PROBE_NUMBER + 1})\b", str(error)):
            return int(found[1]) - _LINE_PROBE_NUMBER
    return 0
