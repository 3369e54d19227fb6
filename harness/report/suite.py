"""The report's section on the suite of gates as it stands: how often it errs, and which of its gates see what."""

from __future__ import annotations

from harness.report import formats
from harness.report.blocks import Block, Cell, Column, Heading, Paragraph, Remark, Remarks, Table
from harness.stats.rates import CONFIDENCE, Rate, Where
from harness.stats.suites import BIASES, FLAKY, MISSED, PROMISED, GatePower, GateRates, SuiteRates
from harness.stats.tiles import PATCH

TITLE, ANCHOR = "The gates themselves", "gates"
PLACES: dict[Where, str] = {"everywhere": "of everything", "patch": f"in {formats.share(PATCH)} of the image"}


def suite_blocks(suite: SuiteRates) -> tuple[Block, ...]:
    """The section, from what `harness calibrate` counted."""
    introduction = (
        f"The gates of {suite.file}, with their own scenes, sizes, budgets and tolerances, in "
        f"{formats.count(suite.runs)} simulated runs. Each run draws its replicas, with replacement, from a bank that "
        "the tracer and Mitsuba rendered for every gate, and is then judged by the gates' own code, look after look. "
        "The banks of both sides are moved such that they have the same mean in every tile: all renders are good, "
        "whether the tracer is or not, and every alarm is false. Gates of one scene share their reference, and all "
        "share random numbers, as they do in a real run. A bank is two budgets of the tracer's replicas and one of "
        "Mitsuba's: what is rarer no simulated run can show, and a bright sample that a bank holds once counts as one "
        "that comes so often, be it luck or not.")
    return Heading(TITLE, ANCHOR), Paragraph(introduction), Remarks(_remarks(suite)), _table(suite)


def _remarks(suite: SuiteRates) -> tuple[Remark, ...]:
    gates = formats.plural(len(suite.gates), "gate")
    flaky = [f"{each.gate} ({formats.percent(Rate(each.undecided, each.trials).value, decimals=1)})"
             for each in suite.gates if each.flaky]
    alarms = formats.plural(suite.failed, "run")
    remarks = [
        Remark(f"False alarms: in {alarms} of {formats.count(suite.runs)} one of the {gates} failed, "
               f"{_rate(suite.alarms)}, where {formats.share(suite.false_alarms)} is allowed.",
               "fail" if suite.excessive else "pass"),
        Remark("Good renders that end red for any reason, an undecided gate among them: in "
               f"{formats.plural(suite.red, 'run')} of {formats.count(suite.runs)}, {_rate(suite.not_green)}.",
               "warning" if flaky else "pass")]
    if flaky:
        remarks.append(Remark(f"Undecided in more than {formats.share(FLAKY)} of runs on good renders, so in want of "
                              f"samples or of wider tolerances: {formats.words(flaky)}.", "warning"))
    return (*remarks, *(_promise(suite, where) for where in PROMISED))


def _promise(suite: SuiteRates, where: Where) -> Remark:
    """Which gates are sure to see what the suite promises, or, if those are more, which are not."""
    sure = [each.gate for each in suite.gates if each.sure(where)]
    blind = [each.gate for each in suite.gates if not each.sure(where)]
    gates = formats.plural(len(suite.gates), "gate")
    text = (f"A bias of {formats.share(PROMISED[where])} {PLACES[where]} is sure to be noticed by {len(sure)} "
            f"of {gates}")
    if sure and blind:
        text += (f": {formats.words(sure)}" if len(sure) <= len(blind) else f", not by {formats.words(blind)}")
    return Remark(f"{text}.", "pass" if sure else "fail")


def _table(suite: SuiteRates) -> Table:
    powers = {(each.gate, each.where, each.gain): each for each in suite.powers}
    rows = [(Cell(each.gate), *_good(each), *(_biased(powers[each.gate, where, gain]) for where, gain in BIASES),
             _sure(each, "everywhere"), _sure(each, "patch")) for each in suite.gates]
    caption = (
        f"In percent of {formats.count(suite.runs)} simulated runs of each gate on good renders: false alarms "
        f"(allowed: {100 * suite.level:.2g} %), runs that ended undecided or whose budget was refused after the first "
        f"look, and the part of the budget that was drawn. Then, in percent of {formats.count(suite.powers[0].trials)} "
        "runs with a bias, those that did not pass / those that failed; the bias is of all light, or in a square of "
        f"{formats.share(PATCH)} of the image at random where the image is shaded. A bias of just a gate's tolerance "
        "should not pass, but need not fail; without noise, rounding decides that. Last, the smallest bias that "
        f"passed in no more than {100 * MISSED:g} % of runs, marked where it keeps the promise of "
        f"{100 * PROMISED['everywhere']:g} and {100 * PROMISED['patch']:g} %; a dash where several times the tolerance "
        "did not.")
    short: dict[Where, str] = {"everywhere": "of all", "patch": "in patch"}
    columns = (Column("Gate", share=1), *(Column(title, "right") for title in ("Failed", "Undecided", "Budget")),
               *(Column(f"{formats.share(gain)}\n{short[where]}", "right") for where, gain in BIASES),
               *(Column(f"Sure from,\n{short[where]}", "right") for where in PROMISED))
    return Table(caption, columns, tuple(rows), long=True)


def _good(rates: GateRates) -> tuple[Cell, ...]:
    failed, undecided, share = (formats.percent(fraction, decimals=decimals, unit=False) for fraction, decimals in (
        (rates.failed / rates.trials, 1), (Rate(rates.undecided, rates.trials).value, 1), (rates.share, 0)))
    return Cell(failed), Cell(undecided, "warning" if rates.flaky else ""), Cell(share)


def _biased(power: GatePower) -> Cell:
    red, failed = (100 * count / power.trials for count in (power.trials - power.passed, power.failed))
    return Cell(f"{red:.0f}{formats.NBSP}/{formats.NBSP}{failed:.0f}")


def _sure(rates: GateRates, where: Where) -> Cell:
    smallest = rates.sure_everywhere if where == "everywhere" else rates.sure_patch
    if smallest is None:
        return Cell(formats.MISSING)
    return Cell(f"{formats.significant(100 * smallest, 2)}{formats.NBSP}%", "pass" if rates.sure(where) else "")


def _rate(rate: Rate) -> str:
    low, high = rate.interval()
    return (f"{formats.percent(rate.value, decimals=1)} ({formats.share(CONFIDENCE)} interval "
            f"{formats.percent(low, decimals=1, unit=False)} to {formats.percent(high, decimals=1)})")
