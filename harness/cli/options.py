"""Options that several commands share, and what they turn into."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.output import log
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.scene import Scene
    from harness.store import Store

SceneArgument = Annotated[Path, typer.Argument(help="A Mitsuba 3 scene file (.xml).", show_default=False)]
SizeOption = Annotated[str | None, typer.Option("--size", metavar="WxH", help="Image size instead of the film's.")]
SppOption = Annotated[int, typer.Option("--spp", min=1, help="Samples per pixel.")]
CacheOption = Annotated[bool, typer.Option("--cache/--no-cache", help="Keep batches on disk, and use those kept.")]
ToleranceOption = Annotated[float, typer.Option("--tolerance", min=1e-9, max=1.0,
                                                help="Bias, relative to the mean, that still counts as equivalent.")]
ConfidenceOption = Annotated[float, typer.Option("--confidence", min=0.5, max=0.999999,
                                                 help="Confidence of intervals and verdicts.")]


def open_scene(path: Path, size: str | None = None) -> Scene:
    """Load the scene, with the size given on the command line, and say what was replaced in it."""
    from harness.scene import load_scene

    width, height = parse_size(size)
    scene = load_scene(path, width=width, height=height)
    for note in scene.notes:
        log(f"{path}: note: {note}")
    return scene


def parse_size(size: str | None) -> tuple[int | None, int | None]:
    """'640x480' as (640, 480); HarnessError for anything else."""
    if size is None:
        return None, None
    found = re.fullmatch(r"(\d+)[xX×](\d+)", size)
    if not found or not (int(found[1]) and int(found[2])):
        raise HarnessError(f"--size: expected WIDTHxHEIGHT with both at least 1, such as 640x480; found '{size}'")
    return int(found[1]), int(found[2])


def open_store(cache: bool) -> Store | None:
    """The batch store in the cache folder, or None where the user wants none."""
    if not cache:
        return None
    from harness.files import cache_dir
    from harness.store import Store

    return Store(cache_dir() / "batches")
