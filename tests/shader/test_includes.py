"""Files that are joined: what is included from where, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import ShaderError
from harness.shader.includes import Piece, joined
from harness.shader.lexer import place
from tests.support.strangers import written


def test_includes_are_joined_once_and_keep_their_lines(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "b.glsl").write_text('float b;\n#include "c.glsl"\nfloat b2;')
    (tmp_path / "lib" / "c.glsl").write_text("// #include \"nowhere\"\nfloat c;\n")
    text = 'float a;\n#include "lib/b.glsl"\n#include "lib/c.glsl"\n#if 0\n#include "missing"\n#endif\nfloat a2;\n'
    source = joined([Piece("a.glsl", text, tmp_path)])
    assert source.text.split() and source.text.count("float c;") == 1
    assert "include" not in source.text and "//" not in source.text  # moderngl looks for them in comments too
    places = {name: place(source, source.text.index(f"float {name};")) for name in ("a", "b", "c", "b2", "a2")}
    assert places == {"a": "a.glsl:1", "b": f"{tmp_path}/lib/b.glsl:1", "c": f"{tmp_path}/lib/c.glsl:2",
                      "b2": f"{tmp_path}/lib/b.glsl:3", "a2": "a.glsl:7"}


def test_an_include_may_depend_on_a_macro_of_an_earlier_one(tmp_path: Path) -> None:
    written(tmp_path, options__glsl="#define FAST\n", fast__glsl="float fast;\n")
    text = '#include "options.glsl"\n#ifdef FAST\n#include "fast.glsl"\n#else\n#include "slow.glsl"\n#endif\n'
    assert "float fast;" in joined([Piece("a.glsl", text, tmp_path)]).text


@pytest.mark.parametrize(("include", "message"), [
    ('"../secret.glsl"', "leads out of the folder"), ('"/etc/passwd"', "leads out of the folder"),
    ('"link.glsl"', "leads out of the folder"), ('"none.glsl"', 'no such file "none.glsl"'),
    ("<common>", "is a piece of its own program"), ('"self.glsl"', "includes itself (a.glsl > self.glsl > self.glsl)"),
])
def test_what_may_not_be_included_is_named(tmp_path: Path, include: str, message: str) -> None:
    folder = tmp_path / "shader"
    folder.mkdir()
    written(tmp_path, secret__glsl="float s;")
    written(folder, self__glsl='#include "self.glsl"\n')
    (folder / "link.glsl").symlink_to(tmp_path / "secret.glsl")
    with pytest.raises(ShaderError) as refusal:
        joined([Piece("a.glsl", f"\n#include {include}\n", folder)])
    assert ("self.glsl:1: " if "itself" in message else "a.glsl:2: ") in str(refusal.value)
    assert message in str(refusal.value)


def test_a_guarded_file_may_include_itself(tmp_path: Path) -> None:
    written(tmp_path, g__glsl='#ifndef G\n#define G\nfloat g;\n#include "g.glsl"\n#endif\n')
    assert joined([Piece("a.glsl", '#include "g.glsl"\n', tmp_path)]).text.count("float g;") == 1


def test_lines_of_the_author_do_not_renumber(tmp_path: Path) -> None:
    source = joined([Piece("a.glsl", "#line 50\nfloat a;", tmp_path)])
    assert place(source, source.text.index("float")) == "a.glsl:2"
