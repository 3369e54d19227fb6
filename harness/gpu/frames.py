"""Frames of somebody's shader: the passes of a contract, drawn one after the other, each fed with what it reads.

What a pass leaves is RGBA32F. A pass that reads itself has what it left in the last frame, one that reads another what
that left last, in this frame or, where it is drawn later, in the last. To be used in a child process only (see
harness/strangers): nobody knows what a stranger's shader does to a driver.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from harness.errors import ShaderError
from harness.gpu.context import Program, context, line_offset
from harness.gpu.stand_ins import StandIns
from harness.shader.contract import Channel, Contract, Role, ShaderPass
from harness.shader.source import LINE_STRIDE, ShaderSource

# A steady clock: frames of a second.
FRAME_RATE = 60.0
# What every host says the date is: year, month, day and seconds. It must not change from one run to the next.
DATE = (2024.0, 1.0, 1.0, 43200.0)
# GL's numbers of the types of uniforms that name an image (OpenGL 4.6, table 7.3): images cannot be bound.
_SAMPLERS = {0x8B5E: "sampler2D", 0x8B60: "samplerCube", 0x8B5F: "sampler3D"}
_IMAGES = range(0x904C, 0x906D)
_INTEGERS = "iI"
# Characters of a compiler's message, and of the line that it is about, that are shown.
MOST = 200
_ERROR = re.compile(r"error: (.*)")
# What no text compiles with, and still is read to its end.
_UNDECLARED = "\nvoid harness_fails_() { harness_undeclared_ = 1.0; }\n"
# A float counts so far to the bit, and no compiler sees through its sum.
_MOST_ITERATIONS = 1 << 20
_COUNTING = """#version 420 core
uniform int most;
out vec4 counted;
void main()
{
    float iterations = 0.0;
    for (int i = 0; i < most; ++i)
        iterations += 1.0;
    counted = vec4(iterations);
}
"""
_UNSET = re.compile(r"^\d+:(\d+)\(\d+\): warning: `(\w+)' used uninitialized", re.MULTILINE)


@dataclass(frozen=True)
class Moment:
    """When a frame is drawn: its `number` as the shader is told, `count` frames in the past, `seconds` since the start,
    and the `seed` of the numbers that the host draws."""

    number: int
    count: int
    seconds: float
    seed: int = 0

    @classmethod
    def of(cls, number: int, count: int) -> Moment:
        """On a steady clock, which starts with frame 0."""
        return cls(number, count, number / FRAME_RATE, number)


class Frames:
    """A contract's programs and textures, at a size of (width, height) pixels.

    ShaderError, naming the author's file and line, for a pass that does not compile, and for one that needs data which
    only its own program has (storage buffers, uniform blocks, images).
    """

    def __init__(self, contract: Contract, size: tuple[int, int]) -> None:
        self.contract, self.size = contract, size
        self._gl = context()
        self._stand_ins = StandIns(self._gl)
        self._programs: dict[str, _Program] = {}
        self._targets: dict[str, list[Any]] = {}
        try:
            for one in contract.passes:
                self._programs[one.name] = _Program(self._gl, one)
                self._targets[one.name] = [self._texture() for _ in range(2)]
        except BaseException:
            self.release()
            raise
        self.clear()

    def frame(self, moment: Moment, *, displays: bool = False) -> None:
        """Draw every pass once, in the contract's order; those that only display where they are asked for."""
        rng = np.random.default_rng(moment.seed)
        for one in self.contract.passes:
            if one.displays and not displays:
                continue
            program = self._programs[one.name]
            old, new = self._targets[one.name]
            framebuffer = self._gl.framebuffer([new])
            framebuffer.use()
            self._gl.viewport = (0, 0, *self.size)
            self._bind(one, program)
            for name, value in self.contract.values:
                program.set(name, value)
            for name, role in one.roles:
                member = program.uniforms.get(name)
                if member is not None:
                    program.set(name, self._value(role, member, moment, rng))
            program.draw()
            framebuffer.release()
            self._targets[one.name] = [new, old]
        self._gl.finish()

    def read(self, name: str) -> np.ndarray:
        """What a pass left last, (H, W, 4) float32, row 0 as GL has it."""
        pixels = np.frombuffer(self._targets[name][0].read(), np.float32)
        return pixels.reshape(self.size[1], self.size[0], 4).copy()

    def write(self, name: str, pixels: np.ndarray) -> None:
        """Put something else, (H, W, 4), in place of what a pass left last."""
        self._targets[name][0].write(np.ascontiguousarray(pixels, np.float32).tobytes())

    def clear(self, value: float = 0.0) -> None:
        """Fill all that was ever left with one number."""
        blank = np.full((self.size[1], self.size[0], 4), value, np.float32).tobytes()
        for pair in self._targets.values():
            for texture in pair:
                texture.write(blank)

    def release(self) -> None:
        """Free the GL objects."""
        for program in self._programs.values():
            program.release()
        for pair in self._targets.values():
            for texture in pair:
                texture.release()
        self._stand_ins.release()

    def _texture(self) -> Any:
        texture = self._gl.texture(self.size, 4, dtype="f4")
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _bind(self, one: ShaderPass, program: _Program) -> None:
        """Every sampler reads what its channel says, and one without a channel nothing: unset, it would read unit 0."""
        channels = {channel.name: channel for channel in one.channels}
        sizes: dict[str, tuple[float, float, float]] = {}
        for unit, (name, kind) in enumerate(program.samplers.items()):
            texture = self._read_by(one, channels.get(name), kind)
            texture.use(unit)
            sizes[name] = (float(texture.size[0]), float(texture.size[-1]), 1.0)
            program.set(name, unit)
        if "iChannelResolution" in program.uniforms:  # Shadertoy's, an array over its channels
            nothing = (float(self.size[0]), float(self.size[1]), 1.0)
            program.set("iChannelResolution", tuple(sizes.get(f"iChannel{k}", nothing) for k in range(4)))

    def _read_by(self, one: ShaderPass, channel: Channel | None, kind: str) -> Any:
        if channel is None:
            return self._stand_ins.of("black", kind)
        name = one.name if channel.reads == "self" else channel.reads.removeprefix("pass:")
        if channel.reads == "self" or channel.reads.startswith("pass:"):
            if name not in self._targets:
                raise ShaderError(f"pass '{one.name}': '{channel.name}' reads '{name}', and there is no such pass; "
                                  f"allowed: {', '.join(self._targets)}")
            texture = self._targets[name][0]
        else:
            texture = self._stand_ins.of(channel.reads, kind)
        smooth = moderngl.LINEAR if channel.linear else moderngl.NEAREST
        texture.filter = smooth, smooth
        if kind == "sampler2D":
            texture.repeat_x = texture.repeat_y = channel.repeat
        return texture

    def _value(self, role: Role, member: Any, moment: Moment, rng: np.random.Generator) -> Any:
        """What a uniform of this role is told, in as many numbers as it has."""
        width, height = self.size
        n, numbers = moment.count, member.dimension
        match role:
            case "frame":
                value: Any = moment.number
            case "count":
                value = n + 1
            case "past_weight":
                value = n / (n + 1)
            case "new_weight":
                value = 1 / (n + 1)
            case "time":
                value = moment.seconds
            case "time_delta":
                value = 1 / FRAME_RATE
            case "frame_rate":
                value = FRAME_RATE
            case "date":
                value = (*DATE[:3], DATE[3] + moment.seconds)
            case "resolution":
                value = (width, height, 1.0, 1.0)
            case "width" | "height" | "aspect":
                value = {"width": width, "height": height, "aspect": width / height}[role]
            case "mouse":
                value = (0.0, 0.0, 0.0, 0.0)
            case "random":
                whole = member.fmt[-1] in _INTEGERS
                value = tuple(rng.integers(1, 2**31 - 1, numbers) if whole else rng.random(numbers))
        return value


class _Program:
    """A pass's shaders over a triangle that covers the film, with the uniforms and samplers that it has a use for."""

    def __init__(self, gl: moderngl.Context, one: ShaderPass) -> None:
        try:
            self._program = gl.program(vertex_shader=one.vertex, fragment_shader=one.source.text)
        except moderngl.Error as error:
            raise _explained(one, _log(str(error)), line_offset(gl)) from None
        except (UnicodeError, KeyError, ValueError) as error:
            # moderngl reads the compiler's log as UTF-8, and looks for #include by itself
            file = one.source.files[0][0] if one.source.files else one.name
            raise ShaderError(f"{file}: cannot be handed to the compiler: {' '.join(str(error).split())[:200]}; "
                              "write it in ASCII, and include by \"NAME\"") from None
        members: dict[str, Any] = {name: self._program[name] for name in self._program}
        self.uniforms: dict[str, Any] = {
            re.split(r"[.\[]", name)[0] if member.array_length > 1 else name: member
            for name, member in members.items() if isinstance(member, moderngl.Uniform)}
        self.samplers = {name: _SAMPLERS[member.gl_type] for name, member in self.uniforms.items()
                         if member.gl_type in _SAMPLERS}
        try:
            self._require_no_data(one, members)
            self._quad = _quad(gl, self._program, members)
        except BaseException:
            self._program.release()
            raise

    def set(self, name: str, value: Any) -> None:
        """Give a uniform a value, cut or turned into what it holds; one that the compiler left out is left alone."""
        member = self.uniforms.get(name)
        if member is None:
            return
        turned = int if member.fmt[-1] in _INTEGERS else float
        numbers, length = member.dimension, member.array_length
        if length > 1 and numbers > 1:
            # A contract holds them one number after the other.
            rows = value if isinstance(value[0], tuple) else [
                value[start:start + numbers] for start in range(0, len(value), numbers)]
            member.value = [tuple(turned(v) for v in row[:numbers]) for row in rows[:length]]
        elif length > 1:
            member.value = [turned(v) for v in value[:length]]
        else:
            flat = value if isinstance(value, tuple) else (value,) * numbers
            if flat and isinstance(flat[0], tuple):
                flat = flat[0]
            member.value = tuple(turned(v) for v in flat[:numbers]) if numbers > 1 else turned(flat[0])

    def draw(self) -> None:
        """Over the whole film."""
        self._quad.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GL objects."""
        self._quad.release()
        self._program.release()

    def _require_no_data(self, one: ShaderPass, members: Mapping[str, Any]) -> None:
        for name, member in members.items():
            if isinstance(member, moderngl.StorageBlock | moderngl.UniformBlock):
                what = "a storage buffer" if isinstance(member, moderngl.StorageBlock) else "a uniform block"
            elif name in self.uniforms and self.uniforms[name].gl_type in _IMAGES:
                what = "an image that it writes to"
            else:
                continue
            raise ShaderError(f"{one.source.files[0][0]}: '{name}' is {what}, whose data only its own program has, so "
                              "it cannot be judged; keep the scene in the shader, or in uniforms that --set can give")


def _explained(one: ShaderPass, log: str, line_offset: int) -> ShaderError:
    """The first error of a log; where it has no line (recursion, linking), what the compiler says, and that alone."""
    explained = str(one.source.explain(log, line_offset))
    if log.startswith("GLSL") and " ".join(log.split()) in explained:
        errors = _ERROR.findall(log) or [log.strip().splitlines()[-1]]
        explained = f"{one.source.files[0][0]}: {errors[0].strip()}"
    told, line, shown = explained.partition("; in the line `")
    return ShaderError(f"{told[:MOST]}{line}{shown if len(shown) <= MOST else shown[:MOST] + '…`'}")


def _log(text: str) -> str:
    """A compiler's log in ASCII: what it quotes of the author's may be anything."""
    return text.encode("ascii", "replace").decode("ascii")


def unset_variables(one: ShaderPass) -> list[tuple[str, str]]:
    """Variables of which the compiler warns that they are read before they have a value: (file:line, name).

    It only speaks when a text fails, so it is given one that does.
    """
    gl = context()
    try:
        gl.program(vertex_shader=one.vertex, fragment_shader=f"{one.source.text}{_UNDECLARED}").release()
    except (moderngl.Error, UnicodeError, KeyError, ValueError) as error:
        found = _UNSET.findall(_log(str(error)))
        offset = line_offset(gl)
        places = [(*divmod(int(line) - offset, LINE_STRIDE), name) for line, name in found]
        return [(f"{one.source.files[file - 1][0]}:{number}", name) for file, number, name in places
                if 1 <= file <= len(one.source.files)]
    return []


def _quad(gl: moderngl.Context, program: Any, members: Mapping[str, Any]) -> Any:
    """A triangle that covers all. An attribute whose name speaks of coordinates runs over [0, 1], any other over
    [-1, 1]."""
    content = []
    for name, member in members.items():
        if not isinstance(member, moderngl.Attribute) or name.startswith("gl_"):
            continue
        corners = np.zeros((3, member.dimension), np.float32)
        unit = bool(re.search(r"uv|coord|tex", name, re.IGNORECASE))
        corners[:, :2] = [[0, 0], [2, 0], [0, 2]] if unit else [[-1, -1], [3, -1], [-1, 3]]
        if member.dimension == 4:
            corners[:, 3] = 1
        content.append((gl.buffer(corners.tobytes()), f"{member.dimension}f", name))
    return gl.vertex_array(program, content)


def iterations_limit() -> int:
    """How many iterations of all its loops an invocation can make on this device, found by a loop that counts them; 0
    where it makes as many as it should, here 2²⁰. llvmpipe of Mesa 22 leaves loops after 65,535, of Mesa 25 never."""
    gl = context()
    program = Program(ShaderSource(_COUNTING, ()))
    framebuffer = gl.simple_framebuffer((1, 1), 1, dtype="f4")
    try:
        program.set({"most": _MOST_ITERATIONS})
        gl.scissor = None
        framebuffer.use()
        framebuffer.clear()  # what is blended with must be finite
        program.draw()
        counted = int(np.frombuffer(framebuffer.read(components=1, dtype="f4"), np.float32)[0])
    finally:
        for thing in (program, *framebuffer.color_attachments, framebuffer):
            thing.release()
    return counted if counted < _MOST_ITERATIONS else 0
