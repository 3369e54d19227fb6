"""The pytest plugin as a repository of somebody else's sees it: what it collects, shows and leaves behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import harness.gates  # what in-process runs import must be there before and stay: it cannot be imported twice
from harness.gates import artefacts, summary
from harness.gates import left as left_names
from harness.machine.mitsuba_runtime import use_reference_variant
from tests.support.gates import GATES, write

pytest_plugins = ["pytester"]

WRONG = GATES + """
[[gate]]
name = "wrong"
scene = "sky.xml"
strategy = "cosine"
reference = { value = [0.5, 0.5, 0.51] }
reason = "The reference is 2 % off in blue."
"""
INI = "[pytest]\nharness_gates = gates.toml\n"


@pytest.fixture(scope="module", autouse=True)
def mitsuba() -> None:
    """Of a gate that fails Mitsuba is asked; it too must be there before `pytester` writes down what is imported."""
    use_reference_variant()


@pytest.fixture
def repository(pytester: pytest.Pytester) -> Path:
    """A repository with one gates file that is right, named in its ini file, and one test of its own."""
    assert harness.gates and artefacts and summary
    write(pytester.path)
    pytester.makeini(INI)
    pytester.makepyfile("def test_own():\n    pass\n")
    return pytester.path


class TestCollection:
    """Which files become tests."""

    def test_is_of_the_ini_files_gates(self, pytester: pytest.Pytester, repository: Path) -> None:
        result = pytester.runpytest("-v")
        result.assert_outcomes(passed=2)
        result.stdout.fnmatch_lines(["gates.toml::sky PASSED*"])

    def test_leaves_other_toml_files_alone(self, pytester: pytest.Pytester, repository: Path) -> None:
        """Even one of that very name, and one that is not TOML at all."""
        (repository / "sub").mkdir()
        (repository / "sub" / "gates.toml").write_text("[[not closed")
        (repository / "other.toml").write_text("\x00")
        pytester.runpytest().assert_outcomes(passed=2)
        pytester.makeini("[pytest]\n")
        pytester.runpytest().assert_outcomes(passed=1)

    def test_is_of_the_command_lines_gates(self, pytester: pytest.Pytester, repository: Path) -> None:
        pytester.makeini("[pytest]\n")
        pytester.runpytest("--harness-gates=gates.toml").assert_outcomes(passed=2)

    def test_finds_the_command_lines_gates_wherever_they_lie(
        self, pytester: pytest.Pytester, repository: Path, tmp_path_factory: pytest.TempPathFactory,
    ) -> None:
        elsewhere = write(tmp_path_factory.mktemp("elsewhere"))
        pytester.makeini("[pytest]\n")
        (repository / "own").mkdir()
        pytester.runpytest("own", f"--harness-gates={elsewhere}").assert_outcomes(passed=1)

    def test_takes_one_gate_alone(self, pytester: pytest.Pytester, repository: Path) -> None:
        write(repository, WRONG)
        pytester.runpytest("gates.toml::sky").assert_outcomes(passed=1)
        pytester.runpytest("-k", "wrong").assert_outcomes(failed=1, deselected=2)

    def test_of_a_bad_file_shows_its_line(self, pytester: pytest.Pytester, repository: Path) -> None:
        write(repository, GATES.replace('"cosine"', '"metropolis"'))
        result = pytester.runpytest()
        result.assert_outcomes(errors=1)
        result.stdout.fnmatch_lines(["gates.toml:11: unknown strategy 'metropolis'; choose from uniform, *"])
        assert "Traceback" not in result.stdout.str()


    def test_is_of_the_ini_files_gates_besides_testpaths(self, pytester: pytest.Pytester, repository: Path) -> None:
        """All tests means the gates too; one folder of them does not."""
        pytester.makeini(INI + "testpaths = unit\n")
        (repository / "unit").mkdir()
        (repository / "test_is_of_the_ini_files_gates_besides_testpaths.py").rename(repository / "unit" / "test_own.py")
        pytester.runpytest().assert_outcomes(passed=2)
        pytester.runpytest("unit").assert_outcomes(passed=1)

    def test_takes_a_gates_file_of_any_suffix(self, pytester: pytest.Pytester, repository: Path) -> None:
        (repository / "gates.toml").rename(repository / "gates.txt")
        pytester.makeini("[pytest]\n")
        pytester.runpytest("--harness-gates=gates.txt").assert_outcomes(passed=2)

    def test_of_a_file_that_is_missing_is_refused(self, pytester: pytest.Pytester, repository: Path) -> None:
        """Or a typing slip would leave all gates out, and the run would be green."""
        pytester.makeini("[pytest]\nharness_gates = gats.toml\n")
        result = pytester.runpytest()
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        result.stderr.fnmatch_lines([f"ERROR: *tox.ini: harness_gates: no such file: {repository / 'gats.toml'}"])

    def test_keeps_gates_of_several_files_apart(self, pytester: pytest.Pytester, repository: Path) -> None:
        """Two students whose gates have the same names."""
        (repository / "bär ne").mkdir()
        write(repository / "bär ne", WRONG)
        pytester.makeini('[pytest]\nharness_gates = gates.toml "bär ne/gates.toml"\n')
        result = pytester.runpytest("--harness-generate-summary=json")
        result.assert_outcomes(passed=3, failed=1)
        result.stdout.fnmatch_lines(["run again: harness gate 'bär ne/gates.toml' --only wrong"])
        results = repository / "harness-results"
        gates = json.loads((results / "summary.json").read_text())["gates"]
        assert sorted(gate["gate"] for gate in gates) == [
            "bär ne/gates.toml/sky", "bär ne/gates.toml/wrong", "gates.toml/sky"]
        assert all((results / gate["gate"] / "result.json").is_file() for gate in gates)


class TestFailure:
    """What a gate that does not pass says and leaves."""

    def test_tells_what_was_found_and_how_to_run_it_again(self, pytester: pytest.Pytester, repository: Path) -> None:
        write(repository, WRONG)
        result = pytester.runpytest()
        result.assert_outcomes(passed=2, failed=1)
        result.stdout.fnmatch_lines([
            "fail: the image: blue -1.96 %*lies outside ±0.2 %*",
            "mean error of luminance *, tolerance ±0.2 %, after 16 of 64 samples per pixel",
            "why this tolerance: The reference is 2 % off in blue.",
            f"look at: {repository / 'harness-results' / 'wrong'}",
            "run again: harness gate gates.toml --only wrong",
            "1 fail, 1 pass",
            f"summary: {repository / 'harness-results' / 'summary.html'}",
        ])
        assert "Traceback" not in result.stdout.str()
        left = {path.name for path in (repository / "harness-results" / "wrong").iterdir()}
        assert left == {*artefacts.IMAGES, *left_names.PICTURES, artefacts.LADDER, artefacts.RESULT_FILE}
        assert {path.name for path in (repository / "harness-results" / "sky").iterdir()} == {artefacts.RESULT_FILE}

    def test_of_what_cannot_run_is_one_line(self, pytester: pytest.Pytester, repository: Path) -> None:
        write(repository)
        (repository / "sky.xml").write_text("<scene version='3.0.0'>\n</scene>\n")
        result = pytester.runpytest("--harness-generate-summary=json")
        result.assert_outcomes(passed=1, failed=1)
        result.stdout.fnmatch_lines(["sky.xml:1: the scene has no <sensor>*"])
        assert "Traceback" not in result.stdout.str()
        gate, = json.loads((repository / "harness-results" / "summary.json").read_text())["gates"]
        assert (gate["gate"], gate["outcome"]) == ("sky", "error")
        assert gate["reason"].startswith("sky.xml:1: ")
        assert gate["command"] == "harness gate gates.toml --only sky"

    def test_of_what_cannot_run_leaves_nothing_of_an_earlier_run(
        self, pytester: pytest.Pytester, repository: Path,
    ) -> None:
        pytester.runpytest()
        assert (repository / "harness-results" / "sky").is_dir()
        (repository / "sky.xml").write_text("<scene version='3.0.0'>\n</scene>\n")
        pytester.runpytest()
        assert [path.name for path in (repository / "harness-results").iterdir()] == ["summary.html"]

    def test_to_write_is_told_in_one_line(self, pytester: pytest.Pytester, repository: Path) -> None:
        (repository / "taken").touch()
        result = pytester.runpytest("--harness-results-path=taken/results")
        result.assert_outcomes(passed=1, failed=1)
        result.stdout.fnmatch_lines(["*/taken/results/sky/result.json: cannot be written, *", "no summary: *"])
        (repository / "full" / "summary.html").mkdir(parents=True)
        result = pytester.runpytest("--harness-results-path=full", "--harness-generate-summary=html")
        assert result.ret == pytest.ExitCode.TESTS_FAILED
        result.stdout.fnmatch_lines(["no summary: *summary.html: cannot be written, it is a folder; name a file"])
        assert "INTERNALERROR" not in result.stdout.str()


class TestOptions:
    """The habits of pytest-mpl."""

    def test_results_go_where_the_command_line_says(self, pytester: pytest.Pytester, repository: Path) -> None:
        pytester.makeini(INI + "harness_results_path = from-ini\n")
        pytester.runpytest()
        assert (repository / "from-ini" / "sky" / "result.json").is_file()
        pytester.runpytest("--harness-results-path=from-line")
        assert (repository / "from-line" / "sky" / "result.json").is_file()

    @pytest.mark.parametrize(("kinds", "files"), [
        ("html", {"summary.html"}), ("json", {"summary.json"}), ("html,json", {"summary.html", "summary.json"})])
    def test_a_summary_is_written_when_asked_for(
        self, pytester: pytest.Pytester, repository: Path, kinds: str, files: set[str],
    ) -> None:
        pytester.runpytest(f"--harness-generate-summary={kinds}").assert_outcomes(passed=2)
        assert {path.name for path in (repository / "harness-results").iterdir()} == {"sky", *files}

    def test_no_summary_is_written_when_all_pass_unless_asked_for(
        self, pytester: pytest.Pytester, repository: Path,
    ) -> None:
        pytester.runpytest()
        assert {path.name for path in (repository / "harness-results").iterdir()} == {"sky"}

    @pytest.mark.parametrize(("option", "message"), [
        ("--harness-generate-summary=pdf", "unknown kind 'pdf'; choose from html, json"),
        ("--harness-gates=typo.toml", "no such file: *typo.toml")])
    def test_that_are_wrong_are_refused(
        self, pytester: pytest.Pytester, repository: Path, option: str, message: str,
    ) -> None:
        result = pytester.runpytest(option)
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        result.stderr.fnmatch_lines([f"ERROR: {option.partition('=')[0]}: {message}"])


def test_scenes_are_freed_after_the_last_gate(
    pytester: pytest.Pytester, repository: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Living scenes slow down whatever other tests of the process do with Mitsuba."""
    write(repository, WRONG)
    freed: list[object] = []
    monkeypatch.setattr("harness.gates.References.close", lambda references: freed.append(references))
    pytester.runpytest("gates.toml", "test_scenes_are_freed_after_the_last_gate.py").assert_outcomes(passed=2, failed=1)
    assert len(freed) == 1


def test_xdists_workers_share_one_summary(pytester: pytest.Pytester, repository: Path) -> None:
    write(repository, WRONG)
    result = pytester.runpytest_subprocess("-n2", "--harness-generate-summary=json", "--harness-no-ladder")
    result.assert_outcomes(passed=2, failed=1)
    gates = json.loads((repository / "harness-results" / "summary.json").read_text())["gates"]
    assert [(gate["gate"], gate["outcome"]) for gate in gates] == [("wrong", "fail"), ("sky", "pass")]
    assert (repository / "harness-results" / "wrong" / "z-map.png").is_file()


def test_the_plugin_is_an_entry_point_and_brings_nothing_heavy(tmp_path: Path) -> None:
    """A repository that has no gates pays nothing for it."""
    (tmp_path / "conftest.py").write_text(
        "import sys\n"
        "def pytest_unconfigure(config):\n"
        "    assert 'harness.pytest_plugin' in sys.modules\n"
        "    heavy = {'numpy', 'scipy', 'mitsuba', 'moderngl', 'matplotlib', 'typer'} & sys.modules.keys()\n"
        "    print(f'heavy: {sorted(heavy)}')\n")
    (tmp_path / "test_own.py").write_text("def test_own():\n    pass\n")
    done = subprocess.run([sys.executable, "-m", "pytest", "-s", "-p", "no:xdist"], cwd=tmp_path, capture_output=True,
                          text=True, env=dict(os.environ))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "heavy: []" in done.stdout
