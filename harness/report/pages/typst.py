"""The report as PDF: the same document as the HTML page, set by reports/report.typ."""

from __future__ import annotations

import hashlib
import tempfile
from importlib import metadata
from pathlib import Path

import typst

from harness.files import data_dir
from harness.report.blocks import Document
from harness.report.figures.style import font_folder
from harness.samples.keys import code_digest, folder_digest
from harness.samples.memo import remembered_bytes

TEMPLATE = "report.typ"


def typeset(document: Document) -> bytes:
    """The document as PDF; read back where the same was set before, with the same fonts by the same typesetter."""
    template = (data_dir("reports") / TEMPLATE).read_bytes()
    files = {TEMPLATE: template, "report.json": document.json().encode(), **document.assets()}
    key = [code_digest(__name__), metadata.version("typst"), folder_digest(font_folder(), ".ttf"),
           {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}]
    return remembered_bytes("pages", key, lambda: _compiled(files))


def _compiled(files: dict[str, bytes]) -> bytes:
    # The figures' text was measured with fonts that matplotlib carries; system fonts would make pages differ between
    # machines.
    with tempfile.TemporaryDirectory(prefix="report-") as folder:  # typst takes text from memory, but not images
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        return bytes(typst.compile(str(Path(folder, TEMPLATE)), root=folder, font_paths=[str(font_folder())],
                                   ignore_system_fonts=True, format="pdf"))
