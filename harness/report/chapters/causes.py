"""The chapter on causes: how often a diagnosis of somebody's picture names what is wrong with the shader."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Paragraph, Remark, Remarks, Table
from harness.report.inputs import Inputs
from harness.studies.causes import CausesFile, CausesRecord

PLACE = 55
TITLE, ANCHOR = "Causes named", "causes"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where strangers were presented."""
    found = inputs.causes
    if found is not None and found.records:
        yield Chapter(TITLE, ANCHOR, (Paragraph(_words(found)), Remarks(_remarks(found)), _table(found),
                                      *([_missed(found)] if any(each.missed for each in found.records) else [])))


def _words(found: CausesFile) -> str:
    spp = formats.words([formats.count(each) for each in sorted({each.spp for each in found.records})])
    versions = formats.words([f"{name} {found.versions[name]}" for name in ("mitsuba", "drjit")])
    return (
        f"Where somebody's picture fails, the harness holds it against the pictures that {found.defects} known defects "
        "make of the same scene, and names the likeliest. Here each defect was presented as a stranger would have it: "
        "with another generator of random numbers, another basis or another order of draws, and, where the picture "
        "does not depend on that, with another strategy than the one its known picture is drawn with. Defects whose "
        "pictures cannot be told apart at the noise count as one. Visible are those whose picture is told from the "
        f"right one at {spp} samples per pixel. Right shaders, each with every strategy, were presented as well. "
        f"Measured on {found.date}, with {versions}; the command harness causes does it again.")


def _remarks(found: CausesFile) -> tuple[Remark, ...]:
    visible, first, three = (sum(counts) for counts in zip(*(
        (each.visible, each.first, each.three) for each in found.records), strict=True))
    right = sum(each.right for each in found.records)
    accused = [f"{one.shader} on {each.scene}" for each in found.records for one in each.accused]
    remarks = []
    if visible:
        shares = [formats.percent(count / visible, decimals=1) for count in (first, three)]
        remarks.append(Remark(f"Of {formats.count(visible)} visible strangers the cause of {shares[0]} is named first, "
                              f"and of {shares[1]} among three."))
    remarks.append(Remark(f"Of {formats.plural(right, 'right stranger')} none is accused." if not accused else
                          f"Of {formats.plural(right, 'right stranger')} {len(accused)} are accused: "
                          f"{formats.words(accused)}.", "fail" if accused else "pass"))
    return tuple(remarks)


def _table(found: CausesFile) -> Table:
    caption = "Strangers with a defect, and right ones. Shares: of the visible ones."
    columns = (Column("Scene", share=1), Column("Strangers", "right"), Column("Visible", "right"),
               Column("Named\nfirst", "right"), Column("Among\nthree", "right"), Column("Right\nones", "right"),
               Column("Accused", "right"), Column("CPU time", "right"))
    return Table(caption, columns, tuple(_row(each) for each in found.records), (0,))


def _row(each: CausesRecord) -> tuple[Cell, ...]:
    shares = (formats.percent(count / each.visible, decimals=1) if each.visible else formats.MISSING
              for count in (each.first, each.three))
    return (Cell(each.scene), *(Cell(formats.count(count)) for count in (each.presented, each.visible)),
            *(Cell(share) for share in shares), Cell(formats.count(each.right)),
            Cell(formats.count(len(each.accused)) if each.accused else formats.MISSING),
            Cell(formats.duration(each.seconds)))


def _missed(found: CausesFile) -> Table:
    rows = [(Cell(each.scene), Cell(one.defect), Cell(one.strategy), Cell(one.disguise or formats.MISSING),
             Cell(str(one.rank) if one.rank else formats.MISSING), Cell(one.told or "none of the known causes"))
            for each in found.records for one in each.missed]
    caption = "Strangers whose cause does not come first. Place: of the cause among the three that are told."
    columns = (Column("Scene"), Column("Defect", share=1), Column("Strategy"), Column("Otherwise"),
               Column("Place", "right"), Column("Told first", share=1))
    return Table(caption, columns, tuple(rows), (0,), long=True)
