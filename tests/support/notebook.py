"""Runs a notebook's cells in order in this process, without Jupyter, whose kernel would be 77 MB of packages more:
`python -P -m tests.support.notebook FILE` runs one and keeps what it showed in it."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

# How a value shows itself, by the type of what it then is.
SHOWN = {"image/svg+xml": "_repr_svg_", "text/html": "_repr_html_"}


def executed(path: Path) -> dict[str, Any]:
    """The notebook with what its cells print and show now. What a cell raises passes."""
    book: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    count = 0
    for cell in book["cells"]:
        if cell["cell_type"] == "code":
            count += 1
            cell["execution_count"] = count
            cell["outputs"] = _run("".join(cell["source"]), names, count)
    return book


def _run(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """The outputs of a cell: what it printed, and the value of its last expression."""
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    printed = io.StringIO()
    value = None
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(body, []), f"cell {count}", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(True)})
    if value is not None:
        data = {kind: getattr(value, method)() for kind, method in SHOWN.items() if hasattr(value, method)}
        data["text/plain"] = repr(value)
        outputs.append({"output_type": "execute_result", "execution_count": count, "metadata": {},
                        "data": {kind: text.splitlines(True) for kind, text in data.items()}})
    return outputs


if __name__ == "__main__":
    file = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HARNESS_CACHE"] = str(Path(folder) / "cache")
        with contextlib.chdir(folder):
            book = executed(file)
    file.write_text(json.dumps(book, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
