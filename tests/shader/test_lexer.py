"""Comments, tokens and the places of a joined text."""

from __future__ import annotations

import pytest

from harness.errors import ShaderError
from harness.shader.lexer import number_at, place, tokens, without_comments
from harness.shader.source import ShaderSource


@pytest.mark.parametrize(("text", "expected"), [
    ("x; //* y\nz;", "x;      \nz;"),  # opens no block
    ("a/* // */b", "a        b"),
    ("a /* 1\n2 */ b", "a     \n     b"),
    ("// a \\\nb\nc", "      \n \nc"),  # a backslash continues it
    ('#iChannel0 "file://b.glsl" // c', '#iChannel0 "file://b.glsl"     '),
    ("a\u00a0b\ufeff", "a b "),
])
def test_comments_are_spaces(text: str, expected: str) -> None:
    assert without_comments(text, "a.glsl") == expected


@pytest.mark.parametrize(("text", "message"), [
    ("a;\nb /* c\n", "a.glsl:2: a comment begins here that nothing closes"),
    ("// é is fine\nfloat \u03c0;", "a.glsl:2: the character 'π' (U+03C0)"),
])
def test_what_no_compiler_takes_is_named(text: str, message: str) -> None:
    with pytest.raises(ShaderError, match=r"a\.glsl:2") as refusal:
        without_comments(text, "a.glsl")
    assert str(refusal.value).startswith(message)


def test_tokens_are_names_numbers_and_signs() -> None:
    found = tokens("vec2 a=1.0e-5+.5f;")
    assert [(token.kind, token.text) for token in found] == [
        ("name", "vec2"), ("name", "a"), ("symbol", "="), ("number", "1.0e-5"), ("symbol", "+"), ("number", ".5f"),
        ("symbol", ";")]
    assert found[1].start == 5


def test_a_place_is_told_by_the_last_line_directive() -> None:
    source = ShaderSource("head\n#line 100001 0\none\ntwo\n#line 200007 1\nseven\n", (("a", ""), ("b", "")))
    assert [place(source, source.text.index(word)) for word in ("one", "two", "seven")] == ["a:1", "a:2", "b:7"]
    assert number_at(source.text, 0) == 1
