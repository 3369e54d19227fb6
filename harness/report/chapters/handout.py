"""The chapter on the handout's two pictures: rendered once at full count, kept, and what each took."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report import formats
from harness.report.blocks import Asset, Chapter, Paragraph, Picture, PictureRow, Pictures
from harness.report.inputs import Inputs
from harness.results import KeptPicture

PLACE = 28
TITLE, ANCHOR = "The handout's pictures", "handout"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where pictures were kept."""
    if not inputs.pictures:
        return
    words = ("The course's handout shows two scenes as this tracer is asked to render them. They were rendered once, "
             f"by harness gallery, and kept: {formats.words([_took(record) for record, _ in inputs.pictures])}. Noise "
             "that is left in them is that of the strategy of the course, which meets light by chance.")
    row = PictureRow(tuple(Picture(Asset(record.file, content), f"{record.scene}, {_count(record)}",
                                   f"{record.scene}, rendered with {_count(record)}")
                           for record, content in inputs.pictures))
    yield Chapter(TITLE, ANCHOR, (Paragraph(words), Pictures(
        "The handout's scenes, at their exposure, sRGB-encoded.", (row,), large=True)))


def _count(record: KeptPicture) -> str:
    """How many samples it has, and of how many, where the handout's picture had more."""
    of = f" of the handout's {formats.count(record.asked)}" if record.spp < record.asked else ""
    return f"{formats.count(record.spp)}{of} samples per pixel"


def _took(record: KeptPicture) -> str:
    device = f"{formats.duration(record.seconds)} of {record.device}" if record.device else "several devices"
    return (f"{record.scene}, {formats.count(record.width)}{formats.TIMES}{formats.count(record.height)} pixels, "
            f"{_count(record)} by {record.strategy}, took {device} ({record.date})")
