"""The pytest plugin: each gate of a gates file is one test, which leaves behind what one needs to look at it.

A gates file is collected where the ini option `harness_gates` or the command line (`--harness-gates=PATH`) names it;
no other file is touched, and nothing heavy is imported before one is collected. Options follow pytest-mpl's habits.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.gates import Gate, GateResult, References
    from harness.results import GateRecord
    from harness.shader.library import Library

# Where results go, below the root folder, when neither the ini file nor the command line says.
RESULTS = "harness-results"
# Under this name each report carries its gate's result, as JSON text, from pytest-xdist's workers to the controller.
PROPERTY = "harness_gate"
KINDS = ("html", "json")
# One a process: gates of one scene share Mitsuba's image, which is kept in the cache between runs.
_REFERENCES: pytest.StashKey[References] = pytest.StashKey()


@pytest.fixture(scope="session")
def shader_library(pytestconfig: pytest.Config) -> Library:
    """The shader library under test: the harness's, but for what `harness mutants` seeds into it."""
    from harness.mutants.under_test import LIBRARY
    from harness.shader.library import OURS

    return pytestconfig.stash.get(LIBRARY, OURS)



def pytest_addoption(parser: pytest.Parser) -> None:
    """Add our options and their ini counterparts."""
    group = parser.getgroup("harness", "tolerance gates of renderers")
    group.addoption("--harness-gates", action="append", default=[], metavar="PATH",
                    help="a gates file (.toml) to collect, besides those of the ini option harness_gates")
    group.addoption("--harness-results-path", metavar="DIR",
                    help=f"folder for what gates leave behind (ini: harness_results_path; {RESULTS} if neither)")
    group.addoption("--harness-generate-summary", metavar="KINDS",
                    help="write a summary of all gates: html, json, or both with a comma between; without this option "
                         "html when a gate does not pass")
    group.addoption("--harness-no-ladder", action="store_true",
                    help="do not run a gate that fails at lesser depths, to tell from which bounce on it is wrong")
    parser.addini("harness_gates", "gates files (.toml), relative to the root folder", type="paths", default=[])
    parser.addini("harness_results_path", "folder for what gates leave behind", default=None)


def pytest_configure(config: pytest.Config) -> None:
    """Check the options, and let a gates file of the command line be collected wherever it lies."""
    given = config.getoption("--harness-generate-summary")
    if unknown := [kind for kind in _kinds(given) if kind not in KINDS]:
        raise pytest.UsageError(f"--harness-generate-summary: unknown kind '{unknown[0]}'; choose from html, json")
    ours, theirs = _of_command_line(config), _of_ini_file(config)
    for option, paths in (("--harness-gates", ours), (f"{config.inipath}: harness_gates", theirs)):
        if missing := [path for path in paths if not path.is_file()]:  # a typing slip must not leave gates out silently
            raise pytest.UsageError(f"{option}: no such file: {missing[0]}")
    # Those of the ini file are to run wherever all of the repository's tests do, whether or not testpaths names them.
    everything = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    for path in (*ours, *(theirs if everything else ())):
        roots = [(config.invocation_params.dir / argument.partition("::")[0]).resolve() for argument in config.args]
        if not any(path.is_relative_to(root) for root in roots):
            config.args.append(str(path))
    config.pluginmanager.register(_Summary(config), "harness-summary")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect the gates files that were named, and only those."""
    if file_path.resolve() not in _gates_files(parent.config):
        return None
    return GatesCollector.from_parent(parent, path=file_path)


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """After the last gate, free what would slow down other tests of the same process."""
    if isinstance(item, GateItem) and not isinstance(nextitem, GateItem):
        item.config.stash[_REFERENCES].close()


class GatesCollector(pytest.File):
    """One gates file: a test for each gate."""

    def collect(self) -> Iterable[pytest.Item]:
        from harness.files import cache_dir
        from harness.gates import References, load_gates
        from harness.samples.store import Store

        if _REFERENCES not in self.config.stash:  # now, since a test may point $HARNESS_CACHE elsewhere later
            self.config.stash[_REFERENCES] = References(Store(cache_dir() / "batches"))
        try:
            gates = load_gates(_short(self.path, self.config)).gates
        except HarnessError as error:
            raise self.CollectError(str(error)) from None
        for gate in gates:
            yield GateItem.from_parent(self, name=gate.name, gate=gate, label=self._label(gate.name))

    def _label(self, name: str) -> str:
        """What a gate is called in the run, and its folder: with its file before it where there are several."""
        if len(_gates_files(self.config)) == 1:
            return name
        path, root = self.path.resolve(), self.config.rootpath.resolve()
        shown = path.relative_to(root if path.is_relative_to(root) else path.anchor)
        return f"{shown.as_posix()}/{name}"


class GateItem(pytest.Item):
    """One gate. It passes when its verdict does; its artefacts lie in a folder of its label."""

    def __init__(self, *, gate: Gate, label: str, **options: Any) -> None:
        super().__init__(**options)
        self.gate, self.label = gate, label

    def runtest(self) -> None:
        from harness.files import require_writable
        from harness.gates import artefacts, run_gate
        from harness.gates.left import RESULT_FILE

        folder = results_folder(self.config) / self.label
        artefacts.clear(folder)
        try:
            require_writable(folder / RESULT_FILE)
            result = run_gate(self.gate, self.config.stash[_REFERENCES],
                              ladder=not self.config.getoption("--harness-no-ladder"))
            artefacts.save_result(result, folder, pictures=result.outcome != "pass")
        except HarnessError as error:
            with suppress(OSError):
                folder.rmdir()
            self._tell(artefacts.error_record(self.gate, error))
            raise
        self._tell(artefacts.record(result))
        if result.outcome != "pass":
            raise GateFailure(result, folder)

    def _tell(self, found: GateRecord) -> None:
        from harness.gates.records import as_json

        self.user_properties.append((PROPERTY, json.dumps(as_json(replace(found, gate=self.label)))))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What went wrong, without a traceback unless it is a bug of the harness."""
        if isinstance(excinfo.value, GateFailure | HarnessError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, int(self.gate.origin.rpartition(":")[2]) - 1, f"gate: {self.label}"


class GateFailure(Exception):
    """A gate that did not pass, told in a few lines."""

    def __init__(self, result: GateResult, folder: Path) -> None:
        from harness.gates.artefacts import command
        from harness.stats.bias import percent

        gate, mean = result.gate, result.verdict.mean
        super().__init__("\n".join((
            f"{result.outcome}: {result.reason}",
            f"mean error of luminance {percent(result.verdict.luminance[0], signed=True)}, tolerance "
            f"±{percent(mean.tolerance)}, after {result.test.samples} of {gate.spp * gate.replicas} samples per pixel",
            f"why this tolerance: {gate.reason}",
            f"look at: {folder}",
            f"run again: {command(gate)}")))


class _Summary:
    """Gathers the results of all gates, from pytest-xdist's workers too, and writes the summary at the end."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.results: list[GateRecord] = []
        self.written: list[Path] = []
        self.trouble = ""  # what kept the summary from being written

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when != "call":
            return
        found = dict(report.user_properties).get(PROPERTY)
        if found is not None:
            from harness.gates.records import from_json

            self.results.append(from_json(json.loads(str(found))))
        elif report.failed and report.location[2].startswith("gate: "):
            from harness.results import GateRecord

            self.results.append(GateRecord(report.location[2].removeprefix("gate: "), "error", report.longreprtext))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(self.config, "workerinput") or not self.results:  # a worker's results are the controller's too
            return
        from harness.gates.summary import write_summary

        kinds = _kinds(self.config.getoption("--harness-generate-summary"))
        if not kinds and any(result.outcome != "pass" for result in self.results):
            kinds = ("html",)
        try:
            self.written = write_summary(self.results, results_folder(self.config), kinds)
        except HarnessError as error:
            self.trouble = str(error)
            session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.results:
            outcomes = [result.outcome for result in self.results]
            terminalreporter.write_sep("=", "gates")
            terminalreporter.write_line(", ".join(f"{outcomes.count(outcome)} {outcome}" for outcome in dict.fromkeys(
                sorted(outcomes))))
            for path in self.written:
                terminalreporter.write_line(f"summary: {path}")
            if self.trouble:
                terminalreporter.write_line(f"no summary: {self.trouble}", red=True)


def results_folder(config: pytest.Config) -> Path:
    """Where gates leave their artefacts: the option's folder, the ini file's, or `harness-results`."""
    if given := config.getoption("--harness-results-path"):
        return config.invocation_params.dir / given
    return config.rootpath / (config.getini("harness_results_path") or RESULTS)


def _gates_files(config: pytest.Config) -> set[Path]:
    return {path.resolve() for path in (*_of_ini_file(config), *_of_command_line(config))}


def _of_ini_file(config: pytest.Config) -> list[Path]:
    return [path.resolve() for path in config.getini("harness_gates")]


def _of_command_line(config: pytest.Config) -> list[Path]:
    return [(config.invocation_params.dir / given).resolve() for given in config.getoption("--harness-gates")]


def _kinds(given: str | None) -> tuple[str, ...]:
    return tuple(kind.strip() for kind in given.split(",")) if given else ()


def _short(path: Path, config: pytest.Config) -> Path:
    """The path as a user types it, for messages."""
    folder = config.invocation_params.dir
    return path.relative_to(folder) if path.is_relative_to(folder) else path
