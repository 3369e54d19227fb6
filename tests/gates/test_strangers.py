"""Gates on renders of anybody: images that are there, and programs that are run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.gates import load_gates, run_gate
from harness.samples.estimate import merge
from harness.samples.exr import write_estimate
from tests.support.fakes import NoiseRenderer
from tests.support.gates import GATES, write

# A renderer of noise about one half, or about what it is told, that writes a PFM. It starts in no time, since it is run
# hundreds of times: no package is imported, nor looked for (`-I -S`).
PROGRAM = """
import array, random, sys
out, seed, width, height, level = sys.argv[1], *map(int, sys.argv[2:5]), float(sys.argv[5])
numbers = random.Random(seed)
image = array.array("f", [level + numbers.gauss(0, 0.01) for _ in range(width * height * 3)])
with open(out, "wb") as file:
    file.write(b"PF\\n%d %d\\n-1.0\\n" % (width, height) + image.tobytes())
"""
STRATEGY = 'strategy = "cosine"'


def images(folder: Path, level: float, count: int = 8) -> None:
    for replica in range(count):
        run = merge([NoiseRenderer(level, 0.003, (40, 40)).render_batch(replica, 0, 1)])
        write_estimate(folder / f"mine_{replica}.exr", run)


def gates(folder: Path, judged: str, extra: str = "") -> Path:
    """A gates file about something else than a strategy of ours."""
    return write(folder, GATES.replace(STRATEGY, judged) + extra)


def command(folder: Path, level: float, program: str = PROGRAM) -> str:
    """The line of a gates file that runs a program."""
    (folder / "render.py").write_text(program)
    line = f"{sys.executable} -I -S {folder / 'render.py'} {{out}} {{seed}} {{width}} {{height}} {level}"
    return f"command = \'{line}\'"


@pytest.mark.parametrize(("level", "outcome"), [(0.5, "pass"), (0.51, "fail")])
def test_images_that_are_there_are_judged_at_once(tmp_path: Path, level: float, outcome: str) -> None:
    images(tmp_path, level)
    gate, = load_gates(gates(tmp_path, 'images = "mine_*.exr"')).gates
    assert (gate.name, gate.replicas, gate.looks) == ("sky", 8, (8,))
    result = run_gate(gate)
    assert (result.outcome, len(result.looks), result.test.batches) == (outcome, 1, 8)


@pytest.mark.parametrize(("level", "outcome"), [(0.5, "pass"), (0.51, "fail")])
def test_a_program_is_run_once_a_replica(tmp_path: Path, level: float, outcome: str) -> None:
    gate, = load_gates(gates(tmp_path, command(tmp_path, level))).gates
    result = run_gate(gate)
    assert (result.outcome, result.test.batches) == (outcome, 16)


def test_a_program_that_takes_a_depth_is_asked_for_each(tmp_path: Path) -> None:
    """Beyond one vertex it is 4 % too bright; the scene's own bound, 2, and the depths of the ladder reach it."""
    line = command(tmp_path, 0.0, PROGRAM.replace("float(sys.argv[5])", "0.52 if int(sys.argv[5]) > 1 else 0.5"))
    result = run_gate(load_gates(gates(tmp_path, line.replace("0.0'", "{max_depth}'"))).gates[0])
    assert result.outcome == "fail"
    assert "; right up to depth 1, wrong from 2 on (light scattered once): +4 %" in result.reason
    deaf = run_gate(load_gates(gates(tmp_path, command(tmp_path, 0.52))).gates[0])
    assert deaf.reason.endswith("no ladder of depths: max_depth does not reach it; pass {max_depth} on to the program")


def test_of_images_there_is_no_ladder(tmp_path: Path) -> None:
    images(tmp_path, 0.52)
    found = run_gate(load_gates(gates(tmp_path, 'images = "mine_*.exr"')).gates[0]).reason
    assert found.endswith("no ladder of depths: mine_0.exr and 7 more is what it is at every max_depth")


def test_of_a_strategy_in_the_defaults_nothing_is_left(tmp_path: Path) -> None:
    """An entry that names a program is not about our tracer."""
    images(tmp_path, 0.5, 2)
    text = GATES.replace(STRATEGY, 'images = "mine_*.exr"').replace("[defaults]\n", f"[defaults]\n{STRATEGY}\n")
    gate, = load_gates(write(tmp_path, text)).gates
    assert gate.strategy == "mine_0.exr and 1 more"


@pytest.mark.parametrize(("judged", "told"), [
    ('images = "none_*.exr"', r"none_\*\.exr: no file matches this pattern"),
    ('images = "mine_0.exr"', r"'mine_0\.exr' names 1 file\(s\), expected 2 to 256 independent runs"),
    ('images = "mine_*.exr"\nstrategy = "cosine"', r"expected one of strategy, command, images, found strategy and im"),
    ('images = "mine_*.exr"\nshader = "own.frag"', r"'shader' is part of our tracer, and 'images' stands in its place"),
    ('command = "myrt {seed}"', r"command `myrt \{seed\}`: lacks \{out\}; pass it on"),
    ('command = "myrt {seed} {out} {size}"', r"unknown '\{size\}'; allowed: \{scene\}, \{spp\}"),
    ('command = "myrt {seed} {out}"\ntimeout = 0', r"'timeout' must be a number above 0"),
    ('command = "myrt {seed} {out}"\nmax_depth = 2', r"`myrt \{seed\} \{out\}`: max_depth does not reach it; pass "
                                                     r"\{max_depth\} on to the program"),
    ("", "expected one of strategy, command, images, found none of them"),
])
def test_what_nothing_can_be_judged_by_is_refused_with_its_line(tmp_path: Path, judged: str, told: str) -> None:
    images(tmp_path, 0.5, 2)
    (tmp_path / "own.frag").write_text("// mine")
    with pytest.raises(HarnessError, match=rf"gates\.toml:\d+: .*{told}"):
        load_gates(gates(tmp_path, judged))


@pytest.mark.parametrize(("program", "told"), [
    ("import sys; sys.exit('out of luck')", r"failed with exit status 1: out of luck; try `"),
    ("pass", r"wrote no file to \{out\}"),
    (PROGRAM.replace("seed, width, height, level =", "seed, height, width, level ="), ""),
    (PROGRAM.replace("width * height * 3", "width * 9 * 3").replace("(width, height)", "(width, 9)"),
     r"wrote an image of 40 x 9 pixels, the scene has 40 x 40"),
    (PROGRAM.replace("Random(seed)", "Random(1)"), r"gave the same image for seeds 1 and 2"),
    (PROGRAM.replace("Random(seed)", "Random(min(seed, 5))"), r"gave the same image for seeds 5 and 6"),
    ("import time; time.sleep(60)", r"took longer than 0\.5 s and was ended"),
])
def test_a_program_that_does_not_render_is_one_line(tmp_path: Path, program: str, told: str) -> None:
    limit = "\ntimeout = 0.5" if "sleep" in program else ""
    gate, = load_gates(gates(tmp_path, command(tmp_path, 0.5, program) + limit)).gates
    if not told:
        assert run_gate(gate).outcome == "pass"  # a square image does not mind
        return
    with pytest.raises(HarnessError, match=rf"command `python[\d.]*` {told}") as caught:
        run_gate(gate)
    assert "\n" not in str(caught.value)
