"""What the report says of each exhibit: the words of texts.toml around measured numbers."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.results import Exhibit, ExhibitImage, Finding, Plot


@dataclass(frozen=True)
class Text:
    """The words of one exhibit, as texts.toml has them."""

    title: str
    file: str
    handout: str
    right: str
    size: str
    effect: str
    advice: str


TEXTS_FILE = Path(__file__).with_name("texts.toml")
TEXTS = {id: Text(**words) for id, words in tomllib.loads(TEXTS_FILE.read_text(encoding="utf-8")).items()}


def exhibit(id: str, findings: Sequence[Finding], images: Sequence[ExhibitImage] = (), plots: Sequence[Plot] = (),
            message: str = "", **numbers: float) -> Exhibit:
    """The exhibit of that id: its text with the measured numbers in their places, and what was found."""
    text = TEXTS[id]
    return Exhibit(id, text.title, text.file, text.handout, text.right, text.size.format(**numbers),
                   text.effect.format(**numbers), text.advice, tuple(findings), tuple(images), tuple(plots), message)
