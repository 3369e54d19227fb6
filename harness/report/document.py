"""From study results to the files of a report: PDF, HTML, their data as JSON, and the figures one by one."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typst

from harness.errors import HarnessError
from harness.files import data_dir, require_writable, write_atomically
from harness.report.calibration import calibration_chapter
from harness.report.content import SYMBOLS, Document
from harness.report.exhibits import exhibits_chapter
from harness.report.html import html_page
from harness.report.mutants import mutants_chapter
from harness.report.provenance import provenance_tables, speed_table
from harness.report.sections import Assets, scene_section, shared_assets
from harness.report.style import font_folder
from harness.report.tables import verdict_table
from harness.report.words import reading, summary
from harness.results import Exhibit, StudyResult
from harness.stats.calibration import Calibration

TITLE = "GLSL path tracer against Mitsuba 3"
TEMPLATE = "report.typ"

PDF_FILE, HTML_FILE, DATA_FILE, FIGURES_FOLDER = "report.pdf", "report.html", "report.json", "figures"


def build_report(results: Sequence[StudyResult], output_dir: str | Path, *, profile: str,
                 bench: Mapping[str, Any] | None = None, elapsed: Mapping[str, float] | None = None,
                 exhibits: Sequence[Exhibit] = (), calibration: Calibration | None = None,
                 mutants: Mapping[str, Any] | None = None) -> Path:
    """Write `report.pdf`, `report.html`, `report.json` and `figures/` to `output_dir`; returns the PDF's path.

    `profile`: the word for how thorough the studies were. `bench`: see `provenance.speed_table`. `elapsed`: wall-clock
    seconds of the steps before this one, by name. `exhibits`: the handout's errors, if measured; `calibration`:
    the verdicts' own errors, if measured; `mutants`: see `mutants.mutants_chapter`. Every file is replaced as a whole.
    HarnessError without results, for two results of one scene, or where the folder cannot be written.
    """
    output = Path(output_dir)
    require_writable(output / PDF_FILE)
    document = compose(results, profile=profile, bench=bench, elapsed=elapsed, exhibits=exhibits,
                       calibration=calibration, mutants=mutants)
    pdf = typeset(document)
    figures = {f"{FIGURES_FOLDER}/{name}": content for name, content in document.assets.items()}
    files = {**figures, DATA_FILE: document_json(document, indent=1).encode(),
             HTML_FILE: html_page(document).encode(), PDF_FILE: pdf}
    for name, content in files.items():
        with write_atomically(output / name) as partial:
            partial.write_bytes(content)
    for path in (output / FIGURES_FOLDER).iterdir():  # of scenes and strategies that an earlier report had
        if path.suffix in (".png", ".svg") and path.name not in document.assets:
            path.unlink(missing_ok=True)
    return output / PDF_FILE


def compose(results: Sequence[StudyResult], *, profile: str, bench: Mapping[str, Any] | None = None,
            elapsed: Mapping[str, float] | None = None, exhibits: Sequence[Exhibit] = (),
            calibration: Calibration | None = None, mutants: Mapping[str, Any] | None = None) -> Document:
    """The report as plain values, with its images and figures."""
    names = [result.scene for result in results]
    if not results:
        raise HarnessError("a report needs at least one study, found none; run 'harness study' first")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise HarnessError(f"two studies of a scene called '{twice}'; give each scene of a report its own name")
    anchors = _anchors(names)
    assets: Assets = shared_assets()
    sections = []
    for result, anchor in zip(results, anchors, strict=True):
        section, own = scene_section(result, anchor)
        sections.append(section)
        assets |= own
    chapter, own = exhibits_chapter(exhibits)
    assets |= own
    trust, own = calibration_chapter(calibration)
    assets |= own
    return Document(
        title=TITLE, subtitle=f"Validation report, {profile} profile", date=_today(), summary=summary(results),
        verdicts=verdict_table(results, anchors), reading=reading(), scenes=tuple(sections),
        speed=speed_table(bench) if bench else None,
        provenance=provenance_tables(results, profile, elapsed or {}), assets=assets,
        exhibits=chapter, calibration=trust, mutants=mutants_chapter(mutants))


def document_json(document: Document, indent: int | None = None) -> str:
    """The document's words and tables as JSON, without the bytes of its assets."""
    plain = {field.name: getattr(document, field.name) for field in dataclasses.fields(document)
             if field.name != "assets"}
    return json.dumps({**plain, "symbols": SYMBOLS}, default=dataclasses.asdict, ensure_ascii=False, indent=indent)


def typeset(document: Document) -> bytes:
    """The document as PDF."""
    template = (data_dir("reports") / TEMPLATE).read_bytes()
    files = {TEMPLATE: template, "report.json": document_json(document).encode(), **document.assets}
    # The figures' text was measured with fonts that matplotlib carries; system fonts would make pages differ between
    # machines.
    with tempfile.TemporaryDirectory(prefix="report-") as folder:  # typst takes text from memory, but not images
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        return bytes(typst.compile(str(Path(folder, TEMPLATE)), root=folder, font_paths=[str(font_folder())],
                                   ignore_system_fonts=True, format="pdf"))


def _anchors(names: Sequence[str]) -> list[str]:
    """Names fit for files and links, all different."""
    anchors: list[str] = []
    for name in names:
        anchor = base = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "scene"
        number = 2
        while anchor in anchors:
            anchor, number = f"{base}-{number}", number + 1
        anchors.append(anchor)
    return anchors


def _today() -> str:
    """The date of the report, or SOURCE_DATE_EPOCH where a reproducible build sets it (reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = (datetime.datetime.fromtimestamp(int(epoch), datetime.UTC) if epoch.isdigit()
              else datetime.datetime.now())
    return f"{moment.day} {moment:%B %Y}"
