"""The report's chapter on seeded bugs: which gates noticed which of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Paragraph, Remark, Remarks, Table
from harness.report.inputs import Inputs
from harness.results import KillRecord

PLACE = 50
TITLE, ANCHOR = "Bugs that must die", "mutants"
# Of the gates that killed a mutant, the table names so many.
NAMED = 3


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where mutants were run."""
    if inputs.mutants is not None:
        record = inputs.mutants
        yield Chapter(TITLE, ANCHOR, (Paragraph(_introduction(record)), Remarks(_remarks(record)), _gates(record),
                                      _mutants(record)))


def _introduction(record: KillRecord) -> str:
    return (
        f"{formats.plural(len(record.mutants), 'one-line defect')} of the shader, each with where it was seen: in the "
        "handout, in a bug report of a public renderer, or made small on purpose, to measure how small a defect "
        "may be. Each was put into the shader by itself, and the gates were run. A gate that passes tells little; "
        "that it fails when it should, is what this chapter shows. Image gates compare renders with the reference: "
        "at a glance, with few samples, first the one that should notice the defect, then others until it is "
        "plain how many would; the first, and all if none has noticed it yet, with as much as it takes. Test modules "
        "evaluate one part of the shader library.")


def _remarks(record: KillRecord) -> tuple[Remark, ...]:
    survivors, missed, idle = (list(names) for names in (record.survivors, record.missed, record.idle))
    killed = len(record.mutants) - len(survivors)
    remarks = [Remark(f"{killed} of {formats.plural(len(record.mutants), 'mutant')} killed.",
                      "fail" if survivors else "pass")]
    if survivors:
        remarks.append(Remark(f"Not noticed by any gate: {formats.words(survivors)}.", "fail"))
    if missed:
        remarks.append(Remark("Killed, but not by the gate that the catalogue expects: "
                              f"{formats.words(missed)}.", "warning"))
    if idle:
        remarks.append(Remark(f"Gates that killed nothing: {formats.words(idle)}.", "warning"))
    return tuple(remarks)


def _gates(record: KillRecord) -> Table:
    rows = []
    for gate in record.gates:
        states = [each.states[gate] for each in record.mutants]
        if set(states) == {"not run"}:
            continue
        alone = sum(each.states[gate] == "killed" and list(each.states.values()).count("killed") == 1
                    for each in record.mutants)
        rows.append((Cell(gate), *(Cell(formats.count(states.count(state)) if states.count(state) else formats.MISSING)
                                   for state in ("killed", "survived", "untouched")),
                     Cell(formats.count(alone) if alone else formats.MISSING)))
    caption = ("What each gate makes of the mutants that it was shown. Survived: it saw other pixels and did not "
               "object, which many gates need not do, for a small defect is left to the gate that is meant for it. "
               "Untouched: the defect lies in code that the gate's scene does not use. Alone: killed by no other gate "
               "that was asked.")
    columns = (Column("Gate", share=1), Column("Killed", "right"), Column("Survived", "right"),
               Column("Untouched", "right"), Column("Alone", "right"))
    return Table(caption, columns, tuple(rows), long=True)


def _mutants(record: KillRecord) -> Table:
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    topic = ""
    for each in record.mutants:
        if each.topic != topic:
            topic = each.topic
            rules.append(len(rows))
        killers = [gate for gate in record.gates if each.states[gate] == "killed"]
        rows.append((Cell(each.id), Cell(each.imitates), Cell(each.origin), _killers(killers, each.killer)))
    caption = ("All mutants, by the part of the shader: what each imitates, where it was seen, and which gates killed "
               "it, first the one that the catalogue expects.")
    return Table(caption, (Column("Mutant"), Column("Imitates", share=5), Column("Origin", share=5),
                           Column("Killed by", share=4)), tuple(rows), tuple(rules), long=True)


def _killers(killers: Sequence[str], expected: str) -> Cell:
    if not killers:
        return Cell("nothing", "fail")
    ordered = sorted(killers, key=lambda gate: gate != expected)
    more = len(ordered) - NAMED
    return Cell(", ".join(ordered[:NAMED]) + (f" and {more} more" if more > 0 else ""), "pass")
