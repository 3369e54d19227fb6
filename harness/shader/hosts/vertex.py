"""The vertex shader to a stranger's fragment shader: their own where it is known, else one that fits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from harness.errors import ShaderError
from harness.shader.declarations import Varying, declarations
from harness.shader.includes import Piece, joined
from harness.shader.language import Language, complete
from harness.shader.lexer import hidden
from harness.shader.source import ShaderSource

# The corners of one triangle that covers the image, (-1,-1), (3,-1) and (-1,3): the only attribute.
CORNER = "harness_corner"
_UNIT = f"({CORNER} * 0.5 + 0.5)"
# What a varying can run over, from the bottom left to the top right.
RANGES = {"unit": _UNIT, "ndc": CORNER}
_NDC = re.compile(r"ndc|pos|plane|clip|device|screen|point|vertex|coord_?n|xy$", re.IGNORECASE)
_UV = re.compile(r"uv|tex|st$", re.IGNORECASE)
_WIDEN = {"float": "{}.x", "vec2": "{}", "vec3": "vec3({}, 0.0)", "vec4": "vec4({}, 0.0, 1.0)"}


def synthesised(language: Language, varyings: Sequence[Varying],
                said: Mapping[str, object]) -> tuple[str, list[str]]:
    """A vertex shader that gives these varyings, and a note for each whose range its name does not tell.

    `said`: 'unit' (0 to 1) or 'ndc' (-1 to 1) by name. ShaderError, with file and line, for one that no full-screen
    triangle has.
    """
    lines = [language.line, *(["precision highp float;"] if language.es else []),
             f"{'attribute' if language.old else 'in'} vec2 {CORNER};"]
    body, notes = [], []
    for varying in varyings:
        if varying.kind not in _WIDEN or varying.flat:
            raise ShaderError(f"{varying.where}: '{varying.name}' ({varying.kind}) comes from a vertex shader that is "
                              "not here; name its file too, or compute it from gl_FragCoord")
        over = said.get(varying.name)
        if over not in RANGES:
            over = "ndc" if _NDC.search(varying.name) and not _UV.search(varying.name) else "unit"
            if not _UV.search(varying.name) and "coord" not in varying.name.lower():
                other = "ndc" if over == "unit" else "unit"
                notes.append(f"{varying.where}: '{varying.name}' is taken to run over "
                             f"{'0 to 1' if over == 'unit' else '-1 to 1'}; else say --set {varying.name}={other}")
        keyword = "varying" if language.old else f"{varying.layout}out"
        lines.append(f"{keyword} {varying.kind} {varying.name};")
        body.append(f"{varying.name} = {_WIDEN[varying.kind].format(RANGES[str(over)])};")
    lines.append(f"void main() {{ {' '.join(body)} gl_Position = vec4({CORNER}, 0.0, 1.0); }}")
    return "\n".join(lines) + "\n", notes


def authors(piece: Piece, language: Language) -> ShaderSource | None:
    """A vertex shader of somebody's, with the corner in place of its attributes; None where it draws a scene's
    triangles: where an attribute is no position and no texture coordinate, or a matrix moves them."""
    source = joined([piece], language.macros)
    found = declarations(source, language.macros, vertex=True)
    if any(uniform.kind.startswith("mat") for uniform in found.uniforms) or "gl_VertexID" in found.names:
        return None
    text, defines = source.text, {}
    for attribute in found.varyings:
        if attribute.kind not in _WIDEN or re.search(r"norm|col|tan|weight|index", attribute.name, re.IGNORECASE):
            return None
        over = _UNIT if _UV.search(attribute.name) and len(found.varyings) > 1 else CORNER
        defines[attribute.name] = _WIDEN[attribute.kind].format(over)
    text = re.sub(r"\b(?:layout\s*\([^)]*\)\s*)?(?:attribute|in)\s+(?:highp\s+|mediump\s+|lowp\s+)?\w+\s+(\w+)\s*;",
                  lambda match: hidden(match[0]) if match[1] in defines else match[0], text)
    if language.old or re.search(r"\battribute\b", text):
        defines.setdefault("attribute", "in") if not language.old else None
    if not language.old and re.search(r"\bvarying\b", text):
        defines["varying"] = "out"
    head = f"{'attribute' if language.old else 'in'} vec2 {CORNER};"
    return complete(ShaderSource(text, source.files), language, [head], defines)
