"""Somebody's shaders for tests: written to files, read by their dialect, compiled and drawn once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.gpu.context import context, line_offset
from harness.shader.contract import Contract, ShaderPass
from harness.shader.hosts import read
from harness.shader.hosts.reading import Answer

SIZE = (8, 6)


def written(folder: Path, **texts: str) -> list[Path]:
    """Files with these texts: `buffer_a__glsl="…"` is 'buffer_a.glsl'."""
    paths = []
    for name, text in texts.items():
        path = folder / name.replace("__", ".")
        path.write_text(text, encoding="utf-8")
        paths.append(path)
    return paths


def contract_of(folder: Path, host: str | None = None, values: Mapping[str, Answer] | None = None,
                **texts: str) -> Contract:
    """The contract of files with these texts; every pass of it compiles."""
    contract = read(written(folder, **texts), host, values)
    compiled(contract)
    return contract


def compiled(contract: Contract) -> None:
    """Compile every pass; ShaderError, as users see it, for one that does not."""
    for one in contract.passes:
        _program(one).release()


def refused(folder: Path, *says: str, host: str | None = None, values: Mapping[str, Answer] | None = None,
            **texts: str) -> None:
    """Files with these texts are refused, when they are read or compiled, in one line that holds all of `says`."""
    with pytest.raises(HarnessError) as refusal:
        compiled(read(written(folder, **texts), host, values))
    message = str(refusal.value)
    assert "\n" not in message
    for part in says:
        assert part in message


def drawn(contract: Contract, **uniforms: Any) -> np.ndarray:
    """What the radiance pass draws on a black past, (H, W, 4), row 0 at the bottom; `resolution` is set by role."""
    one = next(one for one in contract.passes if one.name == contract.radiance)
    gl, program = context(), _program(one)
    corners = gl.buffer(np.array([-1, -1, 3, -1, -1, 3], "f4").tobytes())
    target, black = gl.texture(SIZE, 4, dtype="f4"), gl.texture((1, 1), 4, b"\0\0\0\xff")
    framebuffer = gl.framebuffer([target])
    try:
        values = {name: (*SIZE, 1.0)[:_dimension(program, name)] for name, role in one.roles if role == "resolution"}
        for name, value in {**values, **dict(contract.values), **uniforms}.items():
            if name in program:
                program[name].value = value
        black.use(0)
        framebuffer.use()
        gl.scissor = None
        names = [name for name in program if name == "harness_corner"]
        gl.vertex_array(program, [(corners, "2f", *names)] if names else []).render(vertices=3)
        return np.frombuffer(target.read(), np.float32).reshape(SIZE[1], SIZE[0], 4)
    finally:
        resources: list[Any] = [program, corners, target, black, framebuffer]
        for resource in resources:
            resource.release()


def _dimension(program: Any, name: str) -> int:
    return program[name].dimension if name in program else 2


def _program(one: ShaderPass) -> Any:
    gl = context()
    try:
        return gl.program(vertex_shader=one.vertex, fragment_shader=one.source.text)
    except Exception as error:  # moderngl's own, which only gpu imports
        raise one.source.explain(str(error), line_offset(gl)) from None
