"""What a study's tiles say: a table, maps of their deviates, and sentences for the summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.report import formats
from harness.report.bars import signed_bar
from harness.report.blocks import Asset, Cell, Column, Mark, Picture, PictureRow, Remark, Table
from harness.report.figures import pictures
from harness.report.tables import strategy_cell
from harness.results import StrategyResult, StudyResult
from harness.stats.bias import POWER
from harness.stats.findings import TileFinding
from harness.stats.verdicts import TESTS

Pair = tuple[StudyResult, StrategyResult]

# Beyond so many times the samples a reader need not know how many.
_MANY = 1e6
# A p-value above this is printed as such: the family's correction drives them to one.
_CERTAIN = 0.99


def tiles_table(result: StudyResult) -> Table:
    """Two rows a strategy, its larger and its smaller tiles: verdict, the tile furthest off, and what could hide."""
    rows: list[tuple[Cell, ...]] = []
    rules = []
    for strategy in result.strategies:
        rules.append(len(rows))
        for index, found in enumerate((strategy.tiles.coarse, strategy.tiles.fine)):
            head = (replace(strategy_cell(strategy), rows=2),) if index == 0 else ()
            mark: Mark = found.outcome if strategy.suits else "warning"
            rows.append((
                *head, Cell(f"{found.tile}{formats.NBSP}px, {formats.tolerance(found.tolerance)}"),
                Cell(found.outcome if strategy.suits else "not suited", mark),
                Cell(f"{found.x},{formats.NBSP}{found.y}"),
                Cell(f"{found.channel} {formats.percent_interval(found.error, found.low, found.high)}"),
                Cell(_deviate(found)), Cell(_probability(found.p)),
                Cell(_sizes(*found.detectable)), Cell(_needed(found))))
    first = result.strategies[0].tiles.fine
    interval = formats.share(1 - first.pass_level)
    caption = (
        "Tiles, by their side and the tolerance of one, each against its own mean in the reference. Furthest off: the "
        f"tile with the largest error over its standard error, by its first pixel (x, y); its error with {interval} "
        "interval in that channel. z: that ratio as a normal deviate; chance exceeds the bound beside it in any tile "
        f"with probability {formats.significant(first.fail_level, 2)}. p: that with which chance lets any tile exceed "
        "the tolerance as clearly as one does; below the same number they fail. Sure to show: the bias that was found "
        f"with {formats.share(POWER)} probability, in the median tile and in the least sharp. To decide: how many "
        "times the samples, of both sides, let an unbiased render pass.")
    columns = (Column("Strategy"), Column("Tiles"), Column("Verdict"), Column("Furthest\noff"),
               Column("Error there", share=1), Column("z", "right"), Column("p", "right"),
               Column("Sure to\nshow", "right"), Column("To\ndecide", "right"))
    return Table(caption, columns, tuple(rows), tuple(rules))


def deviates_row(result: StudyResult, stem: str) -> PictureRow:
    """Maps of the smaller tiles' deviates, one a strategy, to the bounds of chance."""
    height, width = result.reference.mean.shape[:2]
    limit = max(strategy.tiles.fine.critical for strategy in result.strategies)
    maps = []
    for strategy in result.strategies:
        found = strategy.tiles.fine
        file = Asset(f"{stem}-deviates-{strategy.strategy}.png", pictures.difference_png(
            pictures.tile_pixels(found.z, found.tile, height, width), limit))
        maps.append(Picture(file, "", f"Deviates of the smaller tiles of {strategy.strategy}, within ±{limit:.2g}"))
    return PictureRow(tuple(maps), f"Smaller tiles ({result.strategies[0].tiles.fine.tile} px): error over standard "
                      "error", signed_bar(f"{limit:.2g}"))


def deviates_words(result: StudyResult) -> str:
    """How to look at the maps of deviates."""
    return ("Tiles: the error of each over its standard error, in the channel where that is largest; chance paints one "
            "in full colour, beyond the bar's ends, in one map of "
            f"{formats.count(round(1 / result.strategies[0].tiles.fine.fail_level, -2))}.")


def failures(strategy: StrategyResult) -> tuple[Remark, ...]:
    """Tiles that fail, in words; nothing where a strategy does not suit."""
    return tuple(Remark(f"{strategy.strategy}, tiles of {found.tile} px: {formats.typographic(found.reason)}.", "fail")
                 for found in (strategy.tiles.coarse, strategy.tiles.fine)
                 if strategy.suits and found.outcome == "fail")


def tiles_summary(judged: Sequence[Pair], names: str, failed: Sequence[Pair]) -> list[Remark]:
    """What all tiles of the judged pairs say together; `names`: the `failed` pairs in words."""
    if not judged:
        return []
    count = formats.plural(len(judged), "pair")
    level = max(strategy.tiles.fine.fail_level for _, strategy in judged)
    rate = formats.percent(float(-np.expm1(TESTS * len(judged) * np.log1p(-level))))
    tiles = sum(found.z.size for _, s in judged for found in (s.tiles.coarse, s.tiles.fine))
    shared = (f"{formats.count(tiles)} tiles were tested in four channels; were every render right, some image or tile "
              f"would fail in {rate} of such reports at most")
    if failed:
        remarks = [Remark(f"In {len(failed)} of {count} some tile differs from the reference by more than its "
                          f"tolerance: {names} ({shared}).", "fail")]
    else:
        remarks = [Remark(f"No tile of any pair differs from the reference by more than its tolerance as far as can "
                          f"be told: {shared}.")]
    larger, smaller = ([getattr(s.tiles, size) for _, s in judged] for size in ("coarse", "fine"))
    passed = [sum(found.outcome == "pass" for found in each) for each in (larger, smaller)]
    bounds = [formats.words([formats.tolerance(t) for t in sorted({found.tolerance for found in each})])
              for each in (larger, smaller)]
    mark: Mark = "pass" if sum(passed) == 2 * len(judged) else "inconclusive"
    hidden = float(np.median([found.detectable[0] for found in smaller]))
    more = "" if mark == "pass" else (" The others are not shown to be right in every part: their pages say how many "
                                      "samples that would take.")
    sharp = "" if not np.isfinite(hidden) else (
        f" In half of the pairs a bias of {formats.percent(hidden)} in a smaller tile of median noise would have been "
        f"found with {formats.share(POWER)} probability.")
    remarks.append(Remark(
        f"Every larger tile lies within {bounds[0]} in {passed[0]} of {count}, every smaller one within {bounds[1]} "
        f"in {passed[1]}.{more}{sharp}", mark))
    return remarks


def _deviate(found: TileFinding) -> str:
    value = float(np.nan_to_num(found.z).flat[np.abs(np.nan_to_num(found.z)).argmax()])
    return f"{formats.number(value, 1, sign=True)} (±{found.critical:.1f})"


def _probability(p: float) -> str:
    return f">{formats.NBSP}{_CERTAIN:g}" if p > _CERTAIN else formats.significant(p, 1)


def _sizes(small: float, large: float) -> str:
    """Two sizes of bias, in percent: '6.1 … 52 %'."""
    return f"{formats.percent(small, unit=False)} … {formats.percent(large)}"


def _needed(found: TileFinding) -> str:
    if found.outcome != "inconclusive":
        return formats.MISSING
    if not found.needed < _MANY:
        return f">{formats.NBSP}{formats.significant(_MANY, 1)}{formats.TIMES}"
    return f"{formats.significant(max(found.needed, 1.1), 2)}{formats.TIMES}"
