"""`harness export`: a scene and a strategy as another host's own files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import (
    DepthOption,
    SceneArgument,
    SetOption,
    SizeOption,
    StrategyOption,
    open_scene,
    scene_file,
)
from harness.cli.output import JsonOption, log, print_json
from harness.errors import HarnessError


def export(
    scene: SceneArgument,
    host: Annotated[str, typer.Option("--host", help="gratin, shadertoy, glslviewer, webgl or glsl (any host of the "
                                      "ping-pong contract).")],
    strategy: StrategyOption = "mixture",
    samples: Annotated[int, typer.Option("--samples", min=1, max=1024, help="Samples per pixel in each frame; fewer "
                                         "where paths are long.")] = 4,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    parameters: SetOption = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the files, or the file itself where "
                                                "there is only one; the folder SCENE-HOST if not given.")] = None,
    json: JsonOption = False,
) -> None:
    """Write a scene and its path tracer as files that another host opens.

    Example: `harness export mitsuba_scenes/spheres.xml --host webgl -o spheres.html`
    """
    from harness.files import require_writable, write_atomically
    from harness.scene.strategies import check_strategy
    from harness.shader.exports import export as exported

    file = scene_file(scene, size, parameters, max_depth)
    reading = open_scene(file)
    warning = check_strategy(reading, strategy).warning
    files = exported(reading, strategy, host, samples=samples, exposure=file.film.exposure)
    if warning:
        log(f"{scene}: warning: strategy '{strategy}': {warning}")
    targets = _targets(files, output or Path(f"{scene.stem}-{host}"))
    for target in targets:
        require_writable(target)
    for target, content in targets.items():
        with write_atomically(target) as path:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
    if json:
        print_json({"files": list(targets), "host": host, "strategy": strategy, "scene": file.name,
                    "size": [reading.width, reading.height]})
    else:
        for target in targets:
            print(target)


def _targets(files: Mapping[str, str | bytes], output: Path) -> dict[Path, str | bytes]:
    """Where each file goes: into the folder `output`, or, of one file, where `output` has its suffix, there.

    HarnessError where `output` is named like one file of several."""
    if output.suffix not in {Path(name).suffix for name in files}:
        return {output / name: content for name, content in files.items()}
    if len(files) > 1:
        raise HarnessError(f"--output: '{output}' is named as a file, and there are {len(files)} ({', '.join(files)}); "
                           "name a folder")
    return {output: next(iter(files.values()))}
