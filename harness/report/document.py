"""From what was measured to the files of a report: PDF, HTML, their data as JSON, and the figures one by one."""

from __future__ import annotations

import datetime
import os
from pathlib import Path

from harness.files import require_writable, write_atomically
from harness.report.blocks import Document
from harness.report.chapters import chapters
from harness.report.inputs import Inputs
from harness.report.pages.html import html_page
from harness.report.pages.typst import typeset
from harness.samples.spent import spent

TITLE = "GLSL path tracer against Mitsuba 3"

PDF_FILE, HTML_FILE, DATA_FILE, FIGURES_FOLDER = "report.pdf", "report.html", "report.json", "figures"


def build_report(inputs: Inputs, output_dir: str | Path) -> Path:
    """Write `report.pdf`, `report.html`, `report.json` and `figures/` to `output_dir`; returns the PDF's path.

    Every file is replaced as a whole. HarnessError where the folder cannot be written, or inputs are damaged.
    """
    output = Path(output_dir)
    require_writable(output / PDF_FILE)
    with spent("figures"):
        document = compose(inputs)
        assets = document.assets()
    with spent("PDF"):
        pdf = typeset(document)
    figures = {f"{FIGURES_FOLDER}/{name}": content for name, content in assets.items()}
    files = {**figures, DATA_FILE: document.json(indent=1).encode(), HTML_FILE: html_page(document).encode(),
             PDF_FILE: pdf}
    for name, content in files.items():
        with write_atomically(output / name) as partial:
            partial.write_bytes(content)
    for path in (output / FIGURES_FOLDER).iterdir():  # of scenes and strategies that an earlier report had
        if path.suffix in (".png", ".jpg", ".svg") and path.name not in assets:
            path.unlink(missing_ok=True)
    return output / PDF_FILE


def compose(inputs: Inputs) -> Document:
    """The report as plain values, with its images and figures."""
    return Document(TITLE, f"Validation report, {inputs.profile} profile", _today(), tuple(chapters(inputs)))


def _today() -> str:
    """The date of the report, or SOURCE_DATE_EPOCH where a reproducible build sets it (reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = (datetime.datetime.fromtimestamp(int(epoch), datetime.UTC) if epoch.isdigit()
              else datetime.datetime.now())
    return f"{moment.day} {moment:%B %Y}"
