"""`harness render` and `harness reference`: one estimate of one scene, to an EXR or PNG file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import (
    SAMPLER,
    CacheOption,
    DepthOption,
    DeviceOption,
    ProfileTimeOption,
    SamplerOption,
    SceneArgument,
    SetOption,
    SizeOption,
    SppOption,
    StrategyOption,
    not_finite,
    open_scene,
    open_store,
    require_memory,
    scene_file,
    scene_hash,
)
from harness.cli.output import JsonOption, log, print_json, progress
from harness.errors import HarnessError
from harness.stats.channels import CHANNELS

if TYPE_CHECKING:
    from harness.estimators.base import Estimator
    from harness.samples.estimate import Batch, Estimate
    from harness.scene import SceneFile
    from harness.view.tev import Tev

# Seconds between two images that tev is sent while one grows.
TEV_SECONDS = 0.25

OutputOption = Annotated[Path | None, typer.Option(
    "--output", "-o", help="File to write: .exr (linear, with variance and metadata) or .png (ready to look at); "
                           "an .exr named after the scene if not given.")]
ReplicaOption = Annotated[int, typer.Option("--replica", min=0, max=2**31 - 1,
                                            help="Seed: each replica is an independent random stream.")]


def render(
    scene: SceneArgument,
    strategy: StrategyOption = "mixture",
    sampler: SamplerOption = "independent",
    spp: SppOption = 256,
    replica: ReplicaOption = 0,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    parameters: SetOption = None,
    output: OutputOption = None,
    library: Annotated[Path | None, typer.Option("--library", metavar="FOLDER", show_default=False, help=(
        "Shader files that stand in for the harness's of the same name."))] = None,
    watch: Annotated[bool, typer.Option("--watch", help="Render again whenever the scene, a file that it names, or a "
                                        "shader is saved.")] = False,
    tev: Annotated[bool, typer.Option("--tev", help="Show the image in a running tev while it grows.")] = False,
    tev_at: Annotated[str | None, typer.Option("--tev-at", metavar="HOST:PORT", show_default=False, help=(
        "Where tev listens, if not at localhost:14158."))] = None,
    cache: CacheOption = True,
    device: DeviceOption = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> None:
    """Render a scene with the GLSL path tracer.

    With `--sampler sobol` the file holds no variance, which several of them tell, each with a `--replica` of its own.
    `--watch` goes on until Ctrl-C, and through files that are broken for a while. It and `--tev` need the extra 'live'.

    Example: `harness render mitsuba_scenes/spheres.xml --strategy mixture --spp 1024 -o spheres.exr`
    """
    from contextlib import nullcontext

    from harness.estimators.tracer import Tracer
    from harness.gpu.width import ask
    from harness.view.tev import ADDRESS, Tev

    if watch and json:
        raise HarnessError("--watch does not end by itself, so there is no one JSON object to print; leave out --json")
    if library is not None and not library.is_dir():
        raise HarnessError(f"--library: '{library}' is not a folder; give one that holds lib/phong.glsl, for example")
    if library is None:  # a folder may hold a `main` of its own, which is a fragment shader, now or while one watches
        ask()
    file = scene_file(scene, size, parameters, max_depth)
    if not scene.is_file():  # nothing to wait for
        open_scene(file)
    estimator = Tracer(strategy, sampler=sampler, folder=library)
    target = _target(output, scene.stem)
    with Tev(tev_at or ADDRESS) if tev or tev_at else nullcontext() as screen:
        def once(check: Callable[[], None] = lambda: None) -> None:
            open_scene(file)
            if warning := estimator.check(file):
                log(f"{scene}: warning: strategy '{strategy}': {warning}")
            labels = {"strategy": strategy, "exposure": file.film.exposure}
            _render(estimator, file, target, Asked(spp, replica, cache, json), labels,
                    _growing(screen, f"{file.name} {estimator.name}", spp, check))

        if watch:
            _again(file, library, once)
        else:
            once()


def _again(file: SceneFile, library: Path | None, once: Callable[[Callable[[], None]], None]) -> None:
    """Render now and after each save of what the image depends on, until Ctrl-C."""
    from contextlib import suppress

    from harness.errors import SceneError
    from harness.files import data_dir
    from harness.view.saved import repeat

    named: tuple[Path, ...] = ()

    def files() -> Iterator[Path]:
        nonlocal named
        with suppress(SceneError):  # rendering says what is wrong; until that is mended it names what it named before
            named = file.sources
        yield file.path
        yield from named
        for folder in (data_dir("glsl"), library):
            if folder is not None:
                yield from (folder, *(path for path in folder.rglob("*") if path.is_dir()))

    repeat(files, once, log)


def _growing(screen: Tev | None, name: str, spp: int, check: Callable[[], None]) -> Callable[[Batch], None]:
    """What is done with each batch: look whether the image is stale, and show it in tev, the last one for certain."""
    import time

    from harness.samples.estimate import Accumulator

    so_far, shown = Accumulator(), -math.inf

    def seen(batch: Batch) -> None:
        nonlocal shown
        check()
        if screen is None or shown == math.inf:
            return
        so_far.add(batch)
        if so_far.samples == spp or time.monotonic() - shown > TEV_SECONDS:
            try:
                screen.show(name, so_far.mean)
                shown = time.monotonic()
            except HarnessError as error:  # the image is worth more than the look at it
                log(f"warning: {error}")
                shown = math.inf

    return seen


def reference(
    scene: SceneArgument,
    spp: SppOption = 1024,
    replica: ReplicaOption = 0,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    parameters: SetOption = None,
    integrator: Annotated[str, typer.Option("--integrator", help="The scene file's own ('file'), or another of "
                                            "Mitsuba's: path, volpath, ptracer, ...")] = "file",
    variant: Annotated[str, typer.Option("--variant", help="Mitsuba's variant, such as llvm_ad_spectral.")]
    = "llvm_ad_rgb",
    output: OutputOption = None,
    cache: CacheOption = True,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> None:
    """Render any Mitsuba 3 scene with Mitsuba, ours with the equivalent Phong BSDF.

    Its film gets a box filter and its sensor an independent sampler; all else is as the file says.

    Example: `harness reference mitsuba_scenes/spheres.xml --spp 16384 -o truth.exr`
    """
    from harness.estimators.mitsuba import Mitsuba

    file = scene_file(scene, size, parameters, max_depth)
    require_memory(file)
    estimator = Mitsuba(integrator, variant=variant)
    target = _target(output, f"{scene.stem}-reference")
    _render(estimator, file, target, Asked(spp, replica, cache, json),
            {"strategy": estimator.name, "exposure": file.film.exposure})


def _target(output: Path | None, stem: str) -> Path:
    """Where to write, checked before any work is done."""
    from harness.files import require_writable

    target = output or Path(f"{stem}.exr")
    if target.suffix.lower() not in (".exr", ".png"):
        raise HarnessError(f"{target}: unknown image format '{target.suffix}'; name the file .exr or .png")
    require_writable(target)
    return target


@dataclass(frozen=True)
class Asked:
    """What both commands are asked for."""

    spp: int
    replica: int
    cache: bool
    json: bool


def _render(estimator: Estimator, file: SceneFile, target: Path, asked: Asked, labels: dict[str, Any],
            seen: Callable[[Batch], None] = lambda batch: None) -> None:
    from harness.cli.options import SCENE_HASH
    from harness.samples.exr import write_estimate
    from harness.samples.images import write_png
    from harness.work.batches import render_estimate

    with estimator.open(file) as renderer, progress(asked.spp, f"{file.name} {labels['strategy']}") as advance:
        result = render_estimate(renderer, asked.spp, replica=asked.replica, store=open_store(asked.cache),
                                 advance=advance, seen=seen)
        identity = dict(renderer.identity)
        if "integrator" in identity:  # the file's own has a name, too
            labels["strategy"] = f"mitsuba {identity['integrator']}"
    facts = {**labels, "scene": file.name, "spp": asked.spp, "replica": asked.replica,
             **{f"harness.{key}": value for key, value in identity.items()}, SCENE_HASH: scene_hash(file)}
    if target.suffix.lower() == ".png":
        write_png(target, result.mean, labels["exposure"])
    else:
        write_estimate(target, result, facts)
    if SAMPLER in facts:
        log(f"{target}: of evenly spread samples of one replica no noise can be told, so it holds no variance; render "
            f"it again with --replica {asked.replica + 1}, and so on, and compare them together")
    if result.rejected:
        log(f"warning: {target}: {not_finite(result.rejected)}")
    height, width = result.mean.shape[:2]
    if asked.json:
        print_json({"output": target, **facts, "size": [width, height], **_numbers(result)})
    else:
        print(f"{target}: {width} x {height}, {asked.spp} spp, {_speed(result)}", flush=True)  # --watch goes on


def _numbers(result: Estimate) -> dict[str, Any]:
    return {
        "mean": dict(zip(CHANNELS, result.image_mean, strict=True)),
        "standard_error": dict(zip(CHANNELS, result.image_variance**0.5, strict=True)),
        "batches": result.batches, "rejected": result.rejected, "seconds": result.cost.seconds,
        "device": result.cost.device, "clock": result.cost.clock,
    }


def _speed(result: Estimate) -> str:
    """Samples of the whole image by the clock that counts; batches of several devices have no common one."""
    seconds = result.cost.seconds
    if not math.isfinite(seconds):
        return "speed unknown: its samples were drawn on several devices, or nobody measured them"
    height, width = result.mean.shape[:2]
    rate = width * height * result.samples / max(seconds, 1e-9) / 1e6
    return f"{rate:.3g} million samples a {result.cost.clock.upper()} second"
