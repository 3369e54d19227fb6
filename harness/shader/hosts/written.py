"""Numbers that an author has written into a shader: the size of its image, and the samples of a frame."""

from __future__ import annotations

import re
from collections.abc import Iterator

_NUMBER = r"(\d+)(?:\.0*)?[fu]?"
_PAIR = rf"[iu]?vec2\s*\(\s*{_NUMBER}\s*(?:,\s*{_NUMBER}\s*)?\)"
_NAME = r"\w*(?:resolution|screen_?size|image_?size|window_?size|view_?port|canvas_?size|\bres\b)\w*"
_VECTOR = re.compile(rf"(?:\b{_NAME}\s*=\s*|#[ \t]*define[ \t]+{_NAME}[ \t]+\(?\s*){_PAIR}", re.IGNORECASE)
_SIDE = (r"(?:(?:float|int|uint)\s+|,\s*|#[ \t]*define[ \t]+)(?:\w+_)?{}\w{{0,8}}(?:\s*=\s*|[ \t]+)\(?\s*" + _NUMBER)
_WIDTH = re.compile(_SIDE.format("width"), re.IGNORECASE)
_HEIGHT = re.compile(_SIDE.format("height"), re.IGNORECASE)
_DIVIDED = re.compile(rf"\b(?:gl_FragCoord|fragCoord)(?:\.xy)?\s*/\s*(?:{_PAIR}|{_NUMBER})", re.IGNORECASE)
_SAMPLES = re.compile(
    r"(?:#[ \t]*define[ \t]+|\b(?:const|uniform)\s+u?int\s+)(?:num_?|n_?|max_?)?"
    r"(?:spp|(?:samples?|rays|paths)(?:_?per_?(?:pixel|frame|pass))?|samples?_?(?:count|num)|aa_?samples)"
    r"(?:[ \t]*=[ \t]*|[ \t]+)(\d+)u?\b", re.IGNORECASE)
_SIDES = range(16, 8193)


def written_size(text: str) -> tuple[int, int] | None:
    """(width, height) where a text without comments says it in numbers; None where it asks the host."""
    for width, height in _sizes(text):
        if width in _SIDES and height in _SIDES:
            return width, height
    return None


def _sizes(text: str) -> Iterator[tuple[int, int]]:
    for found in _VECTOR.finditer(text):
        yield int(found[1]), int(found[2] or found[1])
    width, height = _WIDTH.search(text), _HEIGHT.search(text)
    if width and height:
        yield int(width[1]), int(height[1])
    for found in _DIVIDED.finditer(text):
        yield int(found[1] or found[3]), int(found[2] or found[1] or found[3])


def written_samples(text: str) -> int:
    """The samples of one frame where a constant or macro with such a name says it; 1 where none does."""
    counts = sample_counts(text)
    return counts[0][2] if len(counts) == 1 and counts[0][2] > 0 else 1


def sample_counts(text: str) -> list[tuple[int, int, int]]:
    """Where constants, macros and uniforms with such a name say how many samples a frame has: from and to which
    character, and the number."""
    return [(*found.span(1), int(found[1])) for found in _SAMPLES.finditer(text) if len(found[1]) < 6]
