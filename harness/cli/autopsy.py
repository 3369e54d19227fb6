"""`harness autopsy`: which stage of a path is computed wrongly, and where in the shader."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import DeviceOption, SceneArgument, SetOption, SizeOption, open_scene, scene_file
from harness.cli.output import JsonOption, print_json, progress

# Enough pixels for every shape of a scene, and a second of CPU time.
DEFAULT_SIZE = "96x72"


def autopsy(
    scene: SceneArgument,
    library: Annotated[Path | None, typer.Option("--library", help="A folder of shader files that stand in for the "
                       "harness's of the same name.", show_default=False)] = None,
    strategy: Annotated[str, typer.Option("--strategy", help="How directions are drawn.")] = "mixture",
    size: SizeOption = None,
    samples: Annotated[int, typer.Option("--samples", min=1, max=64, help="Paths of each pixel.")] = 2,
    strict: Annotated[bool, typer.Option("--strict", help="Hold a generator, a sampler, a loop or a way to sample "
                                         "lights of the library's own to ours.")] = False,
    parameters: SetOption = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> int:
    """Compare the stages of paths with Mitsuba's, and name the function that computes the first that differs.

    Every vertex is taken from the shader as it renders and computed again by Mitsuba from the same ray and the same
    random numbers: what differs is what this step got wrong. Where the strategy samples lights, each function of that
    is asked at those vertices. Exit status 1 when a stage differs.

    Example: `harness autopsy mitsuba_scenes/spheres.xml --strategy lobes`
    """
    from harness.diagnosis import autopsy as examine
    from harness.diagnosis.text import lines
    from harness.errors import HarnessError
    from harness.shader.own_files import own_library

    if library is not None and not library.is_dir():
        raise HarnessError(f"--library: '{library}' is not a folder; give one that holds lib/phong.glsl, for example")
    whole = own_library(None, library)
    file = scene_file(scene, size or DEFAULT_SIZE, parameters)
    open_scene(file)
    found = examine(file, strategy, whole, samples=samples, strict=strict, progress=progress)
    if json:
        print_json({"autopsy": found})
    else:
        for line in lines(found):
            print(line.rstrip())
    return 1 if found.differs else 0
