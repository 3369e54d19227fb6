"""What all commands share: errors in one line, exit statuses, help with an example, JSON apart from logs."""

from __future__ import annotations

import dataclasses
import json
import os
import pty
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from harness import cli
from harness.cli import COMMANDS, main
from harness.cli.output import progress, to_json
from harness.errors import HarnessError, MachineError, SceneError
from tests.cli.conftest import Harness

Command = Callable[[], object]
Register = Callable[[Command], None]


@pytest.fixture
def fake_command(monkeypatch: pytest.MonkeyPatch) -> Register:
    """Makes a function the one command `fake`."""
    def register(function: Command) -> None:
        module = ModuleType("harness.cli.fake")
        module.fake = function  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "harness.cli.fake", module)
        monkeypatch.setattr(cli, "COMMANDS", {"fake": "fake"})
    return register


def raising(error: BaseException) -> Command:
    def fake() -> None:
        raise error
    return fake


class TestExitStatus:
    """0 good, 1 a verdict against, 2 bad input, 3 a lacking machine; 128 + n where a signal ended it."""

    @pytest.mark.parametrize(("error", "status"), [
        (HarnessError("--spp: expected at least 1, found -3"), 2),
        (SceneError("scene.xml:3: unknown plugin 'cone'"), 2),
        (MachineError("no headless OpenGL; apt-get install libegl1"), 3),
    ])
    def test_a_users_mistake_is_one_line_without_a_traceback(
        self, fake_command: Register, capsys: pytest.CaptureFixture[str], error: HarnessError, status: int,
    ) -> None:
        fake_command(raising(error))
        assert main(["fake"]) == status
        output = capsys.readouterr()
        assert output.err == f"harness: error: {error}\n"
        assert output.out == ""

    def test_a_message_of_several_lines_becomes_one(
        self, fake_command: Register, capsys: pytest.CaptureFixture[str],
    ) -> None:
        fake_command(raising(HarnessError("first\n  second")))
        assert main(["fake"]) == 2
        assert capsys.readouterr().err == "harness: error: first second\n"

    @pytest.mark.parametrize("status", [0, 1, None])
    def test_a_command_returns_its_status(self, fake_command: Register, status: int | None) -> None:
        fake_command(lambda: status)
        assert main(["fake"]) == (status or 0)

    def test_an_interruption_is_one_line_and_130(
        self, fake_command: Register, capsys: pytest.CaptureFixture[str],
    ) -> None:
        fake_command(raising(KeyboardInterrupt()))
        assert main(["fake"]) == 130
        assert capsys.readouterr().err == "harness: interrupted\n"

    def test_a_bug_of_ours_keeps_its_traceback(self, fake_command: Register) -> None:
        fake_command(raising(ZeroDivisionError("ours")))
        with pytest.raises(ZeroDivisionError):
            main(["fake"])

    @pytest.mark.parametrize("size", [10, 10**6])
    def test_a_reader_that_goes_away_ends_it_quietly(self, size: int) -> None:
        """As in `harness … | head -1`; status 1 would say that a verdict went against the render.

        A short output meets the closed pipe at the last flush, a long one in the midst of the command.
        """
        program = f"""
import sys, types
from harness import cli
sys.modules["harness.cli.fake"] = types.SimpleNamespace(fake=lambda: print("x" * {size}))
cli.COMMANDS = {{"fake": "fake"}}
sys.argv = ["harness", "fake"]
cli.console_script()
"""
        read, write = os.pipe()
        os.close(read)
        buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
        done = subprocess.run([sys.executable, "-c", program], stdout=write, stderr=subprocess.PIPE, text=True,
                              env=buffered)
        os.close(write)
        assert (done.returncode, done.stderr) == (141, "")


class TestUsage:
    """A wrong command line is one line too, and says where the help is."""

    @pytest.mark.parametrize(("arguments", "complaint"), [
        (["nonsense"], "No such command 'nonsense'; see `harness --help`"),
        (["doctor", "--nonsense"], "No such option: --nonsense; see `harness doctor --help`"),
        (["doctor", "nonsense"], "Got unexpected extra argument(s) (nonsense); see `harness doctor --help`"),
    ])
    def test_is_one_line_and_status_2(
        self, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str,
    ) -> None:
        assert main(arguments) == 2
        assert capsys.readouterr().err == f"harness: error: {complaint}\n"

    @pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
    def test_help_lists_every_command(self, capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
        assert main(arguments) == 0
        listed = capsys.readouterr().out.split("Commands:\n")[1].splitlines()
        assert [line.split()[0] for line in listed] == list(COMMANDS)
        assert all(len(line.split()) > 2 for line in listed), "every command says in one line what it does"

    def test_a_command_waits_for_no_other(self, harness: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
        """Of twenty commands the one that is named is imported."""
        monkeypatch.setitem(COMMANDS, "other", "there_is_none")
        assert harness("doctor", "--help").status == 0
        with pytest.raises(ModuleNotFoundError, match="there_is_none"):
            harness("--help")

    @pytest.mark.parametrize("name", COMMANDS)
    def test_the_help_of_each_command_ends_with_an_example_that_parses(
        self, capsys: pytest.CaptureFixture[str], name: str,
    ) -> None:
        assert main([name, "--help"]) == 0
        text = " ".join(capsys.readouterr().out.split("Options:")[0].split())
        example = text.split("Example: `")[1].split("`")[0]
        words = example.split()
        assert words[:2] == ["harness", name]
        assert main([*words[1:], "--help"]) == 0, "an option of the example does not exist"

    @pytest.mark.parametrize("name", COMMANDS)
    def test_each_command_takes_json(self, capsys: pytest.CaptureFixture[str], name: str) -> None:
        main([name, "--help"])
        assert "--json" in capsys.readouterr().out

    def test_the_version_is_the_packages(self, capsys: pytest.CaptureFixture[str]) -> None:
        from importlib import metadata

        assert main(["--version"]) == 0
        assert capsys.readouterr().out == metadata.version("glsl-validation-harness") + "\n"

    def test_help_imports_no_heavy_package(self) -> None:
        """They would make it take seconds; a count of seconds would depend on the machine, this does not."""
        program = """
import sys
from harness.cli import main
main(["--help"])
heavy = {"numpy", "scipy", "skimage", "colour", "matplotlib", "mitsuba", "drjit", "moderngl", "OpenEXR", "typst"}
print(sorted(heavy & sys.modules.keys()))
"""
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == "[]"


class TestJson:
    """One strict JSON object, whatever the values are."""

    def test_values_of_the_harness_become_json_types(self) -> None:
        @dataclasses.dataclass(frozen=True)
        class Result:
            mean: np.ndarray
            count: np.int64
            path: Path

        result = Result(np.array([[1.0, np.nan]]), np.int64(3), Path("a/b"))
        assert to_json({"result": result, "verdicts": (True, None, np.bool_(False))}) == {
            "result": {"mean": [[1.0, None]], "count": 3, "path": "a/b"}, "verdicts": [True, None, False],
        }

    def test_no_number_is_written_that_json_lacks(self) -> None:
        """NaN and Infinity are accepted by few parsers."""
        text = json.dumps(to_json([float("nan"), float("inf"), np.float32("-inf"), 1.5]), allow_nan=False)
        assert text == "[null, null, null, 1.5]"


class TestProgress:
    """A bar on a terminal's stderr, and nowhere else."""

    PROGRAM = """
from harness.cli.output import log, print_json, progress
with progress(2, "outer task") as outer:
    outer(1)
    with progress(None, "inner task") as inner:
        inner(1)
        log("a line of log")
        print_json({"a": 1})
"""

    def test_is_silent_where_nobody_watches(self, capsys: pytest.CaptureFixture[str]) -> None:
        with progress(10, "task") as advance:
            advance(5)
        output = capsys.readouterr()
        assert output.out + output.err == ""

    def test_on_a_terminal_nested_bars_and_logs_leave_stdout_clean(self) -> None:
        terminal, terminal_end = pty.openpty()
        done = subprocess.run([sys.executable, "-c", self.PROGRAM], stdout=subprocess.PIPE, stderr=terminal_end,
                              env={**os.environ, "TERM": "xterm", "COLUMNS": "100"}, text=True, check=True)
        os.close(terminal_end)
        shown = b""
        while chunk := self._read(terminal):
            shown += chunk
        os.close(terminal)
        assert json.loads(done.stdout) == {"a": 1}
        for text in (b"outer task", b"inner task", b"a line of log"):
            assert text in shown
        assert shown.rstrip(b"\r").endswith(b"\x1b[2K\x1b[?25h"), "the cursor is shown again, and the bar is gone"

    @staticmethod
    def _read(terminal: int) -> bytes:
        try:
            return os.read(terminal, 65536)
        except OSError:  # Linux's way to say that the other end is closed
            return b""
