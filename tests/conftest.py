"""Fixtures of all tests: a cache of their own, and the command line as a user runs it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.gpu.width import Verdict
from harness.pytest_plugin import GateItem

# Where Python may not write bytecode (containers often say so), each of hundreds of processes that tests start would
# compile our modules anew, and every run rewrite all assertions: 15 s of CPU time a worker. `make clean` removes it.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

RunHarness = Callable[..., subprocess.CompletedProcess[str]]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Gates first. pytest-xdist gives each worker a part of the list, and whoever has done his takes from the end of
    another's: where short tests stand there, no worker waits for another's gate."""
    items.sort(key=lambda item: not isinstance(item, GateItem))


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cold cache for the run, shared by pytest-xdist's workers; the user's is neither used nor touched.

    But for the gates, which the plugin runs without fixtures: their references stay in the user's cache.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_CACHE", str(folder / "cache"))
        yield folder / "cache"


@pytest.fixture(scope="session", autouse=True)
def usual_width() -> Iterator[None]:
    """Commands that tests run in their own process get no context with 512-bit vectors: later tests draw fragments in
    it, which crashes. It did, with AVX-512, where a worker's first context was that of `harness render`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.gpu.width._Process.decided", Verdict(False, "tests draw fragments as well"))
        yield


@pytest.fixture
def run_harness(tmp_path: Path) -> RunHarness:
    """Runs `harness ARGUMENTS` in a process and a folder of its own: run_harness("doctor", "--json", NAME="value")."""
    def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "harness", *arguments], capture_output=True, text=True,
                              cwd=tmp_path, env={**os.environ, **variables}, stdin=subprocess.DEVNULL)
    return run
