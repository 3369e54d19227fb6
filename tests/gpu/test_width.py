"""llvmpipe's vectors of 512 bits: taken where a trial proves them, and by no other process than ours."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.gpu import width
from harness.gpu.device import ENTRY, USUAL, WIDE, WIDTH
from harness.gpu.width import NEEDED, SHADER_CACHE, Verdict

NARROW: dict[str, Any] = {"name": f"llvmpipe (LLVM 19.1.7, {USUAL} bits)", "pixels": ["a", "b"], "seconds": 1.5}
BETTER = {**NARROW, "name": f"llvmpipe (LLVM 19.1.7, {WIDE} bits)", "seconds": 1.0}
# A process that asks, where the trial is taken for won: what it draws with, and what it leaves behind.
_WIDE_PROCESS = """
import json, os
from harness.errors import MachineError
from harness.gpu import width
from harness.gpu.device import WIDTH
width.verdict = lambda: width.Verdict(True, "a test")
width.TRIAL_SCENES, width.TRIAL_SIZE, width.TRIAL_SAMPLES = ("displaced",), (16, 12), 2
width.ask()
found = width.trial()
from harness.gpu.context import Program, describe_gl
from harness.shader.library import OURS
try:
    Program(OURS.assembled("display.frag"))
except MachineError as error:
    found["refusal"] = str(error)
left = [name for name in (WIDTH, width.SHADER_CACHE) if name in os.environ]
print(json.dumps([found, describe_gl()["gl_renderer"], left]))
"""


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[dict[str, Any]]:
    """A machine with AVX-512 and an empty cache, whose trials end as the dictionary says; it counts them."""
    told: dict[str, Any] = {USUAL: NARROW, WIDE: BETTER, "trials": 0, "driver": "one"}

    def tried(bits: str) -> Any:
        told["trials"] += 1
        return told[bits]

    monkeypatch.setattr(width, "cpu_features", lambda: NEEDED | {"avx2"})
    monkeypatch.setattr(width, "_tried", tried)
    monkeypatch.setattr(width, "_driver", lambda: [[told["driver"], 1, 2]] if told["driver"] else [])
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    for name in (WIDTH, ENTRY, SHADER_CACHE):
        monkeypatch.delenv(name, raising=False)
    yield told


def test_a_trial_that_is_won_is_remembered_for_its_driver(machine: dict[str, Any]) -> None:
    first = width.verdict()
    assert first == Verdict(True, "1.50 times as fast at 512 bits, same pixels") and machine["trials"] == 2
    assert width.verdict() == first and machine["trials"] == 2
    machine["driver"] = "another"
    machine[WIDE] = "crashed with SIGSEGV"
    assert width.verdict() == Verdict(False, "at 512 bits: crashed with SIGSEGV") and machine["trials"] == 4
    machine["driver"] = "one"
    assert width.verdict() == first and machine["trials"] == 4


@pytest.mark.parametrize(("bits", "ends", "reason"), [
    (WIDE, "crashed with SIGSEGV", "at 512 bits: crashed with SIGSEGV"),
    (USUAL, "no answer", "at 256 bits: no answer"),
    (WIDE, {**BETTER, "pixels": ["a", "c"]}, "other pixels at 512 bits"),
    (WIDE, {**BETTER, "seconds": 1.4}, "1.07 times as fast at 512 bits, at least 1.1 is asked for"),
    (WIDE, {**NARROW, "seconds": 0.1}, f"the driver does not heed {WIDTH}: {NARROW['name']}"),
])
def test_a_trial_that_is_lost_changes_nothing(machine: dict[str, Any], bits: str, ends: Any, reason: str) -> None:
    machine[bits] = ends
    assert width.verdict() == Verdict(False, reason)


def test_where_no_trial_is_needed(machine: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as set_by_user:
        set_by_user.setenv(WIDTH, "128")
        assert width.verdict() == Verdict(False, f"{WIDTH} is set, and left alone")
    with monkeypatch.context() as set_by_user:
        set_by_user.setenv(ENTRY, "fragment")
        assert not width.verdict().wide
    machine["driver"] = ""
    assert not width.verdict().wide
    monkeypatch.setattr(width, "cpu_features", lambda: NEEDED - {"avx512vl"})
    assert width.verdict() == Verdict(False, "the processor has no avx512vl")
    assert not machine["trials"]


@pytest.mark.parametrize("damage", ["", "[1]", '{"a": 3}', "\xff"])
def test_a_damaged_memory_is_as_good_as_none(machine: dict[str, Any], damage: str) -> None:
    width.verdict()
    width._memory().write_text(damage, encoding="latin-1")
    assert width.verdict().wide and machine["trials"] == 4


@pytest.mark.parametrize(("program", "ends"), [
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed with SIGSEGV"),
    ("raise SystemExit('no EGL')", "no EGL"), ("print('{')", "no answer"),
    (f"import os, json; print(json.dumps([os.environ.get(name) for name in ('{WIDTH}', '{ENTRY}')]))",
     [WIDE, "compute"]),
])
def test_how_a_trial_ends(program: str, ends: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(width, "_TRIAL", program)
    assert width._tried(WIDE) == ends


def test_settings_are_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the user had comes back; a process that did not ask has nothing set."""
    monkeypatch.delenv(WIDTH, raising=False)
    monkeypatch.setenv(SHADER_CACHE, "mine")
    for decided, inside in ((Verdict(True, ""), WIDE), (Verdict(False, ""), None)):
        monkeypatch.setattr(width._Process, "decided", decided)
        with width.environment():
            assert os.environ.get(WIDTH) == inside and (os.environ[SHADER_CACHE] == "mine") == (inside is None)
        assert WIDTH not in os.environ and os.environ[SHADER_CACHE] == "mine"


def test_who_asks_is_judged_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(width, "verdict", lambda: asked.append(1) or Verdict(False, "no"))
    for asks, count in ((False, 0), (True, 1)):
        monkeypatch.setattr(width._Process, "asked", asks)
        monkeypatch.setattr(width._Process, "decided", None)
        for _ in range(2):
            with width.environment():
                pass
        assert len(asked) == count


def test_a_wide_process_draws_the_same_pixels(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """On any processor: without AVX-512 the compiler divides the vectors."""
    monkeypatch.setattr(width, "TRIAL_SCENES", ("displaced",))
    monkeypatch.setattr(width, "TRIAL_SIZE", (16, 12))
    monkeypatch.setattr(width, "TRIAL_SAMPLES", 2)
    here = width.trial()
    done = subprocess.run([sys.executable, "-c", _WIDE_PROCESS], capture_output=True, text=True,
                          env={**os.environ, "HARNESS_CACHE": str(tmp_path)})
    assert done.returncode == 0, done.stderr
    found, told, left = json.loads(done.stdout)
    assert f"{WIDE} bits" in found["name"] and found["pixels"] == here["pixels"]
    assert "display.frag: a fragment shader" in found["refusal"]
    assert told == here["name"] and left == []
    assert any((tmp_path / f"llvmpipe-{WIDE}").iterdir())
