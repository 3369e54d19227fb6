"""What `harness study` studies: strategies of our tracer, and whatever else is named on the command line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.estimators.base import Estimator
    from harness.scene import SceneFile
    from harness.studies.parameters import Axes

CommandsOption = Annotated[list[str] | None, typer.Option("--command", metavar="[NAME=]TEMPLATE", help=(
    'A program beside our tracer: "myrt {scene} --spp {spp} --seed {seed} -o {out}", as in `harness compare`; {alpha} '
    "stands for a parameter's value. May be given several times, as may the next three."))]
ShadersOption = Annotated[list[str] | None, typer.Option("--shader", metavar="[NAME=]FILE", help=(
    "Somebody's shader of any host that can be read; a frame is a sample. A parameter's value reaches its uniform, "
    "constant or macro of that name."))]
ImagesOption = Annotated[list[str] | None, typer.Option("--images", metavar="[NAME=]GLOB", help=(
    "Renders that are there, each with a seed of its own, quoted: 'mine_{scene}_{alpha}_*.exr'."))]
IntegratorsOption = Annotated[str | None, typer.Option("--integrators", metavar="A,B,...", help=(
    "Mitsuba's: path, bsdf_path, volpath, …"))]


def names(option: str, given: str, example: str) -> list[str]:
    """'uniform,mixture' as a list."""
    found = [name.strip() for name in given.split(",")]
    if not all(found):
        raise HarnessError(f"{option}: expected names with commas between, such as {example}; found '{given}'")
    return found


def estimators(strategies: str | None, commands: Sequence[str] | None, shaders: Sequence[str] | None,
               images: Sequence[str] | None, integrators: str | None, spp: int,
               timeout: float) -> list[str | Estimator] | None:
    """Strategies by name, and the others; None, all strategies that suit, where nothing is named at all."""
    from harness.estimators.by_scene import ByScene, named
    from harness.estimators.command import Command
    from harness.estimators.mitsuba import Mitsuba

    found: list[str | Estimator] = []
    if strategies is not None:
        found += names("--strategies", strategies, "uniform,mixture")
    found += [named(text, lambda word: Command(word, timeout)) for text in commands or ()]
    found += [named(text, lambda word: ByScene("shader", word, spp)) for text in shaders or ()]
    found += [named(text, lambda word: ByScene("images", word)) for text in images or ()]
    if integrators is not None:
        found += [Mitsuba(name) for name in names("--integrators", integrators, "path,bsdf_path")]
    return found or None


def require_told_apart(studied: Sequence[str | Estimator] | None, scenes: Sequence[SceneFile], axes: Axes) -> None:
    """HarnessError for files that would be the same on every scene, or for images at every value of a parameter."""
    from harness.estimators.by_scene import ByScene, Named

    varied = [*(["scene"] if len(scenes) > 1 else []), *(name for name, values in axes if len(values) > 1)]
    for each in studied or ():
        files = each.estimator if isinstance(each, Named) else each
        if not isinstance(files, ByScene):
            continue
        apart = varied if files.kind == "images" else [name for name in varied if name == "scene"]
        if lacks := next((name for name in apart if name not in files.depends), None):
            raise HarnessError(f"--{files.kind} '{files.word}': the same files for every {lacks}; write {{{lacks}}} "
                               "into their name where its value belongs")


def notes(studied: Sequence[str | Estimator] | None, file: SceneFile, axes: Axes) -> Iterator[str]:
    """What is to be said of shaders that are the same at every value of a parameter; `file`: one combination."""
    from harness.estimators.base import taken
    from harness.estimators.by_scene import ByScene, Named

    for each in studied or ():
        files = each.estimator if isinstance(each, Named) else each
        if not isinstance(each, str) and isinstance(files, ByScene) and files.kind == "shader":
            names = taken(files, file)
            for name, values in axes:
                if len(values) > 1 and name not in names:
                    yield (f"note: '{each.name}' has no uniform, constant or macro '{name}', and is the same at all "
                           "its values")
