"""`harness new-shader` and `harness new-scene`: commented starts to go on from, and the commands that check them."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.output import JsonOption, print_json


def new_shader(
    name: Annotated[str, typer.Argument(help="What to call it, without a suffix; a folder may stand before.",
                                        show_default=False)],
    host: Annotated[str, typer.Option("--host", help="What is to run it: body (the body of a Gratin node), gratin (a "
                                      "pipeline), shadertoy, webgl (a page), glslviewer or native (the harness).")],
    json: JsonOption = False,
) -> None:
    """Write a short path tracer that is right and commented, for somebody to go on from.

    It traces the bundled scene starts/ball, with which the command printed compares it. No file is overwritten.

    Example: `harness new-shader my_tracer --host gratin`
    """
    from harness.files import create_files
    from harness.shader import starts

    files = starts.start(host, name)
    create_files({path: text.encode() for path, text in files.items()})
    command, hint = starts.check_command(host, name), starts.hint(host, name)
    if json:
        print_json({"files": list(files), "host": host, "scene": starts.SCENE, "check": command, "hint": hint})
        return
    print(f"{', '.join(map(str, files))}: a path tracer to go on from; {hint}")
    print(f"check it: {command}")


def new_scene(
    name: Annotated[Path, typer.Argument(help="What to call it: my_scene or my_scene.xml.", show_default=False)],
    source: Annotated[str, typer.Option("--from", metavar="SCENE", help="The bundled scene to copy, such as spheres; "
                                        "else one that explains each of its parts.")] = "starts/ball",
    json: JsonOption = False,
) -> None:
    """Write a commented scene file that both renderers hold, and a gates file for it, to go on from.

    The commands printed render, study and gate it. No file is overwritten, but for an image that is there already.

    Example: `harness new-scene my_scene --from spheres`
    """
    from harness.files import create_files
    from harness.scene import starts

    path = name if name.suffix else name.with_suffix(".xml")
    files = {place: content for place, content in starts.start(path, source).items() if not _same(place, content)}
    create_files(files)
    shown, gates = shlex.quote(str(path)), shlex.quote(str(starts.gates_file(path)))
    commands = (f"harness render {shown} -o {shlex.quote(f'{path.stem}.png')}", f"harness study {shown} --spp 256",
                f"harness gate {gates}")
    if json:
        print_json({"files": list(files), "from": source, "commands": commands})
        return
    print(f"{', '.join(map(str, files))}: a scene to go on from, and its gate")
    for command in commands:
        print(f"    {command}")


def _same(path: Path, content: bytes) -> bool:
    """Whether an image is there as it would be written: several scenes share theirs."""
    return path.parent.name == "textures" and path.is_file() and path.read_bytes() == content
