"""PCG's numbers in place of an author's: which functions are exchanged, and that all else stays where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.gpu.frames import Frames, Moment
from harness.shader.contract import Contract
from harness.shader.hosts import read
from harness.strangers.generator import with_other_numbers
from harness.strangers.law import radiance_pass
from tests.support.strangers import written

MAIN = "void mainImage(out vec4 c, in vec2 p) { s = p.x + p.y * 64.0 + iTime; c = vec4(%s); }"
STATE = "float s;\n"
SINE = "float rand()\n{\n    return fract(sin(s++) * 43758.5453);\n}\n"
INTEGER = "float rnd(inout uint x) { x = x * 747796405u + 1u; return float(x) / 4294967295.0; }\n"


def toy(folder: Path, functions: str, use: str) -> Contract:
    return read(written(folder, toy__glsl=STATE + functions + MAIN % use))


@pytest.mark.parametrize(("functions", "use"), [
    (SINE, "rand(), rand(), rand(), 1.0"),
    ("vec2 hash2() { return fract(sin(vec2(s += 0.1, s += 0.1)) * 43758.5453); }\n", "hash2(), hash2()"),
    (f"{INTEGER}uint u = 7u;\n", "rnd(u), rnd(u), 0.0, 1.0"),
    (f"{SINE}float rand11() {{ return rand() * 2.0 - 1.0; }}\n", "rand11() * 0.5 + 0.5, rand(), 0.0, 1.0"),
])
def test_numbers_are_exchanged_and_lines_stay(tmp_path: Path, functions: str, use: str) -> None:
    contract = toy(tmp_path, functions, use)
    other = with_other_numbers(contract)
    assert other is not None
    changed, where = other
    assert where.endswith(":2")
    own, text = (radiance_pass(one).source.text for one in (contract, changed))
    assert text.count("\n") == own.count("\n")
    assert "43758" not in text and "4294967295.0" not in text
    frames = Frames(changed, (16, 12))
    drawn = []
    for number in (1, 2):
        frames.frame(Moment.of(number, number))
        drawn.append(frames.read(changed.radiance)[..., 0])
    assert not np.array_equal(drawn[0], drawn[1])
    for image in drawn:
        assert len(np.unique(image)) > 150 and 0.4 < image.mean() < 0.6


@pytest.mark.parametrize(("functions", "use"), [
    ("float hash(vec2 p) { return fract(sin(dot(p, vec2(12.9, 78.2))) * 43758.5453); }\n", "hash(p)"),  # a texture's?
    ("float rand() { return fract(sin(s++) * 43758.5453) * 2.0 - 1.0; }\n", "rand()"),  # from -1 to 1
    ("float rand() { return sin(s++); }\n", "rand()"),
    (f"{SINE}vec3 noise3() {{ return sin(vec3(s++, s++, s++)); }}\n", "rand(), noise3()"),  # one stays the author's
    ("float brand() { return 0.5; }\n", "brand()"),
])
def test_what_may_be_something_else_is_left_alone(tmp_path: Path, functions: str, use: str) -> None:
    assert with_other_numbers(toy(tmp_path, functions, use)) is None
