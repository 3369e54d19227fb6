"""Experiments on the author's own lines: what changes when one of them is taken out tells what it does.

Nothing is concluded from reading: a line is only where to try. Author's line numbers are kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from harness.shader.contract import Contract, ShaderPass
from harness.shader.language import with_own_precision as with_lower
from harness.shader.source import LINE_STRIDE, ShaderSource
from harness.shader.zero_init import zero_initialised
from harness.strangers.law import radiance_pass
from harness.strangers.single import EXPONENTS, Encoding

# Counted by a loop behind the author's own; a driver that has used up its iterations leaves it at once.
SENTINEL = 9
# Lines that are tried at the most, of each kind.
MOST_LINES = 6
# Characters of a line that a message shows.
MOST_SHOWN = 100
# What differs by less is rounding.
ALIKE = 1e-3

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_LINE = re.compile(r"^\s*#\s*line\s+(\d+)")
_OUTPUT = re.compile(r"^\s*(?:layout\s*\([^)]*\)\s*)?out\s+(?:(?:high|medium|low)p\s+)?vec4\s+(\w+)\s*;", re.MULTILINE)
_NUMBER = r"(\d+\.?\d*|\.\d+)f?"
_LITERAL = re.compile(rf"(?:vec3\s*\(\s*)?{_NUMBER}(?:\s*\))?")
# 1.0 / 2.2, .4545, 1.0 / gamma where somebody defines it: the first two.
_EXPONENT = re.compile(rf"(?:vec3\s*\(\s*)?(?:1\.?0*\s*/\s*{_NUMBER}|{_NUMBER})(?:\s*\))?")
_CALL = re.compile(r"\b(min|clamp|pow|sqrt)\s*\(")


@dataclass(frozen=True)
class Trial:
    """A contract without one call: `bound` is what it clamps to, `encoding` what it puts its argument through."""

    contract: Contract
    where: str
    line: str
    bound: float = 0.0
    encoding: Encoding = ""


def bare(text: str) -> str:
    """A text with its comments blank, everything in its place."""
    return _COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), text)


def places(source: ShaderSource) -> list[str]:
    """'file:line' of every line of a source's text; empty for those that a host wrote."""
    found, at = [], 0
    for line in source.text.splitlines():
        if directive := _LINE.match(line):
            at = int(directive[1])
            found.append("")
            continue
        file, number = divmod(at, LINE_STRIDE)
        known = 1 <= file <= len(source.files)
        found.append(f"{source.files[file - 1][0]}:{number}" if known else "")
        at += 1
    return found


def with_text(contract: Contract, text: str) -> Contract:
    """The contract with another text of the pass that holds radiance."""
    one = radiance_pass(contract)
    other = replace(one, source=replace(one.source, text=text))
    return replace(contract, passes=tuple(other if each is one else each for each in contract.passes))


def with_sentinel(contract: Contract) -> Contract | None:
    """The contract whose radiance is what a loop counted that follows the author's `main`; None where there is no
    output to write it to."""
    text = radiance_pass(contract).source.text
    flat = bare(text)
    output = _OUTPUT.search(flat)
    name = output[1] if output else "gl_FragColor" if "gl_FragColor" in flat else ""
    head = re.match(r"\s*#\s*version[^\n]*\n", text)
    if not name or not head:
        return None
    # What the author computed must count for something, or the compiler leaves it out.
    after = (f"\n#undef main\nuniform int sentinel_bound_;\nvoid main() {{ author_main_(); int counted_ = 0; "
             f"for (int i_ = 0; i_ < sentinel_bound_; ++i_) ++counted_; "
             f"{name} = vec4(float(counted_) + ({name}.x == 0.123456 ? 0.5 : 0.0)); }}\n")
    wrapped = with_text(contract, f"{head[0]}#define main author_main_\n#line 2\n{text[head.end():]}{after}")
    return replace(wrapped, values=(*contract.values, ("sentinel_bound_", SENTINEL)))


def with_zeros(contract: Contract) -> Contract:
    """The contract in which every variable starts at zero, in all passes."""
    def zeroed(one: ShaderPass) -> ShaderPass:
        version, end, rest = one.source.text.partition("\n")
        return replace(one, source=replace(one.source, text=f"{version}{end}{zero_initialised(rest)}"))

    return replace(contract, passes=tuple(zeroed(one) for one in contract.passes))


def with_own_precision(contract: Contract) -> Contract | None:
    """The contract in which mediump has 16 bits, as phones have it; None where nothing is said to be mediump."""
    texts = {one.name: with_lower(one.source.text) for one in contract.passes}
    if not any(texts.values()):
        return None
    return replace(contract, passes=tuple(
        replace(one, source=replace(one.source, text=texts[one.name] or one.source.text)) for one in contract.passes))


def writes(contract: Contract) -> bool:
    """Whether the text names its output at all besides declaring it, or its `mainImage` its colour."""
    flat = bare(radiance_pass(contract).source.text)
    if image := re.search(r"void\s+mainImage\s*\(\s*(?:out|inout)\s+(?:\w+\s+)?vec4\s+(\w+)[^{;]*\{", flat):
        return len(re.findall(rf"\b{image[1]}\b", flat[image.end():])) > 0
    output = _OUTPUT.search(flat)
    return not output or len(re.findall(rf"\b{output[1]}\b", flat)) > 1


def loops(contract: Contract) -> list[str]:
    """Places of the author's loops, those without a bound first."""
    source = radiance_pass(contract).source
    lines = list(zip(places(source), bare(source.text).splitlines(), strict=True))
    lines = [(where, line) for where, line in lines if where]
    endless = [where for where, line in lines if re.search(r"while\s*\(\s*true|for\s*\([^;]*;\s*;", line)]
    rest = [where for where, line in lines if re.search(r"\b(?:for|while)\s*\(", line)]
    return list(dict.fromkeys([*endless, *rest]))


def clamps(contract: Contract) -> Iterator[Trial]:
    """Trials without one `min(x, 1.0)` or `clamp(x, 0.0, 1.0)`, the last in the text first: clamps come late."""
    for where, start, end, name, arguments in _calls(contract):
        bound = arguments[-1].strip()
        if name not in ("min", "clamp") or len(arguments) != {"min": 2, "clamp": 3}[name]:
            continue
        kept = arguments[0]
        if name == "min" and _LITERAL.fullmatch(kept.strip()):
            bound, kept = kept.strip(), arguments[1]
        if (found := _LITERAL.fullmatch(bound)) and float(found[1]) > 0:
            yield _without(contract, start, end, kept, where, bound=float(found[1]))


def encodings(contract: Contract) -> Iterator[Trial]:
    """Trials without one `pow(x, vec3(1.0 / 2.2))` or `sqrt(x)`."""
    for where, start, end, name, arguments in _calls(contract):
        if name == "sqrt" and len(arguments) == 1:
            yield _without(contract, start, end, arguments[0], where, encoding="sqrt")
        elif name == "pow" and len(arguments) == 2 and (found := _EXPONENT.fullmatch(arguments[1].strip())):
            exponent = 1 / float(found[1]) if found[1] else float(found[2])
            near = min(EXPONENTS, key=lambda known: abs(1 / EXPONENTS[known] - exponent))
            if abs(1 / EXPONENTS[near] - exponent) < 0.02:
                yield _without(contract, start, end, arguments[0], where,
                               encoding="sqrt" if near == "sqrt" else "gamma")


def clamped(with_it: np.ndarray, without: np.ndarray, bound: float) -> float:
    """The share of samples that a clamp at `bound` cut, 0 unless the samples with and without it say that it did just
    that: nothing got darker without it, and what got brighter had been at the bound."""
    good = np.isfinite(with_it) & np.isfinite(without)
    brighter = good & (without > with_it * (1 + ALIKE) + 1e-6)
    darker = good & (without < with_it * (1 - ALIKE) - 1e-6)
    if not brighter.any() or darker.any():
        return 0.0
    at_bound = np.abs(with_it[brighter] - bound) < ALIKE * bound
    return float(brighter.mean()) if at_bound.mean() > 0.9 else 0.0


def is_encoded(with_it: np.ndarray, without: np.ndarray, encoding: Encoding) -> bool:
    """Whether the samples with a line are those without it, encoded, and that is not the same."""
    good = np.isfinite(with_it) & np.isfinite(without) & (without > 1e-6)
    if good.sum() < 0.05 * good.size:
        return False
    told = without[good]**(1 / EXPONENTS[encoding])
    alike = np.abs(with_it[good] - np.minimum(told, max(1.0, float(with_it[good].max())))) < ALIKE * (1 + told)
    same = np.abs(with_it[good] - without[good]) < ALIKE * (1 + without[good])
    return bool(alike.mean() > 0.98 and same.mean() < 0.5)


def _calls(contract: Contract) -> Iterator[tuple[str, int, int, str, list[str]]]:
    """Calls in the author's lines: where, from and to which character, the function, its arguments."""
    source = radiance_pass(contract).source
    flat, named = bare(source.text), places(source)
    for call in reversed(list(_CALL.finditer(flat))):
        where = named[flat.count("\n", 0, call.start())]
        arguments, end = _arguments(flat, call.end())
        if where and end:
            yield where, call.start(), end, call[1], arguments


def _arguments(text: str, start: int) -> tuple[list[str], int]:
    """The arguments of a call whose bracket opens before `start`, and where it ends; 0 where it does not."""
    depth, begin = 0, start
    found: list[str] = []
    for at in range(start, len(text)):
        character = text[at]
        if character in "([{":
            depth += 1
        elif character in ")]}":
            if depth == 0:
                return [*found, text[begin:at]], at + 1
            depth -= 1
        elif character == "," and depth == 0:
            found.append(text[begin:at])
            begin = at + 1
    return found, 0


def _without(contract: Contract, start: int, end: int, kept: str, where: str, *, bound: float = 0.0,
             encoding: Encoding = "") -> Trial:
    """The contract with a call replaced by one of its arguments."""
    text = radiance_pass(contract).source.text
    line = text.splitlines()[text.count("\n", 0, start)].strip()
    line = line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}…"
    return Trial(with_text(contract, f"{text[:start]}({kept}){text[end:]}"), where, line, bound, encoding)
