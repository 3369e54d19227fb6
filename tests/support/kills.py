"""Runs that are killed with SIGKILL in the middle, one after the other on one store, and one that is not.

`python -m tests.support.kills ROOT SEED KILLS` kills a run of a renderer of noise at random calls of functions, of
Python and of C, KILLS times, every other time at one that writes; then it lets a run end, and prints what `main` tells
as JSON. Each run is a fork of this small process, which takes a hundredth of the time that one of its own would.

`python -m tests.support.kills` kills `harness study` fifty times instead, at random moments by the clock: `by_clock`.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from harness.files import PARTIAL_PREFIX, data_dir
from harness.samples.keys import digest
from harness.samples.store import Store
from harness.work.batches import render_estimate
from tests.support.fakes import NoiseRenderer

# So many that the first are not kept.
SPP = 384
# The functions by which files come, are filled and go.
WRITING = frozenset(("open", "mkdir", "write", "close", "replace", "utime", "unlink"))


def draw(root: Path) -> str:
    """A digest of all that a run of two replicas gives; half of it is left in the store by `hold`, as by a worker."""
    renderer, store, found = NoiseRenderer(), Store(root), []
    for start, count in ((0, 1), (1, 1), (2, 2), (4, 4), (32, 32), (128, 128)):
        store.hold(renderer.identity, 1, start, count, lambda: renderer.render_batch(1, start, count),  # noqa: B023
                   keep=start >= 32, scene="noise")
    for replica in range(2):
        estimate = render_estimate(renderer, SPP, replica=replica, store=store)
        found.append([estimate.mean, estimate.variance])
    return digest(found)


def forked(work: Callable[[], Any]) -> tuple[int, str]:
    """The status of a process that does the work, as `os.waitpid` tells it, and what it returned, as text."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.write(writing, str(work()).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        text = pipe.read()
    return os.waitpid(child, 0)[1], text


def counted(event: str, called: object, writing: bool) -> bool:
    """Every call and return of a function, or those alone by which files come and go."""
    return not writing or (event.startswith("c_") and getattr(called, "__name__", "") in WRITING)


def counting(root: Path, writing: bool) -> int:
    """How many calls and returns a run has."""
    calls = 0

    def count(frame: object, event: str, called: object) -> None:
        nonlocal calls
        calls += counted(event, called, writing)

    sys.setprofile(count)
    draw(root)
    sys.setprofile(None)
    return calls


def killed(root: Path, moment: int, writing: bool) -> None:
    """A run that ends at its call or return number `moment`."""
    left = moment

    def count(frame: object, event: str, called: object) -> None:
        nonlocal left
        left -= counted(event, called, writing)
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(count)
    draw(root)


def main(root: Path, seed: int, kills: int) -> dict[str, Any]:
    """Signals that ended the runs, files half-written and whole after each, and the digests of an undisturbed run and
    of the one after the kills."""
    undisturbed = draw(root / "undisturbed")  # in this process, which has then imported all that the others need
    moments = random.Random(seed)
    found: dict[str, Any] = {"signals": [], "torn": [], "whole": []}
    for number in range(kills):
        if (root / "killed").exists():
            shutil.copytree(root / "killed", root / f"counted-{number}")
        writing = number % 2 == 0
        calls = int(forked(partial(counting, root / f"counted-{number}", writing))[1])
        status, _ = forked(partial(killed, root / "killed", moments.randrange(1, calls), writing))
        names = [path.name for path in (root / "killed").glob("*/*/*.exr")]
        torn = sum(name.startswith(PARTIAL_PREFIX) for name in names)
        found["signals"].append(os.WTERMSIG(status))
        found["torn"].append(torn)
        found["whole"].append(len(names) - torn)
    return {**found, "undisturbed": undisturbed, "resumed": forked(lambda: draw(root / "killed"))[1]}


def by_clock(kills: int = 50, seed: int = 0) -> None:
    """Kill `harness study`, and all its processes, at random moments between its first batch and its end; then resume,
    and compare every number with an undisturbed study's.

    Every other one draws in two processes. Prints a table: seconds since the first batch, how many batches were whole
    and half-written then, and whether the numbers are the same.
    """
    folder = Path("reports/out/kills").absolute()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    scene = data_dir("mitsuba_scenes") / "spheres.xml"
    reference = folder / "reference.exr"
    _harness(folder / "cache", "reference", scene, "--size", "96x72", "--spp", "256", "-o", reference).wait()
    study = ("study", scene, "--size", "96x72", "-s", "mixture,uniform,mis", "--spp", "1024", "--replicas", "3",
             "--reference", reference, "--tolerance", "0.5", "--json")
    ways: tuple[tuple[str, ...], ...] = ((), ("--executor", "processes", "--jobs", "2"))
    whole, undisturbed = [], []
    for number, way in enumerate(ways):
        running = _harness(folder / f"whole-{number}", *study, *way)
        began = _first_batch(folder / f"whole-{number}", running)
        undisturbed.append(_numbers(running))
        whole.append(time.monotonic() - began)
        print(f"undisturbed, {way[1] if way else 'serial'}: {whole[-1]:.1f} s from the first batch to the end")
    moments, same = random.Random(seed), 0
    for number in range(kills):
        cache, way = folder / f"killed-{number}", number % 2
        moment = moments.uniform(0, whole[way])
        running = _harness(cache, *study, *ways[way])
        _first_batch(cache, running)
        try:
            running.wait(moment)
            how = "had ended"
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)
            running.wait()
            how = "killed"
        names = [path.name for path in cache.rglob("*.exr")]
        torn = sum(name.startswith(PARTIAL_PREFIX) for name in names)
        equal = _numbers(_harness(cache, *study)) == undisturbed[0] == undisturbed[1]
        same += equal
        print(f"{number + 1:3} {'processes' if way else 'serial':9} {moment:6.2f} s {how:9} {len(names) - torn:3} "
              f"whole {torn} half-written  {'the same numbers' if equal else 'OTHER NUMBERS'}", flush=True)
        shutil.rmtree(cache, ignore_errors=True)
    print(f"{same} of {kills} gave the same numbers")


def _first_batch(cache: Path, running: subprocess.Popen[str]) -> float:
    """When it is there, by the monotonic clock."""
    while running.poll() is None and next(cache.rglob("*.exr"), None) is None:
        time.sleep(0.005)
    return time.monotonic()


def _harness(cache: Path, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "harness", *map(str, arguments)], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True, start_new_session=True,
                            env={**os.environ, "HARNESS_CACHE": str(cache)})


def _numbers(study: subprocess.Popen[str]) -> object:
    """All that a study says, but for seconds."""
    told = json.loads(study.communicate()[0])
    return [{name: value for name, value in item.items() if "seconds" not in name and name != "efficiency"}
            for item in told["strategies"]]


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))))
    else:
        by_clock()
