"""The colour bars of maps, from their limits; all maps of one kind share the bar's image."""

from __future__ import annotations

from harness.report.blocks import Asset, Bar
from harness.report.figures import pictures
from harness.report.formats import MINUS


def signed_bar(limit: str) -> Bar:
    """The bar of signed maps, from minus to plus a limit in words with its unit."""
    file = Asset("bar-difference.png", pictures.bar_png(pictures.DIFFERENCE_MAP))
    return Bar(file, (f"{MINUS}{limit}", "0", f"+{limit}"))


def flip_bar(limit: float) -> Bar:
    """The bar of FLIP maps, from 0 to a limit."""
    return Bar(Asset("bar-flip.png", pictures.bar_png(pictures.FLIP_MAP)), ("0", f"{limit / 2:g}", f"{limit:g}"))
