"""What only a process of its own shows: Ctrl-C at any moment, and streams that are closed, full or plain ASCII."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from harness import cli
from harness.cli import main
from harness.files import PARTIAL_PREFIX, data_dir
from harness.gpu.renderer import TracerRenderer
from harness.samples.estimate import Estimate
from harness.samples.exr import write_estimate
from harness.samples.store import LEAD_IN, schedule
from tests.cli.conftest import Harness
from tests.support.processes import hearing, this_process_hearing

SPHERES = data_dir("mitsuba_scenes") / "spheres.xml"
SMALL = ("--size", "64x48")
FOREVER = ("--spp", "1000000")  # minutes at the least
PATIENCE = 120  # seconds after which a command that hangs is given up

# A command that needs no heavy import, run as the console script would.
FAKE = """
import sys, types
from harness import cli
sys.modules["harness.cli.fake"] = types.SimpleNamespace(fake=lambda: print("\\u00b1" * 3))
cli.COMMANDS = {"fake": "fake"}
sys.argv = ["harness", "fake"]
cli.console_script()
"""

# A renderer that takes minutes, and so does a program that it starts; deaf to SIGTERM if asked.
SLOW = """
import os, signal, subprocess, sys, time
if sys.argv[2] == "1":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen(["sleep", "600"])
with open(sys.argv[1] + ".part", "w") as file:
    print(os.getpid(), child.pid, file=file)
os.rename(sys.argv[1] + ".part", sys.argv[1])
time.sleep(600)
"""


def running(pid: int) -> bool:
    """Is it there, and more than an entry that nobody has collected?"""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def interrupt(arguments: Sequence[object], cache: Path, until: str) -> subprocess.CompletedProcess[str]:
    """Send Ctrl-C to `harness ARGUMENTS` once a batch called `until` is in the cache."""
    command = hearing([sys.executable, "-m", "harness", *arguments])
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            deadline = time.monotonic() + PATIENCE
            while not list(cache.rglob(until)):
                assert process.poll() is None, f"ended by itself: {process.communicate()}"
                assert time.monotonic() < deadline, f"no batch {until}"
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def stored(cache: Path) -> list[tuple[int, int, int]]:
    """(replica, start, count) of each batch in the cache."""
    names = [path.stem.split("-") for path in cache.rglob("batches/*/*/*.exr") if path.name[0] != "."]
    return sorted((int(replica), int(start), int(count)) for replica, start, count in names)


class TestInterruption:
    """One line, status 130, nothing half-written, and the next run continues."""

    @pytest.mark.parametrize(("arguments", "until"), [
        pytest.param(("render", SPHERES, *SMALL, *FOREVER, "-o", "x.exr"), "0-64-64.exr", id="render"),
        pytest.param(("reference", SPHERES, "--size", "256x192", *FOREVER, "-o", "x.exr"), "0-32-32.exr",
                     id="inside Mitsuba"),
        pytest.param(("report", SPHERES, "--profile", "full", "-o", "."), "0-0-64.exr", id="report"),
    ])
    def test_leaves_nothing_but_whole_batches(
        self, here: Path, tmp_path: Path, arguments: Sequence[object], until: str,
    ) -> None:
        small = tmp_path / "spheres.xml"  # a report draws as large as the file says
        small.write_text(SPHERES.read_text("utf-8").replace('"256"', '"64"').replace('"192"', '"48"'), "utf-8")
        done = interrupt([small if word == SPHERES and "report" in arguments else word for word in arguments],
                         tmp_path / "cache", until)
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "harness: interrupted\n")
        assert list(here.iterdir()) == []
        assert not list((tmp_path / "cache").rglob(f"{PARTIAL_PREFIX}*"))
        batches = stored(tmp_path / "cache")
        if "report" in arguments:  # begins with the reference, whose batches are of one size
            assert batches == [(replica, 0, 64) for replica in range(len(batches))]
        else:
            kept = 0 if "reference" in arguments else LEAD_IN  # Mitsuba's would not be the same again
            assert batches == [(0, start, count) for start, count in schedule(batches[-1][1] + batches[-1][2])
                               if start >= kept]

    def test_of_a_study_is_continued_where_it_was(
        self, harness: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        write_estimate("truth.exr", Estimate.exact(np.full((48, 64, 3), 0.4)))
        study = ("study", SPHERES, *SMALL, "--spp", "32", "--replicas", "1000", "-s", "cosine",
                 "--reference", "truth.exr")
        # So short a run keeps all its batches.
        done = interrupt((*study, "-o", "kept"), tmp_path / "cache", "2-0-1.exr")
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "harness: interrupted\n")
        assert list(Path("kept").iterdir()) == []

        asked: list[tuple[int, int, int]] = []

        def interrupted(renderer: TracerRenderer, *batch: int) -> None:
            asked.append(batch)  # type: ignore[arg-type]
            raise KeyboardInterrupt

        monkeypatch.setattr(TracerRenderer, "render_batch", interrupted)
        batches = stored(tmp_path / "cache")
        again = harness(*study)
        assert (again.status, again.out, again.err) == (130, "", "harness: interrupted\n")
        replica, start, count = batches[-1]
        expected = (replica, start + count) if start + count < 32 else (replica + 1, 0)
        assert [batch[:2] for batch in asked] == [expected]

    @pytest.mark.parametrize("deaf", [False, True], ids=["listens", "deaf"])
    def test_ends_a_command_and_its_children(self, here: Path, sky: Path, deaf: bool) -> None:
        """They are in a session of their own, where no terminal reaches them."""
        Path("slow.py").write_text(SLOW)
        template = f"{sys.executable} {here / 'slow.py'} {here / 'pids'} {int(deaf)} {{seed}} {{out}}"
        command = hearing([sys.executable, "-m", "harness", "compare", "--command", template, "--scene", sky])
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            try:
                deadline = time.monotonic() + PATIENCE
                while not Path("pids").exists():
                    assert process.poll() is None, f"ended by itself: {process.communicate()}"
                    assert time.monotonic() < deadline, "the command was not started"
                    time.sleep(0.02)
                pids = [int(pid) for pid in Path("pids").read_text().split()]
                assert all(map(running, pids))
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=PATIENCE)
            finally:
                process.kill()
        assert (process.returncode, out, err) == (130, "", "harness: interrupted\n")
        while any(map(running, pids)):  # killed, and not yet gone
            assert time.monotonic() < deadline, "still running"
            time.sleep(0.02)

    @pytest.mark.parametrize("package", ["typer", "numpy"])
    def test_while_packages_are_imported_is_one_line_too(self, sky: Path, package: str) -> None:
        program = f"""
import signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "{package}":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from harness.cli import console_script
sys.argv = ["harness", "render", {str(sky)!r}]
console_script()
"""
        done = subprocess.run(hearing([sys.executable, "-c", program]), capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "harness: interrupted\n")

    def test_that_a_package_turns_into_another_error_is_still_one(
        self, harness: Harness, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """As when Ctrl-C meets the import of an extension module, which then looks broken."""
        def fake() -> None:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise NameError("name '_extension' is not defined") from None

        module = ModuleType("harness.cli.fake")
        module.fake = fake  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "harness.cli.fake", module)
        monkeypatch.setattr(cli, "COMMANDS", {"fake": "fake"})
        with this_process_hearing():
            done = harness("fake")
        assert (done.status, done.err) == (130, "harness: interrupted\n")

    @pytest.mark.parametrize("ignored", ["", "trap '' INT; "])
    def test_reaches_a_process_of_these_tests_also_in_the_background(self, ignored: str) -> None:
        """Else each test above would wait for a process that is deaf."""
        program = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
        done = subprocess.run(["/bin/sh", "-c", f'{ignored}exec "$@"', "sh",
                               *hearing([sys.executable, "-c", program])], capture_output=True, text=True)
        assert done.stdout == "True\n"

    def test_is_left_to_a_host_program_afterwards(self) -> None:
        before = signal.getsignal(signal.SIGINT)
        assert main(["--version"]) == 0
        assert signal.getsignal(signal.SIGINT) is before


class TestStreams:
    """Whatever stdout and stderr are, no traceback."""

    def test_a_full_disk_behind_stdout_is_one_line(self) -> None:
        with open("/dev/full", "w") as full:
            done = subprocess.run([sys.executable, "-c", FAKE], stdout=full, stderr=subprocess.PIPE, text=True)
        assert done.returncode == 2
        assert done.stderr == ("harness: error: the output cannot be written (No space left on device); "
                               "send it elsewhere, or free some space\n")

    @pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&-"])
    def test_closed_streams_are_nobodys_business(self, closed: str) -> None:
        done = subprocess.run(["/bin/sh", "-c", f'"$0" -c "$1" {closed}', sys.executable, FAKE], capture_output=True)
        assert done.returncode == 0
        assert done.stderr == b""

    @pytest.mark.parametrize("environment", [
        {"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}])
    def test_characters_that_a_locale_lacks_are_escaped(self, environment: dict[str, str]) -> None:
        done = subprocess.run([sys.executable, "-c", FAKE], capture_output=True, env={**os.environ, **environment})
        assert (done.returncode, done.stdout, done.stderr) == (0, b"\\xb1\\xb1\\xb1\n", b"")

    def test_json_is_ascii_in_every_locale(self, harness: Harness, sky: Path) -> None:
        scene = sky.with_name("größer.xml")
        sky.rename(scene)
        done = harness("render", scene, "--spp", 2, "--json")
        assert done.out.isascii()
        assert done.json["scene"] == "größer"
