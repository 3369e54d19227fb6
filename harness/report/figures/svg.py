"""Where figures become files: their sizes in centimetres, the report's settings, and bytes that are always the same."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

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

    `salt`: of the names inside the file, which would be random without; figures of one page need different ones.
    Text stays text, for pages that bring the fonts; `letters_as_shapes`: for a file that is looked at alone. `of`: all
    that `draw` depends on besides code, as `digest` takes it; what was drawn of the same is then read back.
    """
    if of is not None:
        key = [code_digest(draw.__module__), matplotlib.__version__, salt, letters_as_shapes, of]
        return remembered_bytes("figures", key, lambda: svg(draw, salt, letters_as_shapes=letters_as_shapes))
    settings = {"svg.hashsalt": salt, **({"svg.fonttype": "path"} if letters_as_shapes else {})}
    return _saved(draw, settings, format="svg", metadata={"Date": None, "Creator": None})


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` returns, drawn with the report's settings, as PNG."""
    return _saved(draw, {}, format="png", dpi=_DPI)


def _saved(draw: Callable[[], Figure], settings: dict[str, Any], **options: Any) -> bytes:
    together: Any = {**RC, **settings}
    with matplotlib.rc_context(together):
        buffer = io.BytesIO()
        draw().savefig(buffer, **options)
    return buffer.getvalue()
