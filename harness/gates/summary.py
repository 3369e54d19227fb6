"""One page, or one JSON file, that shows all gates of a run."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from urllib.parse import quote

from harness.files import write_atomically
from harness.gates.artefacts import PICTURES
from harness.gates.records import as_json
from harness.results import GateNumbers, GateRecord

HTML, JSON = "summary.html", "summary.json"
KINDS = ("html", "json")
# What failed stands first, as it does in what people look for.
ORDER = ("fail", "error", "inconclusive", "pass")

_STYLE = """
:root { --ink: #1c1c1c; --soft: #5a5a5a; --rule: #d5d5d5; }
body { font: 15px/1.45 Georgia, "Times New Roman", serif; color: var(--ink); background: #f2f2ef; margin: 0; }
main { max-width: 72rem; margin: 0 auto; padding: 2rem 2.5rem 4rem; background: #fff; }
h1 { font-size: 1.7rem; margin: 0; }
h2 { margin: 2.5rem 0 .3rem; border-top: 2px solid var(--ink); padding-top: .5rem; }
p { margin: .3rem 0; } .soft { color: var(--soft); }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-size: .85rem; margin: 1rem 0;
  font-variant-numeric: tabular-nums lining-nums; }
th, td { padding: .25rem .55rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--rule); }
td.n, th.n { text-align: right; white-space: nowrap; }
.pass { color: #1b6e3c; } .fail, .error { color: #a8201a; font-weight: bold; } .inconclusive { color: #8a5a00; }
code { font: .85em ui-monospace, "DejaVu Sans Mono", monospace; background: #f2f2ef; padding: .1em .3em; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(20rem, 1fr)); gap: .8rem; margin: .8rem 0; }
.pictures figure { margin: 0; } .pictures img { width: 100%; image-rendering: pixelated; }
.pictures img.smooth { image-rendering: auto; } figcaption { font-size: .8rem; color: var(--soft); }
"""


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
    heads = "".join(f'<th class="n">{head}</th>' for head in (
        "mean error", "interval", "tolerance", "sure to fail from", "in the noisiest tile", "samples / pixel", "s"))
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>Gates</title>\n'
            f"<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n<h1>Gates</h1>\n<p>{escape(counted(results))}</p>\n"
            f'<div class="scroll"><table>\n<tr><th>gate</th><th>outcome</th>{heads}<th>why this tolerance</th></tr>\n'
            + "\n".join(_row(result) for result in results)
            + f"\n</table></div>\n{sections}\n</main>\n</body>\n</html>\n")


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
    columns = "".join(f'<td class="n">{cell}</td>' for cell in cells)
    return (f'<tr><td>{linked}</td><td class="{outcome}">{outcome}</td>{columns}'
            f"<td>{escape(result.why or result.reason)}</td></tr>")


def _section(result: GateRecord, folder: Path) -> str:
    name = escape(result.gate)
    lines = [f'<h2 id="{name}">{name} <span class="{result.outcome}">{result.outcome}</span></h2>',
             f"<p>{escape(result.reason)}</p>"]
    if result.command:
        lines += [f"<p><code>{escape(result.command)}</code></p>",
                  f'<p class="soft">{escape(result.why)} ({escape(result.origin)})</p>']
    if result.numbers:
        lines += [_tests(result.numbers),
                  '<div class="pictures">', *(_figure(result.gate, picture) for picture in PICTURES
                                              if (folder / result.gate / picture).exists()), "</div>"]
    return "\n".join(lines)


def _tests(numbers: GateNumbers) -> str:
    names = {"mean": "the image", "coarse": "larger tiles", "fine": "smaller tiles"}
    rows = "".join(f'<tr><td>{names[key]}</td><td class="{test.outcome}">{test.outcome}</td>'
                   f'<td class="n">{percent(test.largest_error)}</td>'
                   f'<td class="n">±{percent(test.tolerance)}</td>'
                   f"<td>{escape(test.reason)}</td></tr>" for key, test in numbers.tests.items())
    return ('<div class="scroll"><table><tr><th>test</th><th>outcome</th><th class="n">largest error</th>'
            f'<th class="n">tolerance</th><th>reason</th></tr>{rows}</table></div>')


def _figure(gate: str, picture: str) -> str:
    smooth = "" if picture in ("test.png", "reference.png") else ' class="smooth"'
    caption = picture.rpartition(".")[0].replace("-", " ")
    path = quote(f"{gate}/{picture}")
    return (f'<figure><a href="{path}"><img{smooth} src="{path}" alt="{caption}"></a>'
            f"<figcaption>{caption}</figcaption></figure>")


def percent(value: float | None, *, signed: bool = False) -> str:
    """'+0.012 %'; '∞' for what has no bound, or is not finite."""
    if value is None or not math.isfinite(value):
        return "∞"
    return f"{100 * value:{'+' if signed else ''}.3g} %"
