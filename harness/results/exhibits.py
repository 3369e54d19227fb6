"""The handout's errors, measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Finding:
    """One named check of an exhibit: the same quantity of the handout's formula and of the library's.

    `unit` says how to print the two: 'share' a fraction as a percentage, 'error' one with its sign, 'count' a whole
    number, 'number' any other, 'words' text. `caught`: the check objects to the handout's; `cleared`: it passes ours.
    """

    check: str
    measures: str
    handout: float | str
    ours: float | str
    unit: Literal["share", "error", "count", "number", "words"]
    caught: bool
    cleared: bool


@dataclass(frozen=True, eq=False)
class ExhibitImage:
    """A picture: linear radiance (H, W, 3), or a signed map (H, W) of relative differences or standard deviations."""

    title: str
    image: np.ndarray
    unit: Literal["radiance", "relative", "deviations"] = "radiance"


@dataclass(frozen=True, eq=False)
class Series:
    """One line of a plot, (N,) both; `ours` tells the library's from the handout's."""

    name: str
    ours: bool
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Plot:
    """Series over common axes; `log` names the axes that are logarithmic: '', 'x', 'y' or 'xy'."""

    title: str
    x_label: str
    log: Literal["", "x", "y", "xy"]
    series: tuple[Series, ...]


@dataclass(frozen=True, eq=False)
class Exhibit:
    """An error of the handout: its formula and the right one as GLSL, what it does, and what finds it.

    `file`: where its text stands under glsl/, empty for an error of wording. `size`: how large the effect is, in a few
    words; `effect` and `advice`: sentences.
    `message`: what the compiler says of it, if it does not compile.
    """

    id: str
    title: str
    file: str
    handout: str
    right: str
    size: str
    effect: str
    advice: str
    findings: tuple[Finding, ...]
    images: tuple[ExhibitImage, ...] = ()
    plots: tuple[Plot, ...] = ()
    message: str = ""
