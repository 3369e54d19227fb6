"""How the report looks: one colour and one marker for each strategy on every page, and the figures' typography."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from harness.scene.strategies import TABLE, Style

# Text stays text in the SVG; the page's typesetter finds the same fonts, which matplotlib brings with it.
FONT = "STIXGeneral"
FONT_SIZE = 8.0  # pt, at the size at which the figure is printed

RC = {
    "svg.fonttype": "none",
    "font.family": [FONT, "DejaVu Sans"],
    "font.size": FONT_SIZE,
    "axes.titlesize": FONT_SIZE + 0.5,
    "axes.titley": 1.03,  # fixed: placing titles automatically costs a fifth of the drawing time
    "axes.labelsize": FONT_SIZE,
    "xtick.labelsize": FONT_SIZE - 0.5,
    "ytick.labelsize": FONT_SIZE - 0.5,
    "legend.fontsize": FONT_SIZE,
    "axes.linewidth": 0.5,
    "axes.edgecolor": "#444444",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 0.0,
    "ytick.minor.size": 0.0,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "lines.linewidth": 1.1,
    "lines.markersize": 3.2,
    "axes.unicode_minus": True,
    "path.simplify": True,
}

GUIDE_COLOUR = "#c8c8c8"
TOLERANCE_COLOUR = "#e9efe9"


def font_folder() -> Path:
    """Where matplotlib keeps the fonts that it brings; `FONT` and DejaVu Sans are among them."""
    found = find_spec("matplotlib")  # which imports nothing of it
    assert found is not None and found.origin
    return Path(found.origin).parent / "mpl-data" / "fonts" / "ttf"


_STYLES = {each.name: each.style for each in TABLE if each.style is not None}
_OTHERS = (Style("#8c8c00", "*", "★"), Style("#7f5fa8", "p", "⬟"), Style("#6b6b6b", "h", "⬢"))
# Where one figure shows more strangers than these, those after them have the same colours and other markers.
_MORE = ("<", ">", "d")


def strategy_style(strategy: str) -> Style:
    """The style of a strategy, whatever its sampler, whose name follows; a strategy this table does not know gets a
    spare one, always the same."""
    known = _STYLES.get(strategy.partition(" ")[0])
    return known if known is not None else _OTHERS[sum(strategy.encode()) % len(_OTHERS)]


def styles(names: Iterable[str]) -> dict[str, Style]:
    """A style for each of the names of one figure: strategies have their own, others the spare ones, none that of
    another before there are more than six of them."""
    spare = [*_OTHERS, *(Style(style.colour, marker, "●") for style, marker in zip(_OTHERS, _MORE, strict=True))]
    found: dict[str, Style] = {}
    others = 0
    for name in dict.fromkeys(names):
        known = _STYLES.get(name.partition(" ")[0])
        found[name] = known or spare[others % len(spare)]
        others += known is None
    return found
