"""Encodings of somebody's files, and what is no text."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import ShaderError
from harness.shader import decoding
from harness.shader.decoding import decoded


@pytest.mark.parametrize(("data", "text", "note"), [
    (b"a\r\nb\rc", "a\nb\nc", ""), ("\ufeffé".encode(), "é", ""), ("é".encode("utf-16"), "é", "read as UTF-16"),
    ("é".encode("utf-32"), "é", "read as UTF-32"), (b"\n// caf\xe9", "\n// café", "(line 2); it is read as Latin-1"),
])
def test_text_is_read_whatever_its_encoding(tmp_path: Path, data: bytes, text: str, note: str) -> None:
    path = tmp_path / "a.glsl"
    path.write_bytes(data)
    assert decoded(path).text == text
    assert note in decoded(path).note and bool(note) == bool(decoded(path).note)


@pytest.mark.parametrize(("data", "message"), [
    (b" \n", "a.glsl:1: the file is empty"), (b"a\n\0", "a.glsl:2: not text (it holds a zero byte)"),
    (b"\xff\xfea", "begins as UTF-16"), (b"x" * 65, "but a shader has at most"),
])
def test_what_is_no_shader_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes, message: str) -> None:
    monkeypatch.setattr(decoding, "MAX_BYTES", 64)
    path = tmp_path / "a.glsl"
    path.write_bytes(data)
    with pytest.raises(ShaderError, match=r"a\.glsl") as refusal:
        decoded(path)
    assert message in str(refusal.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShaderError, match="no such file"):
        decoded(tmp_path / "a.glsl")
