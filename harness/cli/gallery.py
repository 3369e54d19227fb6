"""`harness gallery`: the handout's two pictures at full size, resumable, on any executor, and what they will cost."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import (
    CORES,
    MAX_SPP,
    ClusterOption,
    ExecutorOption,
    JobsOption,
    SizeOption,
    not_finite,
    open_executor,
    open_scene,
    open_store,
)
from harness.cli.output import JsonOption, log, print_json, progress

# Samples per pixel whose time says something of the rest's: the first few are slowed down by what is compiled for them.
TELLING = 32

if TYPE_CHECKING:
    from harness.course.gallery import Picture
    from harness.samples.store import Store
    from harness.scene import Scene


def gallery(
    scenes: Annotated[list[Path] | None, typer.Argument(help="Scene files; the handout's two if none are given.",
                                                        show_default=False)] = None,
    spp: Annotated[int | None, typer.Option("--spp", min=1, max=MAX_SPP, help="Samples per pixel; the handout's (2,000 "
                                            "and 20,000) if not given, 2,000 for other scenes.")] = None,
    size: SizeOption = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for NAME.png and NAME.exr.")]
    = Path("reports/out/gallery"),
    keep: Annotated[Path | None, typer.Option("--keep", help="Also write each into this folder as a JPEG, with what it "
                                              "took in pictures.json: for a report or a page.")] = None,
    executor: ExecutorOption = "serial",
    cluster: ClusterOption = None,
    jobs: JobsOption = CORES,
    estimate: Annotated[bool, typer.Option("--estimate", help=(
        "Only say what it would cost, from the first samples, and by how much that was off on those after them."))]
    = False,
    json: JsonOption = False,
) -> None:
    """Render the course handout's two pictures at 1024 x 1024.

    The pictures can be looked at from the first samples on. An interrupted render goes on where it was, but for the
    batch of at most 128 samples that was being drawn; so does one on a cluster.

    Example: `harness gallery --spp 500`
    """
    from harness.course.gallery import FIGURES, SIDE, render_picture
    from harness.course.kept import RECORDS_FILE
    from harness.course.kept import keep as keep_picture
    from harness.files import data_dir, require_writable

    counts = {figure.scene: figure.spp for figure in FIGURES}
    paths = scenes or [data_dir("mitsuba_scenes") / f"{figure.scene}.xml" for figure in FIGURES]
    loaded = [open_scene(path, size or f"{SIDE}x{SIDE}") for path in paths]  # a bad one shows before the first render
    wanted = [spp or counts.get(scene.name, FIGURES[0].spp) for scene in loaded]
    if keep:
        require_writable(keep / RECORDS_FILE)
    store = open_store(cache=True)
    assert store is not None
    if estimate:
        _estimate(list(zip(loaded, wanted, strict=True)), store, jobs, json=json)
        return
    pictures = []
    with open_executor(executor, jobs, cluster) as workers:
        for scene, samples in zip(loaded, wanted, strict=True):
            picture = render_picture(scene, samples, output, store=store, progress=progress,
                                     executor=None if executor == "serial" else workers, saved=_Teller(scene, samples))
            if picture.rejected:
                log(f"warning: {picture.png}: {not_finite(picture.rejected)}")
            if not json:
                print(f"{picture.png}: {scene.width} x {scene.height}, {picture.samples} spp, "
                      f"{picture.samples - picture.resumed} of them new; {_cost(picture)}")
            if keep:
                keep_picture(picture, scene, keep)
            pictures.append(picture)
    if json:
        print_json({"pictures": pictures})


def _cost(picture: Picture) -> str:
    if not picture.device:
        return "drawn on several devices, whose seconds have no sum"
    return f"{_duration(picture.seconds)} of {picture.device}"


def _estimate(asked: list[tuple[Scene, int]], store: Store, jobs: int, *, json: bool) -> None:
    """Draw a pilot of each, which the render will not draw again, and say what follows from it."""
    from harness.course.gallery import STRATEGY
    from harness.estimators.tracer import Tracer
    from harness.samples.store import schedule
    from harness.scene import file_of
    from harness.work.forecast import forecast

    told = []
    started = time.process_time()  # what this process has spent so far, a worker will
    for scene, spp in asked:
        before = time.process_time()
        with Tracer(STRATEGY).open(file_of(scene)) as renderer, progress(None, f"{scene.name} pilot") as advance:
            found = forecast(renderer, store, started + time.process_time() - before, advance)
        counts = [count for _, count in schedule(spp)]
        workers = min(jobs, len(counts))
        whole, longest = found.seconds(counts, workers), found.longest(counts, workers)
        told.append({"scene": scene.name, "size": [scene.width, scene.height], "spp": spp, "workers": workers,
                     "seconds": whole, "longest": longest, "error": found.error, "model": asdict(found)})
        if not json:
            print(f"{scene.name}: {scene.width} x {scene.height}, {spp} spp: {_duration(whole)} of {found.device}; "
                  f"{workers} such workers take {_duration(longest)}")
            print(f"  seconds ({found.clock}) = {found.setup:.3g} a worker + {found.per_batch:.3g} a batch + "
                  f"{found.per_sample:.4g} a sample, fitted to {found.pilot} samples; the first half of them said "
                  f"{found.foretold:.4g} s of the second, which took {found.took:.4g}: {found.error:+.1%}")
    if json:
        print_json({"estimates": told})


class _Teller:
    """Says after each saved state how far the render is and how long it will take."""

    def __init__(self, scene: Scene, wanted: int) -> None:
        self._scene, self._wanted = scene, wanted
        self._began = time.monotonic()

    def __call__(self, picture: Picture) -> None:
        done = picture.samples - picture.resumed
        left = (time.monotonic() - self._began) / max(done, 1) * (self._wanted - picture.samples)
        told = f", about {_duration(left)} left" if done >= TELLING else ""
        log(f"{self._scene.name}: {picture.samples} of {self._wanted} spp{told}; look at {picture.png}")


def _duration(seconds: float) -> str:
    """Two units of time at most, such as '1 h 20 min'."""
    if seconds < 90:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
