"""The chapter on the coupled oracle: how far the tracer agrees with Mitsuba on the very same paths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.report import formats
from harness.report.bars import signed_bar
from harness.report.blocks import (
    Asset,
    Block,
    Cell,
    Chapter,
    Column,
    Heading,
    Paragraph,
    Picture,
    PictureRow,
    Pictures,
    Remark,
    Remarks,
    Swatch,
    Table,
)
from harness.report.figures import pictures
from harness.report.figures.style import strategy_style
from harness.report.inputs import Inputs
from harness.results import AutopsyScore, CoupledRecord, NamedMutant
from harness.stats.agreement import THRESHOLD
from harness.stats.bias import POWER
from harness.stats.rates import CONFIDENCE
from harness.stats.verdicts import PASS_LEVEL
from harness.studies.coupled import PARTED
from harness.studies.oracle import FALSE_ALARMS, OracleFile, OracleTiles

PLACE = 45
TITLE, ANCHOR = "Under the microscope", "microscope"
# So many scenes have a map, in rows of so many: those in which most is left.
MAPS, IN_ROW = 8, 4
# The finest scale of a map: half of it is what float32 leaves of a pixel's sum, to one side (`stats.paired`).
_FINEST = 1e-6
# What no sample showed is rarer than 3 in so many (the rule of three, at 95 %).
_RULE_OF_THREE = 3


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where a scene was compared path by path, or its oracle with `path`, or autopsies were made."""
    blocks: list[Block] = []
    if inputs.coupled:
        blocks += [Paragraph(_introduction(inputs.coupled)), Remarks(_remarks(inputs)), _table(inputs.coupled),
                   _maps(inputs)]
    if inputs.oracle is not None and inputs.oracle.records:
        blocks += [Heading("The oracle itself"), Paragraph(_oracle_words(inputs.oracle)),
                   Remarks(_oracle_remarks(inputs.oracle)), _oracle_table(inputs.oracle)]
    if inputs.autopsies is not None:
        score = inputs.autopsies
        blocks += [Heading("Autopsies"), Paragraph(_autopsy_words()), Remarks(_autopsy_remarks(score)),
                   _autopsy_table(score)]
    if blocks:
        yield Chapter(TITLE, ANCHOR, tuple(blocks))


def _introduction(records: Sequence[CoupledRecord]) -> str:
    side = max(max(record.left.shape) for record in records)
    return (
        "Here Mitsuba is given the very random numbers of the shader, in the same order, so that both follow the same "
        "paths, while rays, hits, normals, textures, lights and materials stay Mitsuba's own. The noise of the two "
        "images is then the same and cancels in their difference, in which an error far below either image's noise "
        "shows. Now and then rounding sends a path another way, at an edge for instance; its twin then shows another "
        "part of the scene. Such pairs are counted, and none is left out, so that the mean of the differences stays "
        "the difference of the means. What both share, the generator and the directions made of its numbers, cannot "
        "show here: the chapters before compare with Mitsuba's own. "
        f"Images are at most {side} pixels wide or high.")


def _remarks(inputs: Inputs) -> tuple[Remark, ...]:
    records = inputs.coupled
    pairs = formats.plural(len(records), "pair")
    within = [record for record in records if record.error[1] <= 0 <= record.error[2]]
    off = [f"{record.scene} {record.strategy}" for record in records if record not in within]
    remarks = [Remark(
        f"In {len(within)} of {pairs} of scene and strategy the interval of the mean difference holds zero"
        + (f"; not of {formats.words(off)}, which may be rounding: it can lie to one side." if off else "."))]
    ratios = [record.ratio for record in records if np.isfinite(record.ratio)]
    if ratios:
        remarks.append(Remark(f"The variance of an image is {formats.significant(min(ratios), 2)} to "
                              f"{formats.significant(max(ratios), 2)} times that of the difference; as many times the "
                              "samples would two renders with random "
                              "numbers of their own take to show the same."))
    seen = {record.scene for record in records}
    missing = [result.scene for result in inputs.results if result.scene not in seen]
    if missing:
        remarks.append(Remark(f"Left out, because the oracle cannot follow their paths: {formats.words(missing)}.",
                              "warning"))
    return tuple(remarks)


def _table(records: Sequence[CoupledRecord]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for index, record in enumerate(records):
        head: tuple[Cell, ...] = ()
        if index == 0 or records[index - 1].scene != record.scene:
            rules.append(index)
            head = (Cell(record.scene, rows=sum(each.scene == record.scene for each in records)),)
        style = strategy_style(record.strategy)
        rows.append((*head, Cell(record.strategy, swatch=Swatch(style.glyph, style.colour)), Cell(_ratio(record.ratio)),
                     Cell(_share(record.differing, record.singles)), Cell(_share(record.parting, record.singles)),
                     Cell(_millionths(*record.error)),
                     Cell(f"{record.replicas}{formats.TIMES}{formats.NBSP}{record.spp}"),
                     Cell(formats.number(record.seconds, 1))))
    caption = (
        "Scenes and strategies, tracer against oracle, in luminance. Variance: that of a pixel over that of its "
        "difference; none where all samples of a pixel agree. Differ: of single samples, those off by more than "
        f"{formats.share(THRESHOLD)} of themselves in some channel; part: those of them off by more than "
        f"{formats.share(PARTED)} of the image's mean; where none was seen, what the share is below, at "
        f"{formats.share(CONFIDENCE)} confidence. Mean difference: of the image, relative, in parts in a million, with "
        f"its {formats.share(1 - PASS_LEVEL)} interval, which also allows for what no sample has shown yet. Drawn: "
        "replicas × samples per pixel.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Variance\nratio", "right"),
               Column("Differ", "right"), Column("Part", "right"), Column("Mean difference\nin a million", "right"),
               Column("Drawn", "right"), Column("Seconds", "right"))
    return Table(caption, columns, tuple(rows), tuple(rules), long=True)


def _maps(inputs: Inputs) -> Pictures:
    """Of each scene's first strategy; of scenes those with the smallest ratios, in the report's order."""
    stems = {result.scene: stem for result, stem in zip(inputs.results, inputs.stems, strict=True)}
    first = list({record.scene: record for record in reversed(inputs.coupled)}.values())[::-1]
    most = sorted(first, key=lambda record: -float(np.nan_to_num(1 / record.ratio)))[:MAPS]
    shown = [_map(record, stems[record.scene]) for record in first if record in most]
    rows = tuple(PictureRow(tuple(shown[start:start + IN_ROW])) for start in range(0, len(shown), IN_ROW))
    which = "" if len(first) <= MAPS else f" Shown are the {MAPS} scenes with the smallest ratio of variances."
    return Pictures(
        f"What is left: the relative difference of each pixel, {pictures.DARKER} where the tracer is darker, "
        f"{pictures.BRIGHTER} where it is brighter.{which} Every map has a scale of its own, to "
        f"{pictures.ROBUST_WORDS}, rounded up; what lies beyond saturates. Rounding leaves a fine grain, and faint "
        "even patches up to half a part in a million; paths that part leave single strong pixels. A stronger patch, "
        "or the outline of one object, would be an error.", rows)


def _map(record: CoupledRecord, stem: str) -> Picture:
    limit = pictures.robust_limit([record.left], _FINEST)
    title = f"{record.scene}, {record.strategy}"
    return Picture(Asset(f"{stem}-coupled.png", pictures.difference_png(record.left, limit)), title,
                   f"Relative difference of {title} from the coupled oracle, within ±{limit:g}",
                   signed_bar(_limit(limit)))


def _limit(limit: float) -> str:
    """A part of one as a percentage, or with an exponent where that is shorter."""
    return formats.share(limit) if limit >= 1e-4 else formats.significant(limit, 1)


def _ratio(ratio: float) -> str:
    return "identical" if ratio == np.inf else formats.significant(ratio, 2)


def _share(hits: int, samples: int) -> str:
    """Of samples in percent; below what it lies where none was hit."""
    if hits == 0:
        return f"<{formats.NBSP}{formats.significant(100 * _RULE_OF_THREE / samples, 1)}{formats.NBSP}%"
    return f"{formats.significant(100 * hits / samples, 2)}{formats.NBSP}%"


def _millionths(error: float, low: float, high: float) -> str:
    half = 1e6 * (high - low) / 2
    decimals = 2 if half < 1 else 1 if half < 100 else 0
    value, down, up = (formats.number(1e6 * each, decimals, sign=True) for each in (error, low, high))
    return f"{value}{formats.NBSP}[{down},{formats.NBSP}{up}]"


def _oracle_words(found: OracleFile) -> str:
    versions = formats.words([f"{name} {found.versions[name]}" for name in ("mitsuba", "drjit")])
    seconds = formats.duration(sum(record.seconds for record in found.records))
    return (
        "What tracer and oracle have in common, the generator and the directions made of its numbers, cancels in their "
        "difference, right or wrong. So the oracle is held against Mitsuba's own path integrator as well, each with "
        f"random numbers of its own, once and at length: for {seconds} of CPU time, on {found.date}, with {versions}. "
        "The command harness oracle does it again.")


def _oracle_remarks(found: OracleFile) -> tuple[Remark, ...]:
    apart = [record.scene for record in found.records if not record.agrees]
    scenes = formats.plural(len(found.records), "scene")
    if apart:
        return (Remark(f"In {len(apart)} of {scenes} the two differ by more than chance explains: "
                       f"{formats.words(apart)}.", "fail"),)
    widest = max((abs(bound) for record in found.records for bound in record.error[1:]), default=0.0)
    return (Remark(f"In {scenes} nothing differs by more than chance explains, neither the image nor its larger and "
                   f"its smaller tiles; each mean is within "
                   f"{formats.significant(100 * widest, 2)}{formats.NBSP}% ({formats.share(1 - PASS_LEVEL)} "
                   "confidence).", "pass"),)


def _oracle_table(found: OracleFile) -> Table:
    side = max(max(record.size) for record in found.records)
    rows = [(Cell(record.scene), Cell(record.strategy), Cell(formats.count(record.spp[0])),
             Cell(formats.count(record.spp[1])), Cell(_millionths(*record.error)),
             *(Cell(_deviate(tiles)) for tiles in (record.mean, record.coarse, record.fine)),
             *(Cell(_sure(tiles)) for tiles in (record.coarse, record.fine)))
            for record in found.records]
    caption = (
        f"The oracle against path. Samples: per pixel, of images at most {side} pixels wide or high. Mean difference: "
        f"in luminance, relative, in parts in a million, with its {formats.share(1 - PASS_LEVEL)} interval. Deviate: "
        "of the mean, and the clearest of all larger and of all smaller tiles, in standard errors; in brackets what "
        f"chance exceeds in {formats.share(FALSE_ALARMS)} of such tables. Sure: the bias that the tile in which it is "
        f"hardest to see was sure ({formats.share(POWER)}) to show.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Samples,\noracle", "right"),
               Column("path", "right"), Column("Mean difference\nin a million", "right"),
               Column("Deviate,\nmean", "right"), Column("larger\ntiles", "right"), Column("smaller\ntiles", "right"),
               Column("Sure,\nlarger", "right"), Column("smaller\ntiles", "right"))
    return Table(caption, columns, tuple(rows), (0,), long=True)


def _deviate(tiles: OracleTiles) -> str:
    return f"{formats.number(tiles.deviate, 1, sign=True)}{formats.NBSP}[{formats.number(tiles.critical, 1)}]"


def _sure(tiles: OracleTiles) -> str:
    return f"{formats.significant(100 * tiles.detectable, 2)}{formats.NBSP}%"


def _autopsy_words() -> str:
    return (
        "Where the two do not agree, `harness autopsy` follows both along single paths and names the first stage that "
        "differs (hit, normal, direction, weight, …) and the function that computes it; where lights are sampled, it "
        "asks each function of that at the same vertices, and then compares whole samples. Each one-line defect of the "
        "catalogue was put into the shader by itself and examined. Named: the first function is one that the defect "
        "is in; misnamed: it is another; missed: the records of a path change, but by less than is accused; unreached: "
        "the defect changes no path of any scene.").replace("`", "")


def _autopsy_remarks(score: AutopsyScore) -> tuple[Remark, ...]:
    named, reached = score.count("named"), score.reached
    share = f" ({formats.percent(named / reached, decimals=1)})" if reached else ""
    remarks = [Remark(f"{named} of {formats.plural(reached, 'mutant')} that change a path are named by the right "
                      f"function first{share}.", "pass" if named == reached else "")]
    wrong = [f"{each.id} ({each.named[0] if each.named else 'no function'} for {formats.words(list(each.wrong[:2]))})"
             for each in score.mutants if each.outcome == "misnamed"]
    if wrong:
        remarks.append(Remark(f"Another function is named: {formats.words(wrong)}.", "warning"))
    for outcome, told in (("missed", "Nothing is accused"), ("unreached", "No scene shows")):
        ids = [each.id for each in score.mutants if each.outcome == outcome]
        if ids:
            remarks.append(Remark(f"{told}: {formats.words(ids)}.", "warning" if outcome == "missed" else ""))
    if score.variants:
        right = formats.plural(len({each.id for each in score.variants}), "right shader")
        accused = [f"{each.id} on {each.scene} ({each.stage})" for each in score.accused]
        told = f"accused all the same: {formats.words(accused)}" if accused else "none was accused"
        remarks.append(Remark(f"Of {right}, examined {formats.count(len(score.variants))} times on "
                              f"{formats.plural(len(_places(score)), 'pair')} of scene and strategy, {told}.",
                              "fail" if accused else "pass"))
    return tuple(remarks)


def _places(score: AutopsyScore) -> set[tuple[str, str]]:
    return {(each.scene, each.strategy) for each in score.variants}


def _autopsy_table(score: AutopsyScore) -> Table:
    topics: dict[str, list[NamedMutant]] = {}
    for each in score.mutants:
        topics.setdefault(each.topic, []).append(each)
    rows = [_topic(topic, mutants) for topic, mutants in topics.items()]
    caption = ("Autopsies of the mutants, by the part of the shader. CPU time: of one autopsy, the median of those "
               "that accuse; of lights without the paths, which are right there.")
    columns = (Column("Part", share=1), *(Column(title, "right") for title in (
        "Mutants", "Named", "Misnamed", "Missed", "Unreached", "CPU time")))
    return Table(caption, columns, (*rows, _topic("all", list(score.mutants))), (0, len(rows)))


def _topic(topic: str, mutants: Sequence[NamedMutant]) -> tuple[Cell, ...]:
    outcomes = [each.outcome for each in mutants]
    seconds = [each.seconds for each in mutants if each.outcome in ("named", "misnamed")]
    counts = (outcomes.count(outcome) for outcome in ("named", "misnamed", "missed", "unreached"))
    return (Cell(topic), Cell(formats.count(len(mutants))),
            *(Cell(formats.count(count) if count else formats.MISSING) for count in counts),
            Cell(formats.duration(float(np.median(seconds))) if seconds else formats.MISSING))
