"""`harness view`: a window in which an image grows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import CacheOption, SizeOption, open_scene, open_store, parse_size, scene_file, scene_hash
from harness.cli.output import JsonOption, log, print_json

# Whose film a shader fills that shows no scene.
SKELETON = "starts/ball"

if TYPE_CHECKING:
    from harness.estimators.base import Estimator
    from harness.samples.estimate import Estimate
    from harness.scene import SceneFile
    from harness.view.session import FindReference


def view(
    what: Annotated[Path, typer.Argument(metavar="SCENE|SHADER", show_default=False,
                                         help="A Mitsuba 3 scene file (.xml), or somebody's shader.")],
    scene: Annotated[str | None, typer.Option("--scene", help="The scene that a shader shows, a file or the name of a "
                                              "bundled one: its film, and what it is held against.")] = None,
    strategy: Annotated[str, typer.Option("--strategy", "-s", help="With which strategy to begin.")] = "mixture",
    reference: Annotated[Path | None, typer.Option("--reference", metavar="FILE", help="An .exr file to hold the image "
                                                   "against, in place of Mitsuba's samples in the cache.")] = None,
    size: SizeOption = None,
    values: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=(
        "A value for a <default> parameter of the scene, or for a uniform of the shader; may be given several times."))]
    = None,
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for what is saved.")] = Path(),
    cache: CacheOption = True,
    json: JsonOption = False,
) -> None:
    """Watch a scene, or a shader, being rendered in a window.

    Keys: left, right: strategy; up, down: exposure; page up, page down: depth; space: pause; R: start again; S: save an
    EXR and a PNG; Q, Esc: leave. The title tells the samples per pixel, and the error against what `harness reference`
    left in the cache. Needs the extra 'view'.

    Example: `harness view mitsuba_scenes/spheres.xml --strategy uniform`
    """
    from harness.cli.options import SCENE_HASH
    from harness.gpu.window import Window
    from harness.view.loop import watch
    from harness.view.session import HELP, Session, Watched

    is_scene = what.suffix == ".xml"
    subject = _tracers(what, strategy, size, values) if is_scene else _shader(what, scene, size, values)
    file = subject.scene
    find = _finder(reference, cache) if subject.shown else _nothing
    film = file.film
    window = Window((film.width, film.height), file.name)
    try:
        log(HELP)
        with Session(file, subject.estimators, Watched(subject.first, film.exposure), find_reference=find,
                     folder=folder, name=file.name if subject.shown else "",
                     facts={SCENE_HASH: scene_hash(file)} if subject.shown else {}) as session:
            watch(session, window)
            if json:
                print_json({"scene": file.name, "estimator": session.estimator.name, "samples": session.samples,
                            "saved": session.saved, **session.errors})
            else:
                print(session.title)
    finally:
        window.close()


@dataclass(frozen=True)
class Subject:
    """What is watched: estimators, of which number `first` comes first, and the scene whose film they fill. `shown`:
    whether they are said to show it."""

    estimators: tuple[Estimator, ...]
    first: int
    scene: SceneFile
    shown: bool = True


def _tracers(path: Path, strategy: str, size: str | None, parameters: list[str] | None) -> Subject:
    """Our tracer with each strategy that suits the scene, and with the one that is asked for."""
    from harness.estimators.tracer import Tracer
    from harness.scene.strategies import check_strategy, suitable_strategies

    file = scene_file(path, size, parameters)
    reading = open_scene(file)
    check_strategy(reading, strategy)
    names = suitable_strategies(reading)
    names = names if strategy in names else (*names, strategy)
    return Subject(tuple(Tracer(name) for name in names), names.index(strategy), file)


def _shader(path: Path, scene: str | None, size: str | None, values: list[str] | None) -> Subject:
    """Somebody's shader, single frames of it, on the film of the scene that it is said to show, or of one of our own
    size."""
    from harness.cli.check import parse_values
    from harness.estimators.shader import Shader
    from harness.scene import SceneFile

    shader = Shader((path,), values=tuple(sorted(parse_values(values or ()).items())))
    own = shader.read().size
    if scene is None:
        file = SceneFile.bundled(SKELETON)
    else:
        file = SceneFile(Path(scene)) if Path(scene).is_file() else SceneFile.bundled(scene)
    width, height = parse_size(size)
    if width and height:
        file = file.sized(width, height)
    elif own:
        file = file.sized(*own)
    shader.check(file)
    return Subject((shader,), 0, file, scene is not None)


def _finder(image: Path | None, cache: bool) -> FindReference:
    """What an image is held against: a file, or what the cache has of Mitsuba's."""
    from harness.samples.exr import read_estimate
    from harness.view.reference import stored_reference

    if image is not None:
        found, _ = read_estimate(image)
        return lambda scene: found
    store = open_store(cache)
    return lambda scene: stored_reference(scene, store)


def _nothing(scene: SceneFile) -> Estimate | None:
    return None
