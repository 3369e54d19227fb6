"""The abstract, which stands first: the verdict and the main numbers in one paragraph."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report.blocks import Chapter, Paragraph
from harness.report.headline import headline
from harness.report.inputs import Inputs
from harness.report.texts import filled, read

PLACE = -10
TEXT = "abstract.toml"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """What stands under the report's title."""
    told = headline(inputs)
    sentences = [filled(each["en"], told[each["topic"]], TEXT) for each in read(TEXT)["sentence"]
                 if each["topic"] in told]
    yield Chapter("", "", (Paragraph(" ".join(sentences), "Abstract."),))
