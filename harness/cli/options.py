"""Options that several commands share, and what they turn into."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.output import log, print_spending
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.samples.store import Store
    from harness.scene import Scene, SceneFile
    from harness.work.executors import Executor

# The metadata in which `harness render` and `harness reference` note the scene's content hash.
SCENE_HASH = "harness.scene"
# The same of its sampler, where that is not the usual one.
SAMPLER = "harness.sampler"
# What `harness bench` leaves in the report's folder, and `harness report` takes up there.
BENCH_FILE = "bench.json"
# The same of `harness calibrate`.
CALIBRATION_FILE = "calibration.json"
# The same of `harness mutants`.
MUTANTS_FILE = "mutants.json"
# The same of `harness mutants --autopsy`.
AUTOPSY_FILE = "autopsies.json"
# Largest --spp: the reference's seeds tell this many samples of a replica apart (reference.renderer.START_BITS).
MAX_SPP = 1 << 22
# Stops by which an image may be brightened or darkened for display, as in a scene file (scene.sensors.MAX_EXPOSURE).
MAX_EXPOSURE = 64.0
# Workers, where nobody says how many.
CORES = os.cpu_count() or 1
# What a study holds of each pixel at its peak: sums, batches and textures; measured 480, and 12 for each later batch.
BYTES_PER_PIXEL = 600

SceneArgument = Annotated[Path, typer.Argument(help="A Mitsuba 3 scene file (.xml).", show_default=False)]
SizeOption = Annotated[str | None, typer.Option("--size", metavar="WxH", help="Image size instead of the film's.")]
DepthOption = Annotated[int | None, typer.Option("--max-depth", metavar="N", min=1, max=1024, help=(
    "Vertices of a path at most, instead of the scene's; 1 is light seen directly."))]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A value for a <default> "
                                                       "parameter of the scene; may be given several times.")]
SamplerOption = Annotated[str, typer.Option("--sampler", help="Where the random numbers come from: independent, or "
                                             "sobol (spread evenly; replicas alone tell its noise).")]
ExecutorOption = Annotated[str, typer.Option("--executor", help="Where samples are drawn: serial (in this process), "
                                             "processes, dask, slurm.")]
ClusterOption = Annotated[list[str] | None, typer.Option("--cluster", metavar="NAME=VALUE|FILE.toml", help=(
    "What the executor is told: scheduler=ADDRESS (dask), partition=NAME, time=MINUTES, mem_gb=N, … (slurm); several "
    "times, or in a file with a table of the executor's name."))]
JobsOption = Annotated[int, typer.Option("--jobs", "-j", min=1, max=4096, help=(
    "Workers: processes, or jobs of a cluster; one a core of this machine if not given."))]
StrategyOption = Annotated[str, typer.Option("--strategy", "-s", help=(
    "uniform, cosine, phong, lobes, mixture, nee, mis, or a draw with +nee or +mis."))]
SppOption = Annotated[int, typer.Option("--spp", min=1, max=MAX_SPP, help="Samples per pixel.")]
CacheOption = Annotated[bool, typer.Option("--cache/--no-cache", help="Keep batches on disk, and use those kept.")]
DeviceOption = Annotated[int | None, typer.Option("--device", min=0, callback=lambda number: choose_device(number),
                                                  help="EGL device to draw on, as `harness doctor` numbers them.")]


def _profile_time(context: typer.Context, asked: bool) -> bool:
    """Count from now on what the time of this command goes to, and print it at its end, however that comes."""
    if asked:
        from harness.samples.spent import watch

        spending = watch()
        context.call_on_close(lambda: print_spending(spending))
    return asked


ProfileTimeOption = Annotated[bool, typer.Option("--profile-time", callback=_profile_time, help=(
    "Print on stderr at the end what the elapsed time went to."))]
ToleranceOption = Annotated[float, typer.Option("--tolerance", min=1e-9, max=1.0,
                                                help="Bias, relative to the mean, that still counts as equivalent.")]
ConfidenceOption = Annotated[float, typer.Option("--confidence", min=0.5, max=0.999999,
                                                 help="Confidence of intervals and verdicts.")]


def choose_device(number: int | None) -> int | None:
    """Draw on this EGL device, here and in processes started from here; told before the first context is made."""
    if number is not None:
        os.environ["HARNESS_GL_DEVICE"] = str(number)
    return number


def scene_file(path: Path, size: str | None = None, parameters: Sequence[str] | None = None,
               max_depth: int | None = None) -> SceneFile:
    """The scene file with the size, the parameters and the depth given on the command line. HarnessError for malformed
    ones."""
    from harness.scene import SceneFile

    width, height = parse_size(size)
    given = {}
    for text in parameters or ():
        name, equals, value = text.partition("=")
        if not (name.strip() and equals):
            raise HarnessError(f"--set: expected NAME=VALUE, such as alpha=10; found '{text}'")
        given[name.strip()] = value.strip()
    return SceneFile(path, tuple(given.items()), (width, height) if width and height else None, max_depth)


def open_scene(file: Path | SceneFile, size: str | None = None) -> Scene:
    """Our reading of a scene, with the size given on the command line; says what was replaced in it.

    HarnessError, besides what the scene's file gives reason for, when this machine's memory cannot hold its image.
    """
    from harness.scene import load, present

    file = scene_file(file, size) if isinstance(file, Path) else file
    scene = load(file)
    require_memory(file)
    for note in present(file).notes:
        log(f"{file.path}: note: {note}")
    return scene


def scene_hash(file: SceneFile) -> str:
    """By which images of one scene know each other: our reading's where there is one, else that of the file."""
    from harness.errors import SceneError
    from harness.scene import load

    try:
        return load(file).content_hash
    except SceneError:
        return file.hash


def parse_size(size: str | None) -> tuple[int | None, int | None]:
    """'640x480' as (640, 480); HarnessError for anything else. How large is too large is left to the loader."""
    if size is None:
        return None, None
    found = re.fullmatch(r"([0-9]{1,9})[xX×]([0-9]{1,9})", size)
    if not found or not (int(found[1]) and int(found[2])):
        raise HarnessError(f"--size: expected WIDTHxHEIGHT with both at least 1, such as 640x480; found '{size}'")
    return int(found[1]), int(found[2])


def open_store(cache: bool) -> Store | None:
    """The batch store in the cache folder, or None where the user wants none.

    HarnessError where the cache folder is not there and cannot be made.
    """
    if not cache:
        return None
    from harness.files import cache_dir
    from harness.samples.store import Store

    root = cache_dir() / "batches"
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HarnessError(f"{root}: the cache folder cannot be made ({error.strerror}); set HARNESS_CACHE to a folder "
                           "that you may write, or render with --no-cache") from None
    return Store(root)


def open_executor(name: str, jobs: int, cluster: Sequence[str] | None) -> AbstractContextManager[Executor]:
    """The executor of that name, with what `--cluster` says. HarnessError for a name or an option that is none."""
    from harness.gpu.width import ask
    from harness.work.executors import executor

    options: dict[str, str | int | float] = {}
    for text in cluster or ():
        word, equals, value = text.partition("=")
        if equals and word.strip():
            options[word.strip()] = _number(value.strip())
        elif text.endswith(".toml"):
            options |= _table(Path(text), name)
        else:
            raise HarnessError("--cluster: expected NAME=VALUE, such as partition=cpu, or a .toml file; found "
                               f"'{text}'")
    # A worker of Dask's goes on to other work; those of a job of Slurm's may be of several machines.
    return executor(name, jobs, ask if name in ("serial", "processes") else None, options)


def _number(text: str) -> str | int | float:
    """A number where it is one."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _table(path: Path, name: str) -> dict[str, str | int | float]:
    """The table of an executor's name in a TOML file, empty where it has none. HarnessError for what is no such
    file."""
    import tomllib

    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get(name, {})
    except (OSError, ValueError) as error:
        raise HarnessError(f"{path}: cannot be read as TOML ({error}); write a table [{name}] of names and "
                           "values") from None
    if not isinstance(table, dict) or not all(isinstance(value, str | int | float) for value in table.values()):
        raise HarnessError(f"{path}: [{name}] must be a table of texts and numbers, such as partition = \"cpu\"")
    return table


def warn_of_other_scene(scene_hash: object, facts: Mapping[str, object], path: Path) -> None:
    """Say so when an image file, by the hash in its metadata, shows another scene than the one with `scene_hash`."""
    other = facts.get(SCENE_HASH)
    if scene_hash is not None and other is not None and other != scene_hash:
        log(f"warning: {path}: rendered from another scene, or another size or version of it (scene hash {other}, not "
            f"{scene_hash})")


def not_finite(samples: int) -> str:
    """What to say of samples that a renderer rejected."""
    return (f"samples that were not finite and were left out: {samples}; look for a division by zero, a "
            "root or power of a negative number, or a random number that is exactly 0 or 1 (log(u), 1 - u)")


def require_memory(file: SceneFile) -> None:
    """HarnessError when this machine's memory cannot hold the scene's image."""
    from harness.machine.doctor import memory_limit

    film = file.film
    needed, limit = film.width * film.height * BYTES_PER_PIXEL, memory_limit()
    if needed > limit:
        raise HarnessError(f"{file.path}: an image of {film.width} x {film.height} pixels takes about "
                           f"{needed / 2**30:.1f} GiB of memory, this machine has {limit / 2**30:.1f}; "
                           "choose a smaller --size")
