"""`harness render` and `harness reference`: one estimate of one scene, to an EXR or PNG file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import CacheOption, SceneArgument, SizeOption, SppOption, not_finite, open_scene, open_store
from harness.cli.output import JsonOption, log, print_json, progress
from harness.errors import HarnessError
from harness.stats.channels import CHANNELS

if TYPE_CHECKING:
    from harness.estimators.base import Renderer
    from harness.samples.estimate import Estimate
    from harness.scene import Scene

OutputOption = Annotated[Path | None, typer.Option(
    "--output", "-o", help="File to write: .exr (linear, with variance and metadata) or .png (ready to look at); "
                           "an .exr named after the scene if not given.")]
ReplicaOption = Annotated[int, typer.Option("--replica", min=0, max=2**31 - 1,
                                            help="Seed: each replica is an independent random stream.")]


def render(
    scene: SceneArgument,
    strategy: Annotated[str, typer.Option("--strategy", "-s", help="uniform, cosine, phong, lobes or mixture.")]
    = "mixture",
    spp: SppOption = 256,
    replica: ReplicaOption = 0,
    size: SizeOption = None,
    output: OutputOption = None,
    cache: CacheOption = True,
    json: JsonOption = False,
) -> None:
    """Render a scene with the GLSL path tracer.

    Example: `harness render mitsuba_scenes/spheres.xml --strategy mixture --spp 1024 -o spheres.exr`
    """
    from harness.gpu.renderer import TracerRenderer
    from harness.shader.strategies import check_strategy

    loaded = open_scene(scene, size)
    judged = check_strategy(loaded, strategy)
    target = _target(output, scene.stem)
    if not judged.suits:
        log(f"{scene}: warning: strategy '{strategy}': {judged.warning}")
    renderer = TracerRenderer(loaded, strategy)
    _render(renderer, loaded, target, spp, replica, cache, json, {"strategy": strategy})


def reference(
    scene: SceneArgument,
    spp: SppOption = 1024,
    replica: ReplicaOption = 0,
    size: SizeOption = None,
    output: OutputOption = None,
    cache: CacheOption = True,
    json: JsonOption = False,
) -> None:
    """Render the same scene with Mitsuba 3 and the equivalent Phong BSDF.

    Example: `harness reference mitsuba_scenes/spheres.xml --spp 16384 -o truth.exr`
    """
    from harness.reference.renderer import ReferenceRenderer

    loaded = open_scene(scene, size)
    target = _target(output, f"{scene.stem}-reference")
    _render(ReferenceRenderer(loaded), loaded, target, spp, replica, cache, json, {"strategy": "mitsuba path"})


def _target(output: Path | None, stem: str) -> Path:
    """Where to write, checked before any work is done."""
    from harness.files import require_writable

    target = output or Path(f"{stem}.exr")
    if target.suffix.lower() not in (".exr", ".png"):
        raise HarnessError(f"{target}: unknown image format '{target.suffix}'; name the file .exr or .png")
    require_writable(target)
    return target


def _render(renderer: Renderer, scene: Scene, target: Path, spp: int, replica: int, cache: bool, json: bool,
            labels: dict[str, Any]) -> None:
    from harness.samples.exr import write_estimate
    from harness.samples.images import write_png
    from harness.work.batches import render_estimate

    with progress(spp, f"{scene.name} {labels['strategy']}") as advance:
        result = render_estimate(renderer, spp, replica=replica, store=open_store(cache), advance=advance)
    facts = {**labels, "scene": scene.name, "spp": spp, "replica": replica, "exposure": scene.exposure,
             **{f"harness.{key}": value for key, value in renderer.identity.items()}}
    if target.suffix.lower() == ".png":
        write_png(target, result.mean, scene.exposure)
    else:
        write_estimate(target, result, facts)
    if result.rejected:
        log(f"warning: {target}: {not_finite(result.rejected)}")
    if json:
        print_json({"output": target, **facts, "size": [scene.width, scene.height], **_numbers(result)})
    else:
        print(f"{target}: {scene.width} x {scene.height}, {spp} spp, {_speed(result):.3g} million samples a CPU second")


def _numbers(result: Estimate) -> dict[str, Any]:
    return {
        "mean": dict(zip(CHANNELS, result.image_mean, strict=True)),
        "standard_error": dict(zip(CHANNELS, result.image_variance**0.5, strict=True)),
        "batches": result.batches, "rejected": result.rejected, "cpu_seconds": result.cpu_seconds,
    }


def _speed(result: Estimate) -> float:
    height, width = result.mean.shape[:2]
    return width * height * result.samples / max(result.cpu_seconds, 1e-9) / 1e6
