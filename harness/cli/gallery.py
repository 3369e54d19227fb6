"""`harness gallery`: the handout's two pictures at full size, resumable."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import MAX_SPP, SizeOption, not_finite, open_scene
from harness.cli.output import JsonOption, log, print_json, progress

if TYPE_CHECKING:
    from harness.course.gallery import Picture
    from harness.scene import Scene


def gallery(
    scenes: Annotated[list[Path] | None, typer.Argument(help="Scene files; the handout's two if none are given.",
                                                        show_default=False)] = None,
    spp: Annotated[int | None, typer.Option("--spp", min=1, max=MAX_SPP, help="Samples per pixel; the handout's (2,000 "
                                            "and 20,000) if not given, 2,000 for other scenes.")] = None,
    size: SizeOption = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for NAME.png and NAME.exr.")]
    = Path("reports/out/gallery"),
    json: JsonOption = False,
) -> None:
    """Render the course handout's two pictures at 1024 x 1024.

    The pictures can be looked at from the first seconds on. An interrupted render goes on where it was.

    Example: `harness gallery --spp 500`
    """
    from harness.course.gallery import FIGURES, SIDE, render_picture
    from harness.files import data_dir

    counts = {figure.scene: figure.spp for figure in FIGURES}
    paths = scenes or [data_dir("mitsuba_scenes") / f"{figure.scene}.xml" for figure in FIGURES]
    loaded = [open_scene(path, size or f"{SIDE}x{SIDE}") for path in paths]  # a bad one shows before the first render
    pictures = []
    for scene in loaded:
        wanted = spp or counts.get(scene.name, FIGURES[0].spp)
        picture = render_picture(scene, wanted, output, progress=progress, saved=_Teller(scene, wanted))
        if picture.rejected:
            log(f"warning: {picture.png}: {not_finite(picture.rejected)}")
        if not json:
            print(f"{picture.png}: {scene.width} x {scene.height}, {picture.samples} spp, "
                  f"{picture.samples - picture.resumed} of them new")
        pictures.append(picture)
    if json:
        print_json({"pictures": pictures})


class _Teller:
    """Says after each saved state how far the render is and how long it will take."""

    def __init__(self, scene: Scene, wanted: int) -> None:
        self._scene, self._wanted = scene, wanted
        self._began = time.monotonic()

    def __call__(self, picture: Picture) -> None:
        done = picture.samples - picture.resumed
        left = (time.monotonic() - self._began) / done * (self._wanted - picture.samples)
        log(f"{self._scene.name}: {picture.samples} of {self._wanted} spp, about {_duration(left)} left; "
            f"look at {picture.png}")


def _duration(seconds: float) -> str:
    """Two units of time at most, such as '1 h 20 min'."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
