"""Source assembly: includes once each, and compiler messages that name our file and line."""

from __future__ import annotations

import re
from pathlib import Path

import moderngl
import pytest

from harness.errors import ShaderError
from harness.gpu import context as context_module
from harness.gpu.context import Program
from harness.scene import load_scene
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import ShaderSource, assemble

MAIN = """// A shader that includes two chunks.
#include "lib/a.glsl"
#include "lib/b.glsl"  // comments may follow
out vec4 colour;
void main()
{
    colour = vec4(a() + b());
}
"""
A = "float a()\n{\n    return 1.0;\n}\n"
B = '#include "lib/a.glsl"\nfloat b()\n{\n    return a() + 1.0;\n}\n'


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder of shaders: main.frag includes lib/a.glsl and lib/b.glsl, and lib/b.glsl includes lib/a.glsl again."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "main.frag").write_text(MAIN)
    (tmp_path / "lib" / "a.glsl").write_text(A)
    (tmp_path / "lib" / "b.glsl").write_text(B)
    return tmp_path


def compile_error(source: ShaderSource) -> str:
    """The message of the ShaderError that compiling raises; always one line."""
    with pytest.raises(ShaderError) as caught:
        Program(source)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_each_file_is_included_once(root: Path) -> None:
    """However many files include it, and with no include directive left over; the version comes first."""
    source = assemble("main.frag", root)
    assert source.text.count("float a()") == 1
    assert "#include" not in source.text
    assert source.text.startswith("#version 420 core\n")
    assert [name for name, _ in source.files] == ["main.frag", "lib/a.glsl", "lib/b.glsl"]
    Program(source).release()


def test_a_cycle_of_includes_ends(root: Path) -> None:
    """Two files that include each other are each taken once."""
    (root / "lib" / "a.glsl").write_text('#include "lib/b.glsl"\n' + A)
    assert assemble("main.frag", root).text.count("float b()") == 1


def test_definitions_precede_the_source(root: Path) -> None:
    """Defines stand after the version and before everything else, where `#ifndef` defaults see them."""
    lines = assemble("main.frag", root, defines={"STRATEGY": 3, "NAME": "x"}).text.splitlines()
    assert lines[:3] == ["#version 420 core", "#define STRATEGY 3", "#define NAME x"]


def test_generated_text_wins_over_a_file(root: Path) -> None:
    """An include that exists only in memory replaces the file of that name."""
    source = assemble("main.frag", root, generated={"lib/a.glsl": "float a() { return 7.0; }\n"})
    assert "7.0" in source.text and "return 1.0" not in source.text


@pytest.mark.parametrize(("main", "where"), [("main.frag", "lib/b.glsl:2"), ("absent.frag", "absent.frag")])
def test_a_missing_file_is_named_with_the_line_that_includes_it(root: Path, main: str, where: str) -> None:
    """Includes inside includes, and a main file that does not exist."""
    (root / "lib" / "b.glsl").write_text('// first line\n#include "lib/absent.glsl"\n' + B)
    with pytest.raises(ShaderError, match=rf'^{where}: no such shader file "(lib/absent.glsl|absent.frag)"; .*{root}'):
        assemble(main, root)


@pytest.mark.parametrize(("file", "line", "bad"), [
    ("main.frag", 7, "    colour = vec4(a() + undeclared);"),
    ("lib/a.glsl", 3, "    return undeclared;"),
    ("lib/b.glsl", 4, "    return undeclared + 1.0;"),
])
def test_a_compile_error_names_our_file_and_line(root: Path, file: str, line: int, bad: str) -> None:
    """On this machine's driver: before, inside and after included files; the offending line is shown."""
    lines = (root / file).read_text().splitlines()
    lines[line - 1] = bad
    (root / file).write_text("\n".join(lines) + "\n")
    message = compile_error(assemble("main.frag", root))
    assert message.startswith(f"{file}:{line}: ")
    assert "undeclared" in message and f"`{bad.strip()}`" in message


def test_a_compile_error_in_generated_code_names_it() -> None:
    """An error in the scene's own chunk is reported in `scene.glsl`, at its line there."""
    folder = Path(__file__).parents[2]
    chunk = scene_chunk(load_scene(folder / "mitsuba_scenes" / "furnace_convex.xml"), "cosine")
    broken = chunk.replace("return vec3(", "return vec2(")
    assert broken != chunk
    line = 1 + broken[:broken.rindex("return vec2(")].count("\n")
    message = compile_error(assemble("path_tracer.frag", folder / "glsl", {"scene.glsl": broken}))
    assert message.startswith(f"scene.glsl:{line}: ")


def test_a_link_error_is_one_line(root: Path) -> None:
    """A message that names no line still names the main file: here a function that is declared and never defined."""
    (root / "main.frag").write_text("float nowhere();\nout vec4 colour;\nvoid main() { colour = vec4(nowhere()); }\n")
    assert compile_error(assemble("main.frag", root)).startswith("main.frag")


@pytest.mark.parametrize(("log", "offset"), [
    ("2:300005(12): error: `undeclared' undeclared\n2:300005(5): error: return type mismatch", 1),  # Mesa
    ("GLSL Compiler failed\n\nfragment_shader\n===============\n2:300005(12): error: `undeclared' undeclared\n", 1),
    ("0:300005(12): error: `undeclared' undeclared", 1),  # Mesa's own slip: the wrong source string
    ("0:100009(1): warning: unused\n2:300005(12): error: `undeclared' undeclared", 1),  # a warning comes first
    ("ERROR: 2:300004: 'undeclared' : undeclared identifier\nERROR: 1 compilation errors.", 0),  # Intel, AMD, Apple
    ("2(300004) : error C1503: undeclared variable \"undeclared\"", 0),  # NVIDIA
    ("2(300004) : warning C7011: implicit cast\n2(300004) : error C1503: undeclared variable \"undeclared\"", 0),
])
def test_logs_of_every_vendor_are_understood(root: Path, log: str, offset: int) -> None:
    """Each vendor's format, its first error; `offset` is what the driver adds to `#line`."""
    message = str(assemble("main.frag", root).explain(log, offset))
    assert message.startswith("lib/b.glsl:4: ") and "undeclared" in message
    assert message.endswith("; in the line `return a() + 1.0;`")


def test_errors_of_the_preprocessor_name_their_line(root: Path) -> None:
    """Mesa words them otherwise than the compiler's."""
    for line, text in ((3, "#error mine"), (5, "#if 1")):
        lines = MAIN.splitlines()
        lines[line - 1] = text
        (root / "main.frag").write_text("\n".join(lines) + "\n")
        assert compile_error(assemble("main.frag", root)).startswith(f"main.frag:{line}: ")


def test_messages_call_files_what_the_caller_does(root: Path) -> None:
    """Somebody's own files by their paths, which the shader's text does not depend on."""
    (root / "lib" / "b.glsl").write_text('#include "lib/a.glsl"\nfloat b() { return undeclared; }\n')
    shown = {"lib/b.glsl": "mine/b.glsl"}
    source = assemble("main.frag", root, shown=shown)
    assert compile_error(source).startswith("mine/b.glsl:2: ")
    assert source.text == assemble("main.frag", root).text
    (root / "lib" / "b.glsl").write_text('#include "lib/absent.glsl"\n')
    with pytest.raises(ShaderError, match=r"^mine/b\.glsl:1: no such shader file"):
        assemble("main.frag", root, shown=shown)


@pytest.mark.parametrize("offset", [0, 1])
def test_the_drivers_own_count_of_lines_is_asked_for(root: Path, monkeypatch: pytest.MonkeyPatch, offset: int) -> None:
    """GLSL before 3.30, and drivers that kept to it, number the line after `#line n` n + 1: both are put right."""
    class Driver:
        """Refuses every shader at the line after its last `#line`."""

        def program(self, vertex_shader: str, fragment_shader: str) -> None:
            number = int(re.findall(r"^#line (\d+)", fragment_shader, re.MULTILINE)[-1])
            raise moderngl.Error(f"0:{number + offset}(1): error: syntax error")

    monkeypatch.setattr(context_module, "context", Driver)
    # The last #line of the text follows the include of lib/b.glsl in line 3 of main.frag.
    assert compile_error(assemble("main.frag", root)) == "main.frag:4: syntax error; in the line `out vec4 colour;`"


def test_an_unknown_log_is_passed_on_in_one_line(root: Path) -> None:
    """A format nobody foresaw loses nothing."""
    message = str(assemble("main.frag", root).explain("internal error:\n  out of registers\n"))
    assert message == "main.frag: internal error: out of registers"
