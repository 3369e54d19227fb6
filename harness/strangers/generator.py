"""Other random numbers in place of the author's: a picture that changes with them was made by their faults.

A generator that repeats itself from one bounce to the next, or whose numbers are bound to each other, shows in no
frame's noise: each is as rough as it should be, and the mean is wrong. So the numbers that an author's own functions
return are exchanged for those of PCG, and the picture must stay what it was.
"""

from __future__ import annotations

import re
from dataclasses import replace

from harness.shader.contract import Contract, Declared
from harness.strangers.law import radiance_pass
from harness.strangers.lines import bare, places, with_text

FRAME = "harness_frame_"
# A function that is called for a random number, by its name and by what it takes: nothing, or a state that it changes.
# A hash of a place alone may be a texture's, which must not change.
_FUNCTION = re.compile(r"\b(float|vec[234])\s+(\w*(?:rand|rnd|rng|hash|noise)\w*)\s*"
                       r"\(\s*((?:void)?|inout\s[^)]*)\)\s*\{", re.IGNORECASE)
# What makes a number lie in 0 to 1: the part behind the point, or a division by the largest integer.
_UNIT = re.compile(r"\bfract\s*\(|/\s*(?:float\s*\(\s*)?(?:0x[7f]f{7}|4294967\d{3}|2147483\d{3}|16777216)|"
                   r"\*\s*\(?\s*1\.0*\s*/\s*(?:4294967\d{3}|16777216)", re.IGNORECASE)
# What moves it out of that range.
_MOVED = re.compile(r"-\s*(?:vec[234]\s*\(\s*)?(?:0?\.5|1\.?0*)\b|"
                    r"\*\s*(?:vec[234]\s*\(\s*)?(?:2\.|6\.28|PI|TAU|TWO_PI)", re.IGNORECASE)
_PCG = ("uint harness_state_ = 0u; float harness_number_() {{ if (harness_state_ == 0u) {{ uvec2 at = "
        "uvec2(gl_FragCoord.xy); uint h = at.x * 1664525u + at.y * 1013904223u + uint({frame}) * 2654435769u; "
        "h ^= h >> 16u; h *= 2146121005u; h ^= h >> 15u; h *= 2221713035u; h ^= h >> 16u; harness_state_ = h | 1u; }} "
        "harness_state_ = harness_state_ * 747796405u + 2891336453u; uint w = ((harness_state_ >> ((harness_state_ >> "
        "28u) + 4u)) ^ harness_state_) * 277803737u; w = (w >> 22u) ^ w; return float(w >> 8u) / 16777216.0; }} ")


def with_other_numbers(contract: Contract) -> tuple[Contract, str] | None:
    """The contract with PCG's numbers in place of its own, and where its own are made ('file:line', the first of them);
    None where no function of it surely makes them, or where its language has no whole numbers to shift."""
    one = radiance_pass(contract)
    text = one.source.text
    if re.match(r"\s*#version\s+100\b", text):
        return None
    flat, named = bare(text), places(one.source)
    found = [(start, end, kind) for start, end, kind in _generators(flat) if named[flat.count("\n", 0, start)]]
    if not found:
        return None
    for number, (start, end, kind) in reversed(list(enumerate(found))):
        brace = text.index("{", start)
        parts = ", ".join(["harness_number_()"] * (1 if kind == "float" else int(kind[-1])))
        lines = "\n" * text.count("\n", brace, end)
        head = _PCG.format(frame=FRAME) if number == 0 else ""
        head = f"uniform int {FRAME}; {head}" if number == 0 else ""
        text = f"{text[:start]}{head}{text[start:brace]}{{ return {kind}({parts}); {lines}}}{text[end:]}"
    changed = with_text(contract, text)
    other = radiance_pass(changed)
    other = replace(other, uniforms=(*other.uniforms, Declared(FRAME, "int", "")),
                    roles=(*other.roles, (FRAME, "frame")))
    passes = tuple(other if each.name == other.name else each for each in changed.passes)
    return replace(changed, passes=passes), named[flat.count("\n", 0, found[0][0])]


def _generators(text: str) -> list[tuple[int, int, str]]:
    """From and to which character each function stands that makes numbers from 0 to 1 of a state, and what it returns;
    nothing where one of them may be no such function: some of the numbers would stay the author's."""
    found = []
    for function in _FUNCTION.finditer(text):
        depth, end = 1, function.end()
        while depth and end < len(text):
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        found.append((function.start(), end, function[1], text[function.end():end]))
    names = re.compile("|".join(rf"\b{function[2]}\s*\(" for function in _FUNCTION.finditer(text)) or r"(?!)")
    own = [one for one in found if not names.search(one[3])]  # others go on from those, which are exchanged
    sure = all(_UNIT.search(inside) and not _MOVED.search(inside.rpartition("return")[2]) for *_, inside in own)
    return [(start, end, kind) for start, end, kind, _ in own] if sure else []
