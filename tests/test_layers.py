"""The rules of DESIGN that hold the code together: who may import whom, sizes, and tests that never skip."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

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
    ("checks", "estimators"),
    ("work",),
    ("api", "diagnosis", "studies"),
    ("bench", "course"),
    ("report",),
    ("gates",),
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
    "checks": {"checks", "gpu", "samples", "shader"},
    "gpu": {"errors", "files", "gpu", "samples", "scene", "shader"},
    "reference": {"errors", "files", "machine", "reference", "samples", "scene"},
    "report": {"errors", "files", "metrics", "report", "results", "samples", "scene", "stats", "studies"},
}
# Who may import a package at all.
PACKAGES = {"moderngl": {"gpu"}, "mitsuba": {"machine", "reference", "scene"},
            "drjit": {"machine", "reference", "scene"}}
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


def imports(path: Path) -> Iterator[str]:
    """Absolute names of everything imported anywhere in a file, with what `from` takes out of packages."""
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


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
class TestModule:
    """Each module of the package."""

    def test_has_a_place_on_a_floor(self, path: Path) -> None:
        assert part(path) in FLOOR_OF, "give the new room a place in FLOORS"

    def test_imports_from_below(self, path: Path) -> None:
        mine = part(path)
        higher = {name for name in harness_parts(path) if FLOOR_OF[name] > FLOOR_OF[mine]}
        assert not higher, f"{mine} may not import {sorted(higher)}"
        allowed = ONLY.get("bootstrap" if path.stem == "bootstrap" else mine)
        assert allowed is None or harness_parts(path) <= allowed

    def test_imports_a_package_only_where_it_is_at_home(self, path: Path) -> None:
        packages = {name.split(".")[0] for name in imports(path)}
        wrong = {name for name in packages & PACKAGES.keys() if part(path) not in PACKAGES[name]}
        assert not wrong, f"{part(path)} may not import {sorted(wrong)}"

    def test_opens_no_renderer_but_through_an_estimator(self, path: Path) -> None:
        tree = parsed(path)
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        assert part(path) in OPENERS or not names & RENDERERS

    def test_of_a_report_keeps_media_and_chapters_apart(self, path: Path) -> None:
        inside = path.relative_to(ROOT / "harness").as_posix()
        wrong = {name for folder, other in APART if inside.startswith(f"{folder}/")
                 for name in imports(path) if name.startswith(other)}
        assert not wrong, f"{inside} may not import {sorted(wrong)}"

    def test_begins_with_a_line_that_says_what_it_is_for(self, path: Path) -> None:
        docstring = ast.get_docstring(parsed(path))
        assert docstring and docstring.splitlines()[0].strip()

    def test_is_short_enough_to_hold_in_the_head(self, path: Path) -> None:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES


@pytest.mark.parametrize("path", TESTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_test_skips(path: Path) -> None:
    """A machine that lacks GL or LLVM fails: a skipped comparison looks like one that passed."""
    tree = parsed(path)
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not names & {"skip", "skipif", "importorskip", "xfail"}
