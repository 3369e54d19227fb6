"""Where figures become files: their sizes in centimetres, the report's settings, and bytes that are always the same."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, PercentFormatter

from harness.report.figures.style import RC
from harness.samples.keys import code_digest
from harness.samples.memo import remembered_bytes

_INCHES_PER_CM = 1 / 2.54
_DPI = 110  # of figures that are looked at on a screen, by themselves


def blank(width: float, height: float, **options: Any) -> Figure:
    """An empty figure, so many centimetres wide and high; it can be measured before it is saved."""
    figure = Figure(figsize=(width * _INCHES_PER_CM, height * _INCHES_PER_CM), **options)
    FigureCanvasSVG(figure)
    return figure


def svg(draw: Callable[[], Figure], salt: str, *, of: object = None, letters_as_shapes: bool = False) -> bytes:
    """What `draw` returns, drawn with the report's settings, as SVG: the same bytes for the same figure.

    The markers of every line that has a label say their values in a <title>, which browsers show under the pointer.
    `salt`: of the names inside the file, which would be random without; figures of one page need different ones.
    Text stays text, for pages that bring the fonts; `letters_as_shapes`: for a file that is looked at alone. `of`: all
    that `draw` depends on besides code, as `digest` takes it; what was drawn of the same is then read back.
    """
    if of is not None:
        key = [code_digest(draw.__module__), matplotlib.__version__, salt, letters_as_shapes, of]
        return remembered_bytes("figures", key, lambda: svg(draw, salt, letters_as_shapes=letters_as_shapes))
    settings = {"svg.hashsalt": salt, **({"svg.fonttype": "path"} if letters_as_shapes else {})}
    values: dict[str, list[str]] = {}

    def labelled() -> Figure:
        figure = draw()
        for axes in figure.axes:
            for line in axes.lines:
                if words := _values(axes, line):
                    name = f"values-{len(values)}"
                    line.set_gid(name)
                    values[name] = words
        return figure

    drawn = _saved(labelled, settings, format="svg", metadata={"Date": None, "Creator": None}).decode()
    for name, words in values.items():
        drawn = _titled(drawn, name, words)
    return drawn.encode()


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` returns, drawn with the report's settings, as PNG."""
    return _saved(draw, {}, format="png", dpi=_DPI)


def _saved(draw: Callable[[], Figure], settings: dict[str, Any], **options: Any) -> bytes:
    together: Any = {**RC, **settings}
    with matplotlib.rc_context(together):
        buffer = io.BytesIO()
        draw().savefig(buffer, **options)
    return buffer.getvalue()


def _values(axes: Axes, line: Line2D) -> list[str]:
    """For each marker of a line with a label: the label, x and y, to four digits. Nothing for a line without markers or
    label. A line that was moved aside has what its x should be as its gid."""
    label = str(line.get_label())
    if line.get_marker() in ("", " ", "None", None) or label.startswith("_"):
        return []
    points = np.asarray(line.get_xydata(), dtype=float)
    where, what = axes.get_xlabel(), axes.get_title(loc="left") or axes.get_ylabel()
    return [f"{label}; {where}: {line.get_gid() or _written(axes.xaxis, x)}; {what}: {_written(axes.yaxis, y)}"
            for x, y in points if math.isfinite(x) and math.isfinite(y)]


def _written(axis: Axis, value: float) -> str:
    """A number as the axis writes it where it was told how; matplotlib's own ways are for ticks alone."""
    value = float(f"{value:.4g}")
    write = axis.get_major_formatter()
    return str(write(value)) if isinstance(write, FuncFormatter | PercentFormatter) else f"{value:g}".replace("-", "−")


def _titled(drawn: str, name: str, words: list[str]) -> str:
    """The markers of the group called `name` with their titles; as it is where some lie outside the figure."""
    start = drawn.index(f'<g id="{name}">')
    end = drawn.find('<g id="', start + 1)
    group = drawn[start:end if end > 0 else len(drawn)]
    uses = re.findall(r"<use [^>]*/>", group)
    if len(uses) != len(words):
        return drawn
    told = iter(words)
    group = re.sub(r"<use ([^>]*)/>", lambda use: f"<use {use[1]}><title>{escape(next(told))}</title></use>", group)
    return drawn[:start] + group + drawn[end if end > 0 else len(drawn):]
