"""An autopsy as text: what is wrong first, where, how much, and one path's numbers side by side."""

from __future__ import annotations

from collections.abc import Iterator

from harness.diagnosis.record import AutopsyRecord, Row, StageRecord

# Of a share of paths, from none to all.
SHADES = " .:-=+*#%@"
# Numbers of a row that are shown; the rest is in the JSON.
SHOWN = 6


def lines(found: AutopsyRecord) -> Iterator[str]:
    """The lines of the report."""
    width, height = found.size
    yield (f"{found.scene}, {found.strategy}: {found.paths} paths, {found.samples} of each of {width} x {height} "
           "pixels, step by step beside Mitsuba's")
    yield from (f"asked otherwise: {note}" for note in found.notes)
    yield from _scatter(found)
    if found.stage is None:
        yield "no stage differs"
        yield from _stages(found)
        return
    stage = next((each for each in found.stages if each.stage == found.stage), None)
    yield ""
    if stage is not None:
        yield f"FIRST DIFFERENCE: {stage.stage}: {stage.asks}"
        yield from _how_much(found, stage)
    for number, place in enumerate(found.places):
        lead = "computed by" if number == 0 else "or by"
        yield f"  {lead} {place.function}, {place.file}:{place.line}: {place.text}"
    yield from _where(found)
    yield from _path(found)
    yield ""
    yield from _stages(found)


def _how_much(found: AutopsyRecord, stage: StageRecord) -> Iterator[str]:
    if found.shift is not None:
        shift = found.shift
        yield (f"  all answers on {shift.name or f'shape {shift.shape}'} are off alike: {shift.median:+.3e} of "
               f"themselves, +- {shift.error:.0e}; too little for one of them to tell")
        return
    if not stage.first:
        return
    yield (f"  {stage.first} of {found.paths} paths ({stage.first / found.paths:.2%}) differ here first; by "
           f"{stage.largest:.3g} at most ({stage.measure}), where {stage.tolerance:g} is rounding")
    if found.vertices:
        yield "  " + ", ".join(f"{count} at vertex {vertex + 1}" for vertex, count in found.vertices.items())


def _where(found: AutopsyRecord) -> Iterator[str]:
    if found.where is None:
        return
    left, top, right, bottom = found.where.box
    column, row = found.where.pixel
    yield (f"  in {found.where.pixels} pixels between ({left}, {top}) and ({right}, {bottom}), counted from the top "
           f"left; most at ({column}, {row}): {found.where.share:.0%} of its paths")
    for band in found.where.map:
        cells = "".join(SHADES[min(len(SHADES) - 1, -(-int(share * 1e6) * (len(SHADES) - 1) // 1_000_000))]
                        for share in band)
        yield f"    |{cells}|"


def _path(found: AutopsyRecord) -> Iterator[str]:
    if not found.path:
        return
    yield ""
    yield "one such path, side by side:"
    yield f"  {'stage':<12}{'vertex':>6}  {'the shader':<58}{'should be'}"
    for row in found.path:
        yield f"{'!' if row.differs else ' '} {row.stage:<12}{row.vertex + 1:>6}  {_numbers(row, mine=True):<58}" \
              f"{_numbers(row, mine=False)}"


def _numbers(row: Row, *, mine: bool) -> str:
    """The row's numbers; of many, those that differ most."""
    order = range(len(row.shader))
    if len(row.shader) > SHOWN:
        apart = [abs(a - b) if a == a and b == b else float("inf")
                 for a, b in zip(row.shader, row.expected, strict=True)]
        order = sorted(sorted(order, key=lambda index: -apart[index])[:SHOWN])  # type: ignore[assignment]
    values = row.shader if mine else row.expected
    return " ".join(_number(values[index]) for index in order)


def _number(value: float) -> str:
    """Six digits; of whole numbers all, which may be 32 bits."""
    return f"{value:.0f}" if abs(value) < 2**32 and value == int(value) else f"{value:.6g}"


def _scatter(found: AutopsyRecord) -> Iterator[str]:
    if found.scatter is not None:
        tested = found.scatter
        yield (f"scattering at {tested.vertices} vertices against what it should be: {tested.difference:+.2e} +- "
               f"{tested.error:.1e} of the whole, {tested.largest:.1f} standard errors in the worst cell: "
               f"{'DIFFERS' if tested.fails else 'no difference found'}")


def _stages(found: AutopsyRecord) -> Iterator[str]:
    yield f"  {'stage':<12}{'asked':>9}{'differ':>9}{'first':>9}"
    for stage in found.stages:
        mark = "!" if stage.stage == found.stage else " "
        yield f"{mark} {stage.stage:<12}{stage.asked:>9}{stage.differs:>9}{stage.first:>9}"
