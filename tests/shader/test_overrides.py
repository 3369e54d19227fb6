"""Library functions exchanged for others: only those named, every line where it was, errors in the right file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.errors import ShaderError
from harness.files import data_dir
from harness.shader.overrides import _functions, override
from harness.shader.source import assemble

LIBRARY = """// First line.
float a()
{
    if (true) {
        return 1.0;
    }
    return 0.5;
}
float b(float x,
        float y)
{
    return a() + x + y;
}
float c()
{
    return b(1.0, 2.0);
}
"""
MAIN = '#include "lib/one.glsl"\n#include "lib/two.glsl"\nvoid main() { c(); d(); }\n'


def constant(name: str, value: float) -> str:
    """A function that returns a number."""
    return f"float {name}()\n{{\n    return {value};\n}}\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with lib/one.glsl (a, b, c), lib/two.glsl (d), main.frag and an empty own/."""
    for folder in ("lib", "own"):
        (tmp_path / folder).mkdir()
    (tmp_path / "lib" / "one.glsl").write_text(LIBRARY)
    (tmp_path / "lib" / "two.glsl").write_text(constant("d", 4.0))
    (tmp_path / "main.frag").write_text(MAIN)
    return tmp_path


def texts(root: Path) -> dict[str, str]:
    """Every shader of a folder by its name."""
    return {path.relative_to(root).as_posix(): path.read_text() for path in root.rglob("*.glsl")}


def test_the_functions_give_way_and_nothing_else_moves(root: Path) -> None:
    """a and b are replaced by the chunk where b stood; c keeps its line; the other file is not touched."""
    (root / "own" / "x.glsl").write_text("float b(float x, float y)\n{\n    return 7.0;\n}\n" + constant("a", 8.0))
    changed = override(texts(root), "own/x.glsl")
    assert list(changed) == ["lib/one.glsl"]
    ours, theirs = LIBRARY.splitlines(), changed["lib/one.glsl"].splitlines()
    assert len(theirs) == len(ours)
    assert theirs[0] == ours[0] and theirs[13:] == ours[13:]
    assert [line for line in theirs[1:13] if line] == ['#include "own/x.glsl"'] and theirs[8]
    text = assemble("main.frag", root, changed).text
    assert "return 8.0" in text and "return 0.5" not in text and text.count("float a()") == 1


def test_chunks_add_up(root: Path) -> None:
    """Two chunks for one file, and one for another."""
    (root / "own" / "a.glsl").write_text(constant("a", 8.0))
    (root / "own" / "c.glsl").write_text(constant("helper", 9.0) + "float c()\n{\n    return helper();\n}\n")
    (root / "own" / "d.glsl").write_text(constant("d", 5.0))
    text = assemble("main.frag", root, override(texts(root), "own/a.glsl", "own/c.glsl", "own/d.glsl")).text
    assert [number in text for number in ("8.0", "9.0", "5.0", "0.5", "4.0")] == [True] * 3 + [False] * 2


@pytest.mark.parametrize(("text", "told"), [
    (constant("e", 1.0), r"own/x\.glsl: its functions \(e\) replace none of the library's"),
    (constant("a", 1.0) + constant("d", 1.0), r"\(a, d\) replace those of lib/one\.glsl and"),
    (None, r'no such shader file "own/x\.glsl"'),
])
def test_a_chunk_that_fits_nowhere_is_refused(root: Path, text: str | None, told: str) -> None:
    """A misspelt function would otherwise leave the library's in its place, and nobody would notice."""
    if text:
        (root / "own" / "x.glsl").write_text(text)
    with pytest.raises(ShaderError, match=told):
        override(texts(root), "own/x.glsl")


@pytest.mark.parametrize("path", sorted((data_dir("glsl") / "lib").glob("*.glsl")), ids=lambda path: path.stem)
def test_every_function_of_the_library_can_be_replaced(path: Path) -> None:
    """As the library is written, the pattern finds all that stands at the outermost level and has parameters."""
    text = path.read_text(encoding="utf-8")
    bodies = re.sub(r"^\{\n.*?^\}\n", "{}", re.sub(r"//.*", "", text), flags=re.MULTILINE | re.DOTALL)
    assert _functions(text) == re.findall(r"(\w+)\([^()]*\)\s*\{\}", bodies)
