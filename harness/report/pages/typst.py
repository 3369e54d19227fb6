"""The report as PDF: the same document as the HTML page, set by reports/report.typ."""

from __future__ import annotations

import tempfile
from pathlib import Path

import typst

from harness.files import data_dir
from harness.report.blocks import Document
from harness.report.figures.style import font_folder

TEMPLATE = "report.typ"


def typeset(document: Document) -> bytes:
    """The document as PDF."""
    template = (data_dir("reports") / TEMPLATE).read_bytes()
    files = {TEMPLATE: template, "report.json": document.json().encode(), **document.assets()}
    # The figures' text was measured with fonts that matplotlib carries; system fonts would make pages differ between
    # machines.
    with tempfile.TemporaryDirectory(prefix="report-") as folder:  # typst takes text from memory, but not images
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        return bytes(typst.compile(str(Path(folder, TEMPLATE)), root=folder, font_paths=[str(font_folder())],
                                   ignore_system_fonts=True, format="pdf"))
