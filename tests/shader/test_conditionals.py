"""Which lines the preprocessor keeps."""

from __future__ import annotations

import pytest

from harness.shader.conditionals import preprocess


def kept(text: str, **defines: str) -> list[str]:
    return preprocess(text, defines).text.split()


@pytest.mark.parametrize(("condition", "holds"), [
    ("1", True), ("0", False), ("A", True), ("B", False), ("defined(A) && !defined B", True), ("A == 3", True),
    ("A + 2 * 2 == 7", True), ("(A + 2) * 2 == 10 || 0", True), ("-1 < 0 ? 1", True), ("C >= 4", True),
    ("~0 == -1", True), ("7 / 2 == 3 && -7 / 2 == -3 && 7 % 4 == 3", True), ("0x10 == 16", True),
    ("1 << 4 == 16", True),
    ("D", True), ("1 / 0", True), ("!A == 0", True),  # a condition that nobody understands holds
])
def test_conditions_are_those_of_the_language(condition: str, holds: bool) -> None:
    assert kept(f"#if {condition}\nyes\n#else\nno\n#endif", A="3", C="(A + 1)", D="f(D)") == ["yes" if holds else "no"]


def test_branches_nest_and_macros_come_and_go() -> None:
    text = ("#define A\n#ifdef A\n1\n#if 0\n2\n#elif 1\n3\n#elif 1\n4\n#else\n5\n#endif\n#undef A\n#endif\n#ifndef "
            "A\n6\n#endif\n#if 0\n#define B\n#endif\n#ifdef B\n7\n#endif")
    assert kept(text) == ["1", "3", "6"]


def test_text_keeps_its_length_and_macros_with_arguments_their_names() -> None:
    text = "#define F(x) \\\n  (x)\n#ifdef F\na\n#endif\n"
    found = preprocess(text)
    assert len(found.text) == len(text) and found.text.count("\n") == text.count("\n")
    assert found.text.split() == ["a"] and "F(" in found.macros


def test_macros_that_double_come_to_an_end() -> None:
    """A thousandfold of a thousandfold of text would fill the memory of the process that only reads."""
    lines = [f"#define M{n} M{n + 1} M{n + 1}" for n in range(40)]
    assert kept("\n".join([*lines, "#if M0", "yes", "#endif"])) == ["yes"]
