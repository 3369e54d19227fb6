"""One page, or one JSON file, that shows all gates of a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from urllib.parse import quote

from harness.files import write_atomically
from harness.gates.left import ALL_PICTURES, PICTURES
from harness.gates.records import as_json
from harness.report.pages.frame import framed
from harness.results import GateNumbers, GateRecord
from harness.stats.bias import percent

HTML, JSON = "summary.html", "summary.json"
KINDS = ("html", "json")
# What failed stands first, as it does in what people look for.
ORDER = ("fail", "error", "inconclusive", "pass")


def write_summary(results: Sequence[GateRecord], folder: Path, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Write summary.html and summary.json, as asked, into `folder`, where each gate has a folder of its name; one that
    was not asked for is removed, since it would show an earlier run.

    Returns the files. StoreError when one cannot be written.
    """
    ordered = sorted(results, key=lambda result: ORDER.index(result.outcome))
    texts = {"html": lambda: _page(ordered, folder),
             "json": lambda: json.dumps({"gates": [as_json(result) for result in ordered]}, indent=2) + "\n"}
    written = []
    for kind, name in zip(KINDS, (HTML, JSON), strict=True):
        if kind in kinds:
            with write_atomically(folder / name) as partial:
                partial.write_text(texts[kind](), encoding="utf-8")
            written.append(folder / name)
        else:
            with suppress(OSError):
                (folder / name).unlink()
    return written


def counted(results: Sequence[GateRecord]) -> str:
    """'2 fail, 40 pass'."""
    outcomes = [result.outcome for result in results]
    return ", ".join(f"{outcomes.count(outcome)} {outcome}" for outcome in ORDER if outcome in outcomes) or "none"


def _page(results: Sequence[GateRecord], folder: Path) -> str:
    sections = "\n".join(_section(result, folder) for result in results
                         if result.outcome != "pass" or (folder / result.gate / PICTURES[0]).exists())
    heads = "".join(f'<th class="right">{head}</th>' for head in (
        "mean error", "interval", "tolerance", "sure to fail from", "in the noisiest tile", "samples / pixel", "s"))
    body = (f"<h1>Gates</h1>\n<p>{escape(counted(results))}</p>\n"
            f'<div class="scroll"><table>\n<tr><th>gate</th><th>outcome</th>{heads}<th>why this tolerance</th></tr>\n'
            + "\n".join(_row(result) for result in results) + f"\n</table></div>\n{sections}")
    return framed("Gates", Path(__file__).with_name("summary.css").read_text(encoding="utf-8"), body)


def _row(result: GateRecord) -> str:
    name, outcome = escape(result.gate), result.outcome
    linked = name if outcome == "pass" else f'<a href="#{quote(result.gate)}">{name}</a>'
    cells = ["–"] * 7
    if numbers := result.numbers:
        mean, fine = numbers.tests["mean"], numbers.tests["fine"]
        error, low, high = (percent(value, signed=True) for value in numbers.luminance)
        cells = [error, f"{low} to {high}", f"±{percent(mean.tolerance)}", percent(mean.smallest_detectable),
                 percent(fine.smallest_detectable), f"{numbers.samples} of {numbers.budget}",
                 f"{numbers.seconds:.1f}"]
    columns = "".join(f'<td class="right">{cell}</td>' for cell in cells)
    return (f'<tr><td>{linked}</td><td class="{outcome}">{outcome}</td>{columns}'
            f"<td>{escape(result.why or result.reason)}</td></tr>")


def _section(result: GateRecord, folder: Path) -> str:
    name = escape(result.gate)
    lines = [f'<h2 id="{name}">{name} <span class="{result.outcome}">{result.outcome}</span></h2>',
             f"<p>{escape(result.reason)}</p>"]
    if result.command:
        lines += [f"<p><code>{escape(result.command)}</code></p>",
                  f'<p class="soft">{escape(result.why)} ({escape(result.origin)})</p>']
    if result.ladder:
        lines.append(_ladder(result))
    if result.autopsy:
        lines.append(f'<pre class="scroll">{escape(result.autopsy)}</pre>')
    if result.numbers:
        lines += [_tests(result.numbers),
                  '<div class="pictures">', *(_figure(result.gate, picture) for picture in ALL_PICTURES
                                              if (folder / result.gate / picture).exists()), "</div>"]
    return "\n".join(lines)


def _tests(numbers: GateNumbers) -> str:
    names = {"mean": "the image", "coarse": "larger tiles", "fine": "smaller tiles"}
    rows = "".join(f'<tr><td>{names[key]}</td><td class="{test.outcome}">{test.outcome}</td>'
                   f'<td class="right">{percent(test.largest_error)}</td>'
                   f'<td class="right">±{percent(test.tolerance)}</td>'
                   f"<td>{escape(test.reason)}</td></tr>" for key, test in numbers.tests.items())
    if agreement := numbers.agreement:
        rows += (f'<tr><td>single samples</td><td class="{agreement.outcome}">{agreement.outcome}</td>'
                 f'<td class="right">{percent(agreement.share)}</td><td class="right">{percent(agreement.tolerance)}'
                 f"</td><td>{escape(agreement.reason)}</td></tr>")
    return ('<div class="scroll"><table><tr><th>test</th><th>outcome</th><th class="right">largest error</th>'
            f'<th class="right">tolerance</th><th>reason</th></tr>{rows}</table></div>')


def _ladder(result: GateRecord) -> str:
    rows = "".join(f'<tr><td class="right">{rung.depth}</td><td class="{rung.outcome}">{rung.outcome}</td>'
                   f'<td class="right">{percent(rung.error, signed=True) if rung.error is not None else "–"}</td>'
                   f"<td>{escape(rung.reason)}</td></tr>" for rung in result.ladder)
    return ('<div class="scroll"><table><tr><th class="right">depth</th><th>outcome</th>'
            f'<th class="right">mean error</th><th>reason</th></tr>{rows}</table></div>')


def _figure(gate: str, picture: str) -> str:
    smooth = "" if picture in ("test.png", "reference.png") else ' class="smooth"'
    caption = picture.rpartition(".")[0].replace("-", " ")
    path = quote(f"{gate}/{picture}")
    return (f'<figure><a href="{path}"><img{smooth} src="{path}" alt="{caption}"></a>'
            f"<figcaption>{caption}</figcaption></figure>")
