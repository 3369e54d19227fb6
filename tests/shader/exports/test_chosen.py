"""What is left of an assembled shader: the lines that its macros choose, comments and all."""

from __future__ import annotations

from harness.shader.exports.chosen import Line, chosen

MARK = "#line 100001 0 // a.glsl"


def texts(*lines: str) -> list[str]:
    return [line.text for line in chosen("\n".join([MARK, *lines]))]


def test_the_branch_that_is_taken_stays() -> None:
    found = texts("#define HAS_LENS 0", "#define STRATEGY 4", "#if HAS_LENS || STRATEGY == 3", "a;",
                  "#elif STRATEGY == 4", "b;  // kept with its comment", "#else", "c;", "#endif")
    assert found == ["#define HAS_LENS 0", "#define STRATEGY 4", "b;  // kept with its comment"]


def test_comments_go_with_their_branch() -> None:
    assert texts("#if 0", "// gone", "#else", "// stays", "#endif") == ["// stays"]


def test_directives_in_comments_are_comments() -> None:
    assert texts("/* a block", "#if 0", "*/ a;", "// #endif") == ["/* a block", "#if 0", "*/ a;", "// #endif"]


def test_guards_and_versions_go_and_values_of_skipped_branches_do_not_count() -> None:
    assert texts("#version 420", "#ifndef LIB", "#define LIB", "#if 0", "#define A 1", "#endif", "#ifndef A",
                 "#define A 2", "#endif", "int a = A;", "#endif") == ["#define A 2", "int a = A;"]


def test_each_line_knows_its_file() -> None:
    found = chosen("\n".join([MARK, "a;", "#line 200001 1 // lib/b.glsl", "b;", "#line 100003 0 // a.glsl", "c;"]))
    assert found == [Line("a.glsl", "a;"), Line("lib/b.glsl", "b;"), Line("a.glsl", "c;")]
