"""From what was measured to the files of a report: PDF, HTML, their data as JSON, and the figures one by one."""

from __future__ import annotations

import datetime
import os
from concurrent.futures import ThreadPoolExecutor
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
    with spent("chapters"):
        document = compose(inputs)
        assets = document.assets()
        document.json()
    with ThreadPoolExecutor(1) as beside:  # the typesetter lets other threads run
        pdf = beside.submit(typeset, document)
        with spent("HTML"):
            page = html_page(document).encode()
        with spent("PDF"):
            figures = {f"{FIGURES_FOLDER}/{name}": content for name, content in assets.items()}
            files = {**figures, DATA_FILE: document.json().encode(), HTML_FILE: page, PDF_FILE: pdf.result()}
    for name, content in files.items():
        if _holds(output / name, content):
            continue
        with write_atomically(output / name) as partial:
            partial.write_bytes(content)
    for path in (output / FIGURES_FOLDER).iterdir():  # of scenes and strategies that an earlier report had
        if path.suffix in (".png", ".jpg", ".svg") and path.name not in assets:
            path.unlink(missing_ok=True)
    return output / PDF_FILE


def _holds(path: Path, content: bytes) -> bool:
    """Is that what the file says already? To replace five hundred takes half a second."""
    try:
        return path.stat().st_size == len(content) and path.read_bytes() == content
    except OSError:
        return False


def compose(inputs: Inputs) -> Document:
    """The report as plain values, with its images and figures."""
    return Document(TITLE, f"Validation report, {inputs.profile} profile", _today(), tuple(chapters(inputs)))


def _today() -> str:
    """The date of the report, or SOURCE_DATE_EPOCH where a reproducible build sets it (reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = (datetime.datetime.fromtimestamp(int(epoch), datetime.UTC) if epoch.isdigit()
              else datetime.datetime.now())
    return f"{moment.day} {moment:%B %Y}"
