"""Somebody's file as text: its encoding, byte-order marks, and what is no text at all."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from pathlib import Path

from harness.errors import ShaderError

MAX_BYTES = 8 << 20  # the longest public shader that was seen has 0.3 MB

_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
          (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


@dataclass(frozen=True)
class Decoded:
    """A file's text, ends of lines as `\\n`; `note`: how it was read, if not as UTF-8."""

    text: str
    note: str = ""


def decoded(path: Path) -> Decoded:
    """The text of a file: UTF-8, with or without its mark; UTF-16 or UTF-32 with a mark; else Latin-1, with a note.

    Raises ShaderError, naming the file, for one that cannot be read, is empty, is longer than MAX_BYTES or is no text.
    """
    try:
        if not path.is_file():
            raise ShaderError(f"{path}: no such file; name a shader, or a folder of shaders")
        if (size := path.stat().st_size) > MAX_BYTES:
            raise ShaderError(f"{path}: {size / 2**20:.1f} MB, but a shader has at most {MAX_BYTES >> 20} MB; is this "
                              "the right file?")
        data = path.read_bytes()
    except OSError as error:
        raise ShaderError(f"{path}: the file cannot be read ({error.strerror}); unlock it") from None
    result = _decoded(data, path)
    if not result.text.strip():
        raise ShaderError(f"{path}:1: the file is empty; save the shader into it")
    return Decoded(result.text.replace("\r\n", "\n").replace("\r", "\n"), result.note)


def _decoded(data: bytes, path: Path) -> Decoded:
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            try:
                text = data.decode(encoding)
            except UnicodeDecodeError:
                raise ShaderError(f"{path}: begins as {encoding.upper()} and goes on as something else; save it as "
                                  "UTF-8") from None
            return Decoded(text, "" if encoding == "utf-8-sig" else f"{path} is read as {encoding.upper()}")
    if b"\0" in data:
        line = data[:data.index(b"\0")].count(b"\n") + 1
        raise ShaderError(f"{path}:{line}: not text (it holds a zero byte); name the shader's source, saved as UTF-8")
    try:
        return Decoded(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = data[:error.start].count(b"\n") + 1
        return Decoded(data.decode("latin-1"), f"{path} is not UTF-8 (line {line}); it is read as Latin-1")
