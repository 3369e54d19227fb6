"""The report's files: whole or untouched, complete, valid, and fed by every field of a result."""

from __future__ import annotations

import dataclasses
import html
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, get_type_hints

import matplotlib
import numpy as np
import pytest
import typst

from harness.errors import HarnessError, StoreError
from harness.files import data_dir
from harness.metrics import shown_in
from harness.report import Inputs, build_report, document, remembered
from harness.report.blocks import Document
from harness.report.chapters import scenes
from harness.report.document import compose
from harness.report.figures import convergence
from harness.report.pages.embedded import POLICY
from harness.report.pages.typst import typeset
from harness.results import Benchmark, BenchRow, EntrantRow, StrategyResult, StudyResult
from harness.stats.bias import MeanErrorVerdict
from harness.stats.convergence import Slope
from harness.stats.findings import TileFinding
from tests.support.report import with_curves, with_measured

BENCH = Benchmark((
         BenchRow("diffuse", "cosine", "path", "compute", needed=5.0, tracer_rate=12.3, opponent_rate=1.93, ratio=6.4,
                  low=6.1, high=6.7, wall_ratio=5.6, efficiency_ratio=6.8),
         BenchRow("spheres", "mixture", "bsdf_path", "fragment", needed=4.0, tracer_rate=9.2, opponent_rate=2.7,
                  ratio=3.4, low=3.3, high=3.6, wall_ratio=3.2, efficiency_ratio=3.3)), (
         EntrantRow("cornell", "tracer", "mis", "sobol", 64, best=True, ratio=4.8, low=4.1, high=5.5),
         EntrantRow("cornell", "path", "", "multijitter", 64, best=True, ratio=1.0, low=1.0, high=1.0)))


@pytest.fixture(scope="module")
def output(study: StudyResult, exact: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report on two scenes."""
    folder = tmp_path_factory.mktemp("report")
    inputs = Inputs([study, exact], "quick", bench=BENCH, elapsed={"rendering": 84.0})
    assert build_report(inputs, folder) == folder / "report.pdf"
    return folder


@pytest.fixture(scope="module")
def page(output: Path) -> str:
    return (output / "report.html").read_text(encoding="utf-8")


def test_the_pdf_is_one_and_has_pages_for_verdicts_reading_scenes_and_provenance(output: Path) -> None:
    pdf = (output / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-") and pdf.rstrip().endswith(b"%%EOF")
    pages = int(re.findall(rb"/Count (\d+)", pdf)[-1])
    assert 12 <= pages <= 15
    assert len(pdf) < 3_000_000


def test_the_pages_hold_every_section_figure_and_table_without_a_warning(output: Path, tmp_path: Path) -> None:
    """Compiled once more from the same template and files, to be asked what is on the pages."""
    for path in (output / "figures").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "report.json").write_bytes((output / "report.json").read_bytes())
    (tmp_path / "main.typ").write_bytes((data_dir("reports") / "report.typ").read_bytes())
    fonts = [f"{matplotlib.get_data_path()}/fonts/ttf"]
    settings: dict[str, Any] = {"root": str(tmp_path), "font_paths": fonts, "ignore_system_fonts": True}
    main = str(tmp_path / "main.typ")
    _, warnings = typst.compile_with_warnings(main, **settings)
    assert not warnings
    headings = json.loads(typst.query(main, "heading.where(level: 1)", field="body", **settings))
    assert [heading["text"] for heading in headings] == [
        "Verdicts", "Résumé en français", "How to read this", "Method", "Steps, difficulties and choices",
        "What strategies and samplers buy", "Feature by feature", "spheres", "furnace_convex",
        "Is what is left noise?", "Speed", "What this cannot show",
        "Provenance", "References"]
    kinds = json.loads(typst.query(main, "figure", field="kind", **settings))
    assert kinds.count("table") == 2 + (3 + 2) + 3 + 4, "verdicts, gains; scenes; speed, samplers, devices; provenance"
    assert kinds.count("image") == 2 * 3 + 3, "images, curves, differences; gains, features, deviates"


def test_no_folder_is_left_half_written(exact: StudyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build_report(Inputs([exact], "quick"), tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def broken(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(document, "typeset", broken)
    with pytest.raises(KeyboardInterrupt):
        build_report(Inputs([dataclasses.replace(exact, scene="other")], "quick"), tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_figures_of_scenes_that_left_are_removed_and_other_files_kept(study: StudyResult, exact: StudyResult,
                                                                      tmp_path: Path) -> None:
    other = dataclasses.replace(study, strategies=study.strategies[:1])
    build_report(Inputs([other, exact], "quick"), tmp_path)
    (tmp_path / "figures" / "mine.txt").write_text("kept")
    build_report(Inputs([exact], "quick"), tmp_path)
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert "mine.txt" in names and "furnace-convex-curves.svg" in names
    assert not any(name.startswith("spheres") for name in names)


def test_the_same_results_give_the_same_pages(study: StudyResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    first, second = compose(Inputs([study], "quick")), compose(Inputs([study], "quick"))
    assert first == second and first.date == "14 November 2023"


@pytest.mark.parametrize("results", [0, 2])
def test_results_that_make_no_report_are_refused(study: StudyResult, tmp_path: Path, results: int) -> None:
    with pytest.raises(HarnessError, match=r"at least one study|two studies of a scene called 'spheres'"):
        build_report(Inputs([study] * results, "quick"), tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_unwritable_folder_is_refused_before_any_work(study: StudyResult, tmp_path: Path,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "compose", lambda *_, **__: pytest.fail("began to work"))
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StoreError, match="cannot be written"):
        build_report(Inputs([study], "quick"), tmp_path / "file")


def test_scene_names_that_look_alike_in_links_are_told_apart(exact: StudyResult) -> None:
    names = ["a b", "a_b", "A-B", "---"]
    inputs = Inputs([dataclasses.replace(exact, scene=name) for name in names], "quick")
    assert inputs.stems == ("a-b", "a-b-2", "a-b-3", "scene")
    assert [chapter.anchor for chapter in compose(inputs).chapters if chapter.title in names] == list(inputs.anchors)


def test_a_scene_may_be_called_as_a_chapter_is(exact: StudyResult) -> None:
    made = compose(Inputs([dataclasses.replace(exact, scene="provenance")], "quick", bench=BENCH))
    anchors = [chapter.anchor for chapter in made.chapters]
    assert len(set(anchors)) == len(anchors) and anchors[-2:] == ["provenance", "references"]
    assert typeset(made).startswith(b"%PDF"), "typst refuses a label that stands twice"


def test_a_benchmark_shows_which_targets_were_missed(output: Path) -> None:
    chapters = json.loads((output / "report.json").read_text())["chapters"]
    rows = next(chapter for chapter in chapters if chapter["title"] == "Speed")["blocks"][0]["rows"]
    assert [[cell["text"] for cell in row][-3] for row in rows] == ["reached", "missed"]
    assert [row[-3]["mark"] for row in rows] == ["pass", "fail"]


def test_the_best_of_both_renderers_is_named(output: Path) -> None:
    chapters = json.loads((output / "report.json").read_text())["chapters"]
    _, sentence, table, _ = next(chapter for chapter in chapters if chapter["title"] == "Speed")["blocks"]
    assert "4.8\xa0× (cornell, mis sobol)" in sentence["text"]
    assert [[cell["text"] for cell in row] for row in table["rows"]] == [
        ["cornell", "multijitter", "mis", "4.8\xa0×\xa0[4.1,\xa05.5]", "sobol"]]


# ---- every field of a result


def fingerprint(made: Document) -> str:
    return made.json() + repr(sorted((name, hash(content)) for name, content in made.assets().items()))


def altered(value: Any) -> Any:
    """Another value of the same kind, different enough to show."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return {"pass": "fail", "fail": "inconclusive", "inconclusive": "pass"}.get(value, value + " changed")
    if isinstance(value, int):
        return value + 17
    if isinstance(value, float | np.ndarray):
        return value * 0.9 - 0.01
    if isinstance(value, dict):
        return {**value, "a new name": "a new value"}
    if isinstance(value, tuple):
        return tuple(map(altered, value)) if value and isinstance(value[0], float) else (*value, "one more")
    raise AssertionError(f"no other value for {type(value)}")


def variants(study: StudyResult) -> Iterator[tuple[str, StudyResult]]:
    """The study with one field changed, for every field of it, of its first strategy, and of verdict and slope."""
    first, rest = study.strategies[0], study.strategies[1:]
    assert first.slope is not None

    def with_strategy(strategy: StrategyResult) -> StudyResult:
        return dataclasses.replace(study, strategies=(strategy, *rest))

    for name in fields(StudyResult) - {"strategies", "reference", "error"}:  # whose costs `harness study` tells
        yield name, dataclasses.replace(study, **{name: altered(getattr(study, name))})
    yield "reference", dataclasses.replace(study, reference=first.estimate)
    yield "strategies", dataclasses.replace(study, strategies=rest)
    for name in fields(StrategyResult) - {"estimate", "verdict", "tiles", "slope", "measured"}:
        yield f"strategy {name}", with_strategy(dataclasses.replace(first, **{name: altered(getattr(first, name))}))
    for name in ("seconds_per_spp", "device"):
        yield f"strategy {name}", with_strategy(with_measured(first, **{name: altered(getattr(first, name))}))
    for name, curve in first.curves.items():
        yield f"curve {name}", with_strategy(with_curves(first, **{name: altered(curve)}))
    for name in (metric.name for metric in shown_in("report") if not metric.at_prefixes):
        scores = {**first.scores, name: altered(first.scores[name])}
        yield f"score {name}", with_strategy(with_measured(first, scores=scores))
    yield "strategy spp", with_strategy(with_measured(first, spp=first.spp * 2))
    yield "strategy slope", with_strategy(dataclasses.replace(first, slope=None))
    yield "strategy estimate", with_strategy(dataclasses.replace(first, estimate=rest[0].estimate))
    for name in fields(MeanErrorVerdict):
        verdict = dataclasses.replace(first.verdict, **{name: altered(getattr(first.verdict, name))})
        yield f"verdict {name}", with_strategy(dataclasses.replace(first, verdict=verdict))
    for name in fields(TileFinding):
        finding = dataclasses.replace(first.tiles.fine, **{name: altered(getattr(first.tiles.fine, name))})
        yield f"finding {name}", with_strategy(
            dataclasses.replace(first, tiles=dataclasses.replace(first.tiles, fine=finding)))
    reason = dataclasses.replace(first.tiles.coarse, reason="another")
    yield "reason of a failure", with_strategy(
        dataclasses.replace(first, tiles=dataclasses.replace(first.tiles, coarse=reason)))
    for name in fields(Slope):
        slope = dataclasses.replace(first.slope, **{name: altered(getattr(first.slope, name))})
        yield f"slope {name}", with_strategy(dataclasses.replace(first, slope=slope))


def fields(kind: type) -> set[str]:
    return set(get_type_hints(kind))


def test_every_field_of_a_result_reaches_the_report(study: StudyResult, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a study found can be seen: change any one field and the report changes."""
    first = study.strategies[0]
    failing = dataclasses.replace(first.tiles.coarse, outcome="fail")
    first = dataclasses.replace(first, tiles=dataclasses.replace(first.tiles, coarse=failing))
    study = dataclasses.replace(study, strategies=(first, study.strategies[1]))

    def unseen(candidates: list[tuple[str, StudyResult]]) -> list[tuple[str, StudyResult]]:
        base = fingerprint(compose(Inputs([study], "quick")))
        return [(name, variant) for name, variant in candidates
                if fingerprint(compose(Inputs([variant], "quick"))) == base]

    with monkeypatch.context() as words_only:  # figures take time, and most fields show in the words already
        words_only.setattr(remembered, "remembered_bytes", lambda kind, key, make: make())
        words_only.setattr(convergence, "curves_svg", lambda result: b"")
        words_only.setattr(scenes.pictures, "perceived_map", lambda test, *_: test[..., 0])
        left = unseen(list(variants(study)))
    assert 0 < len(left) < 6
    assert {name for name, _ in unseen(left)} == {"finding reason"}, "words are spared for what is merely undecided"


# ---- the HTML page


class Checker(HTMLParser):
    """Collects what a page says, links to and loads, and that its elements close in order."""

    VOID = frozenset(("meta", "img", "br", "wbr"))

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.images_without_words = 0
        self.text: list[str] = []
        self.rows: list[list[tuple[int, int]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [value for name, value in attrs if name == "id" and value]
        self.loads += [value for name, value in attrs if name in ("src", "xlink:href") and value]
        self.links += [given["href"] or ""] if tag == "a" else []
        self.images_without_words += tag == "img" and not given.get("alt")
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append((int(given.get("colspan") or 1), int(given.get("rowspan") or 1)))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("script", "style"):
            self.text.append(data)


@pytest.fixture(scope="module")
def checked(page: str) -> Checker:
    checker = Checker()
    checker.feed(page)
    return checker


def test_the_page_is_well_formed_with_unique_names_and_working_links(checked: Checker) -> None:
    assert not checked.open
    assert len(set(checked.ids)) == len(checked.ids)
    assert checked.links and all(link[1:] in checked.ids for link in checked.links)


def test_the_page_needs_no_other_file(page: str, checked: Checker) -> None:
    assert checked.loads
    assert all(load.startswith(("data:image/png;base64,", "#")) for load in checked.loads)
    assert all(load[1:] in checked.ids for load in checked.loads if load.startswith("#"))
    assert all(name in checked.ids for name in re.findall(r"url\(#([^)]*)\)", page))
    assert not re.search(r"<link|@import|url\((?!#|data:font/woff;base64,)|\b(fetch|import|XMLHttpRequest)\(", page)
    assert f'http-equiv="Content-Security-Policy" content="{html.escape(POLICY)}"' in page, "and may load none"


def test_every_image_of_the_page_has_words_for_those_who_do_not_see_it(checked: Checker) -> None:
    assert checked.images_without_words == 0


def test_the_page_says_what_the_pdf_says(checked: Checker, output: Path) -> None:
    said = re.sub(r"\s+", "", "".join(checked.text))
    data = json.loads((output / "report.json").read_text())

    def strings(value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            for name, each in value.items():
                if name not in ("file", "alt", "mark", "align", "anchor", "target", "colour", "symbols", "kind",
                                "path", "source", "language"):
                    yield from strings(each)
        elif isinstance(value, list):
            for each in value:
                yield from strings(each)
        elif isinstance(value, str):
            yield value

    missing = [text for text in strings(data) if re.sub(r"\s+", "", text) not in said]
    assert not missing


def test_markup_in_a_scene_file_is_shown_and_not_obeyed(study: StudyResult, tmp_path: Path) -> None:
    description = "One <b>bold</b> & #strong[typst] *word* $x$.\n\nA second paragraph."
    build_report(Inputs([dataclasses.replace(study, description=description)], "quick"), tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "One &lt;b&gt;bold&lt;/b&gt; &amp; #strong[typst] *word* $x$." in page
    assert "<p>A second paragraph.</p>" in page
