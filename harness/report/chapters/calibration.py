"""The report's chapter on the verdicts themselves: how often they raise false alarms, and what they find."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from harness.report import formats
from harness.report.blocks import Asset, Block, Cell, Chapter, Column, Curves, Mark, Paragraph, Remark, Remarks, Table
from harness.report.inputs import Inputs
from harness.report.remembered import remembered_chapters
from harness.report.suite import PLACES, suite_blocks
from harness.stats.calibration import SUBJECTS, Calibration, FalseAlarms, Power, by_case
from harness.stats.rates import CONFIDENCE, Rate, Where
from harness.stats.synthetic import BRIGHTNESS, LOGNORMAL_SIGMA, RARITY
from harness.stats.tiles import LARGER, PATCH, SMALLER

PLACE = 40
TITLE, ANCHOR = "How far the verdicts can be trusted", "calibration"
FIGURE_FILE = "calibration-power.svg"
# A gain is called found where the verdict missed it in no more than this share of comparisons.
MISSED = 0.05


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where anything was calibrated."""
    if inputs.calibration is not None:
        yield from remembered_chapters(partial(_chapters, inputs.calibration), __name__, inputs.calibration)


def _chapters(calibration: Calibration) -> Iterator[Chapter]:
    yield Chapter(TITLE, ANCHOR, (
        Paragraph(_introduction(calibration)), Remarks(_remarks(calibration)), _table(calibration),
        _power(calibration), *_coupled(calibration), *suite_blocks(calibration.suite)))


def _introduction(calibration: Calibration) -> str:
    rendered = sum(text.startswith("rendered") for text in calibration.cases.values())
    return (
        "A verdict is worth what its error rates are, so they are measured: on pairs of estimates that have the same "
        "mean, where every alarm is false, and on the same pairs with a known gain, which should be found. Some "
        f"estimators are made up, with samples that are normal, lognormal (σ = {LOGNORMAL_SIGMA:g}), or fireflies (a "
        f"share of {formats.significant(RARITY, 1)} is {formats.count(BRIGHTNESS)} times as bright); in "
        f"{formats.plural(rendered, 'case')} the tracer renders a scene with two strategies. An image is tested as a "
        f"whole, in tiles of {formats.fraction(LARGER)} of its side and in tiles of {formats.fraction(SMALLER)}. "
        "Differences are studentized with variances from batch means on both sides (Welch), corrected for skewness by "
        "Hall's transformation, and each tile's variance is at least that of the tiles around, for one that has not "
        "seen its rare bright sample cannot know of it. Tests share an error rate by Šidák's formula; looks at "
        "growing samples share it in proportion to the samples drawn.")


def _power(calibration: Calibration) -> Curves:
    from harness.report.figures.power import power_svg

    deciding = _deciding(calibration.powers)
    svg, names = power_svg(calibration.powers)
    caption = (
        f"What the verdicts make of a gain. Left: of everything, middle: of a square of {formats.share(PATCH)} of the "
        f"image at a random place, under the default tolerances (dotted lines), on {deciding} "
        f"({calibration.cases[deciding]}). Right: without tolerance, on {formats.words(names)} (the samples of the "
        "table); solid of everything that is not seen directly, dashed of the square. Bands are "
        f"{formats.share(CONFIDENCE)} binomial intervals.")
    return Curves(caption, Asset(FIGURE_FILE, svg),
                  "Shares of comparisons that passed, and that failed, against the gain")


def _table(calibration: Calibration) -> Table:
    cases = by_case(calibration.alarms)
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for case, levels in cases.items():
        rules.append(len(rows))
        for index, (level, alarms) in enumerate(levels.items()):
            name = (Cell(case, rows=len(levels)),) if index == 0 else ()
            rows.append((*name, Cell(formats.share(level, unit=False)), *map(_alarm_cell, alarms)))
    counts = sorted({calibration.cases[case].partition(", ")[2] for case in cases if case in calibration.cases})
    trials, size = calibration.alarms[0].trials, calibration.facts["image size"].replace("x", "×")
    caption = (
        f"False alarms in percent of {formats.count(trials)} independent null comparisons of each case (test / "
        f"reference), with {formats.share(CONFIDENCE)} binomial intervals (Clopper and Pearson), beside the rate that "
        "was asked for at the most. Without tolerance, at few samples, where tails are heaviest: "
        f"{formats.words(counts)}, images of {size} pixels. The verdict is of all three tests together; with looks it "
        "is taken at a quarter, a half and all of the samples.")
    columns = (Column("Case", share=1), Column("Asked", "right"),
               *(Column(subject.capitalize().replace(" ", "\n", 1), "right") for subject in SUBJECTS))
    return Table(caption, columns, tuple(rows), tuple(rules))


def _coupled(calibration: Calibration) -> tuple[Block, ...]:
    """What became of pairs that share their random numbers: a row a plan and a bias."""
    if not calibration.coupled:
        return ()
    cases: dict[tuple[str, Where], list[Power]] = {}
    for each in calibration.coupled:
        cases.setdefault((each.case, each.where), []).append(each)
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for (case, where), powers in cases.items():
        if where == "everywhere":
            rules.append(len(rows))
        head = (Cell(f"{case.removeprefix('coupled: ')}: {calibration.cases[case].partition(', ')[2]}",
                     rows=sum(len(each) for (name, _), each in cases.items() if name == case)),)
        for index, each in enumerate(powers):
            place = (Cell(PLACES[where], rows=len(powers)),) if index == 0 else ()
            rows.append((*(head if index == 0 and where == "everywhere" else ()), *place,
                         Cell(_millionths(each.gain)), Cell(formats.number(each.gain / each.tolerance, 1)),
                         *(Cell(formats.percent(hits / each.trials, decimals=0, unit=False))
                           for hits in (each.passed, each.failed)),
                         Cell(formats.percent(each.share, decimals=0, unit=False))))
    caption = (
        "Verdicts on differences, of made-up pairs that share their random numbers, of which few samples part: what "
        f"became of biases, in percent of {formats.count(calibration.coupled[0].trials)} comparisons; the others were "
        "undecided. A pass allows for partings that no sample has shown yet, for which few samples of a smaller tile "
        "leave no room. Bias: in parts in a million, and in tolerances, of the mean or of a smaller tile.")
    columns = (Column("Replicas, tolerances", share=1), Column("Bias"), Column("In a\nmillion", "right"),
               Column("In\ntolerances", "right"), Column("Passed", "right"), Column("Failed", "right"),
               Column("Budget\nin %", "right"))
    return (Table(caption, columns, tuple(rows), tuple(rules), long=True),)


def _millionths(value: float) -> str:
    return formats.significant(1e6 * value, 2) if value else "0"


def _alarm_cell(alarms: FalseAlarms) -> Cell:
    low, high = alarms.rate.interval()
    text = f"{_rate(alarms.rate.value)} [{_rate(low)}, {_rate(high)}]"
    return Cell(text.replace(" ", formats.NBSP), "fail" if alarms.judgement == "excessive" else "")


def _remarks(calibration: Calibration) -> tuple[Remark, ...]:
    shown = [each for levels in by_case(calibration.alarms).values() for alarms in levels.values() for each in alarms]
    judged = {kind: [each for each in shown if each.judgement == kind]
              for kind in ("excessive", "nominal", "conservative")}
    mark: Mark = "fail" if judged["excessive"] else "pass"
    remarks = [Remark(
        f"Of {formats.plural(len(shown), 'measured rate')} of false alarms {len(judged['excessive'])} lie above what "
        f"was asked for, the intervals of {len(judged['nominal'])} hold it, and {len(judged['conservative'])} lie "
        "below.",
        mark)]
    if judged["conservative"]:
        remarks.append(Remark(
            "Rates lie below where tests are strict by construction: the variance of a tile is the largest of its own "
            "and its neighbours', of Student's and Hall's deviates the milder counts, red, green, blue and luminance "
            "count as four although they share most of their noise, and looks share their rate as if independent."))
    return (*remarks, *_power_remarks(calibration.powers))


def _power_remarks(powers: Sequence[Power]) -> list[Remark]:
    case = _deciding(powers)
    mine = [each for each in powers if each.case == case]
    remarks = []
    for where, place in (("everywhere", "of "
                                        "everything"), ("patch", f"in a square of {formats.share(PATCH)} of the "
                                                                 "image")):
        gains = sorted((each for each in mine if each.where == where and each.gain > 0), key=lambda each: each.gain)
        known = {each.gain: each for each in gains}
        tolerance = gains[0].tolerance
        at = known.get(tolerance)
        surely = next((each for each in gains if each.gain >= tolerance and each.failed >= (1 - MISSED) * each.trials),
                      None)
        text = f"{case}: a gain {place} "
        if at is not None:
            low, high = Rate(at.passed, at.trials).interval()
            text += (f"as large as the tolerance ({formats.percent(tolerance)}) passed in {at.passed} of {at.trials} "
                     f"comparisons ({_rate(low)} to {_rate(high)}{formats.NBSP}%)")
        if surely is not None:
            text += f"; one of {formats.percent(surely.gain)} failed in {surely.failed} of {surely.trials}"
        remarks.append(Remark(f"{text}."))
    good = next(each for each in mine if each.gain == 0)
    remarks.append(Remark(f"{case}: a good render passed in {good.passed} of {good.trials} and failed in "
                          f"{good.failed}, after {formats.percent(good.share, decimals=0)} of the budget on average."))
    return remarks


def _deciding(powers: Sequence[Power]) -> str:
    """The case whose plan has tolerances."""
    return next(each.case for each in powers if each.tolerance > 0)


def _rate(fraction: float) -> str:
    return formats.percent(fraction, decimals=1, unit=False)
