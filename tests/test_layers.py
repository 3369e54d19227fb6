"""The rules of DESIGN that hold the code together: who may import whom, sizes, and tests that never skip."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted((ROOT / "harness").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))

# The floors of the house, from the ground: a room imports from floors below its own, and from its neighbours on it.
FLOORS = (
    ("errors",),
    ("files", "progress", "stats"),
    ("machine", "samples"),
    ("scene", "metrics"),
    ("policy", "results", "shader"),
    ("gpu", "reference"),
    ("checks", "estimators", "strangers"),
    ("work",),
    ("api", "diagnosis", "studies"),
    ("bench", "course", "rivals", "view"),
    ("report",),
    ("gates", "grading", "notebook"),
    ("calibration", "mutants"),
    ("cli", "pytest_plugin"),
    ("__init__", "__main__"),
)
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
# Stricter than its floor: all that these may import of the harness.
ONLY = {
    "bootstrap": set(),  # runs before there is a harness
    "stats": {"errors", "stats"},
    "samples": {"errors", "files", "samples"},
    "shader": {"errors", "files", "scene", "shader"},
    "checks": {"checks", "errors", "gpu", "samples", "scene", "shader"},
    "gpu": {"errors", "files", "gpu", "samples", "scene", "shader"},
    "reference": {"errors", "files", "machine", "reference", "samples", "scene"},
    "report": {"errors", "files", "metrics", "report", "results", "samples", "scene", "stats", "studies"},
}
# Who may import a package at all.
PACKAGES = {"moderngl": {"gpu"}, "moderngl_window": {"gpu"}, "mitsuba": {"machine", "reference", "scene"},
            "drjit": {"machine", "reference", "scene"}, "distributed": {"work"}, "dask": {"work"}, "submitit": {"work"}}
# Who may say the name of a renderer, besides the room that it stands in: all others open estimators.
OPENERS = {"gpu", "reference", "estimators"}
RENDERERS = {"TracerRenderer", "ReferenceRenderer", "CoupledRenderer"}

# Inside the report: media know blocks and no chapter, chapters know blocks and no medium.
APART = (("report/pages", "harness.report.chapters"), ("report/chapters", "harness.report.pages"),
         ("report/figures", "harness.report.blocks"))
MAX_LINES = 450


def part(path: Path) -> str:
    """The name in FLOORS that a module belongs to: its own, or that of its package."""
    return path.relative_to(ROOT / "harness").parts[0].removesuffix(".py")


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file, which several rules ask for."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Absolute names of everything imported anywhere in a file, with what `from` takes out of packages."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                origin = ".".join([*package[:len(package) - node.level + 1], *filter(None, [origin])])
            yield from (f"{origin}.{alias.name}" for alias in node.names)


def harness_parts(path: Path) -> set[str]:
    """The parts of the harness that a file imports."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("harness.")}


def broken(rule: Callable[[Path], object], paths: Sequence[Path] = MODULES) -> dict[str, object]:
    """What a rule says of each file that breaks it. One test a rule: pytest takes longer for a test than a rule for a
    file."""
    return {path.relative_to(ROOT).as_posix(): wrong for path in paths if (wrong := rule(path))}


class TestModules:
    """The modules of the package."""

    def test_have_a_place_on_a_floor(self) -> None:
        assert not broken(lambda path: part(path) not in FLOOR_OF), "give a new room a place in FLOORS"

    def test_import_from_below(self) -> None:
        def higher(path: Path) -> set[str]:
            mine, parts = part(path), harness_parts(path)
            allowed = ONLY.get("bootstrap" if path.stem == "bootstrap" else mine, parts)
            return {name for name in parts if FLOOR_OF[name] > FLOOR_OF[mine]} | parts - allowed

        assert not broken(higher), "what these import stands above them"

    def test_import_a_package_only_where_it_is_at_home(self) -> None:
        def abroad(path: Path) -> set[str]:
            packages = {name.split(".")[0] for name in imports(path)}
            return {name for name in packages & PACKAGES.keys() if part(path) not in PACKAGES[name]}

        assert not broken(abroad)

    def test_open_no_renderer_but_through_an_estimator(self) -> None:
        def opened(path: Path) -> set[str]:
            if part(path) in OPENERS:
                return set()
            return {node.id for node in ast.walk(parsed(path)) if isinstance(node, ast.Name)} & RENDERERS

        assert not broken(opened)

    def test_of_a_report_keep_media_and_chapters_apart(self) -> None:
        def mixed(path: Path) -> set[str]:
            inside = path.relative_to(ROOT / "harness").as_posix()
            return {name for folder, other in APART if inside.startswith(f"{folder}/")
                    for name in imports(path) if name.startswith(other)}

        assert not broken(mixed)

    def test_begin_with_a_line_that_says_what_they_are_for(self) -> None:
        assert not broken(lambda path: not (ast.get_docstring(parsed(path)) or "").strip())

    def test_are_short_enough_to_hold_in_the_head(self) -> None:
        def lines(path: Path) -> int:
            return len(path.read_text(encoding="utf-8").splitlines())

        assert not broken(lambda path: max(0, lines(path) - MAX_LINES)), "so many lines too many"


def test_no_test_skips() -> None:
    """A machine that lacks GL or LLVM fails: a skipped comparison looks like one that passed."""
    def skips(path: Path) -> set[str]:
        names = {node.attr for node in ast.walk(parsed(path)) if isinstance(node, ast.Attribute)}
        return names & {"skip", "skipif", "importorskip", "xfail"}

    assert not broken(skips, TESTS)
