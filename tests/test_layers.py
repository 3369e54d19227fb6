"""The rules of DESIGN that hold the code together: who may import whom, sizes, and tests that never skip."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted((ROOT / "harness").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))

# A module imports from its own layer or one below. `tracer` and `reference` never import each other.
LAYERS = (
    ("errors",),
    ("estimate", "scene", "metrics", "stats", "mitsuba_runtime", "files", "images"),
    ("tracer", "reference", "exr"),
    ("store", "results", "runs", "studies", "doctor"),
    ("gates", "mutants", "report", "bench", "gallery", "exhibits", "calibration"),
    ("cli", "pytest_plugin"),
    ("__init__", "__main__"),
)
LAYER_OF = {name: layer for layer, names in enumerate(LAYERS) for name in names}
# Stricter than its layer: all that these may import of the harness, and which packages they may not.
ONLY = {
    "bootstrap": set(),
    "stats": {"errors", "stats"},
    "report": {"errors", "estimate", "exr", "files", "images", "metrics", "results", "stats", "report", "scene"},
    "tracer": {"errors", "estimate", "files", "scene", "tracer"},
    "reference": {"errors", "estimate", "files", "mitsuba_runtime", "scene", "reference"},
}
# Who may import a renderer's package at all.
RENDERERS = {"moderngl": {"tracer"}, "mitsuba": {"scene", "reference"}, "drjit": {"reference", "scene"}}
MAX_LINES = 450


def part(path: Path) -> str:
    """The name in LAYERS that a module belongs to: its own, or that of its package."""
    return path.relative_to(ROOT / "harness").parts[0].removesuffix(".py")


def imports(path: Path) -> Iterator[str]:
    """Absolute names of everything imported anywhere in a file, with what `from` takes out of packages."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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

    def test_has_a_place_in_the_layers(self, path: Path) -> None:
        assert part(path) in LAYER_OF or part(path) in ONLY, "give the new module a place in LAYERS"

    def test_imports_from_its_own_layer_or_below(self, path: Path) -> None:
        mine = part(path)
        if mine in ONLY:
            too_high = harness_parts(path) - ONLY[mine]
        else:
            too_high = {name for name in harness_parts(path) if LAYER_OF.get(name, 0) > LAYER_OF[mine]}
        assert not too_high, f"{mine} may not import {sorted(too_high)}"

    def test_imports_a_renderer_only_where_it_is_hosted(self, path: Path) -> None:
        packages = {name.split(".")[0] for name in imports(path)}
        wrong = {name for name in packages & RENDERERS.keys() if part(path) not in RENDERERS[name]}
        assert not wrong, f"{part(path)} may not import {sorted(wrong)}"

    def test_begins_with_a_line_that_says_what_it_is_for(self, path: Path) -> None:
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        assert docstring and docstring.splitlines()[0].strip()

    def test_is_short_enough_to_hold_in_the_head(self, path: Path) -> None:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES


@pytest.mark.parametrize("path", TESTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_test_skips(path: Path) -> None:
    """A machine that lacks GL or LLVM fails: a skipped comparison looks like one that passed."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not names & {"skip", "skipif", "importorskip", "xfail"}
