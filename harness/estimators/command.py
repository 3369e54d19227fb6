"""Any program as an estimator: run in a process of its own, once a replica, its image read from its file."""

from __future__ import annotations

import resource
import shlex
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from string import Formatter

import numpy as np

from harness.errors import HarnessError
from harness.machine.processes import end, last_line
from harness.progress import Advance
from harness.samples.cost import Watch, cpu
from harness.samples.estimate import Batch
from harness.samples.keys import digest
from harness.samples.readers import read_image
from harness.samples.spent import spent
from harness.samples.traits import Traits
from harness.scene.file import SceneFile

# What a command line may ask for, and what it must: without them there is no image, or no second one.
WORDS = ("scene", "spp", "seed", "out", "width", "height", "max_depth")
NEEDED = ("seed", "out")
# Seconds that one run may take unless somebody says otherwise.
TIME_LIMIT = 600.0
# What {max_depth} stands for where the scene file sets no bound, as Mitsuba writes it.
UNBOUNDED = -1
# A seed of 0 means "choose one" to many programs.
FIRST_SEED = 1


@dataclass(frozen=True)
class Command:
    """A program's command line, such as `myrt {scene} --spp {spp} --seed {seed} -o {out}`.

    `template` is split as a shell would, but no shell runs it. In its words {scene} stands for the scene file, {spp}
    for samples per pixel, {seed} for a number that differs from run to run, {out} for the image to write, {width} and
    {height} for its size, {max_depth} for the vertices of a path at most (-1: no bound). `seconds`: how long a run may
    take. `suffix`: of {out}, by which a program may choose the format.
    """

    template: str
    seconds: float = TIME_LIMIT
    suffix: str = ".exr"

    def __post_init__(self) -> None:
        try:
            words = shlex.split(self.template)
            asked = {name for word in words for _, name, _, _ in Formatter().parse(word) if name is not None}
        except ValueError as error:
            raise HarnessError(f"command `{self.template}`: {error}; write braces of its own twice, {{{{ and }}}}"
                               ) from None
        if not words:
            raise HarnessError("an empty command; write a program with {seed} and {out} among its arguments")
        for name in NEEDED:
            if name not in asked:
                why = "or all runs are one" if name == "seed" else "or its image is not found"
                raise HarnessError(f"command `{self.template}`: lacks {{{name}}}; pass it on to the program, {why}")
        if not self.seconds > 0:
            raise HarnessError(f"a command's time limit must be above 0 seconds, found {self.seconds:g}")

    @property
    def name(self) -> str:
        """The program's."""
        return Path(shlex.split(self.template)[0]).name

    def check(self, scene: SceneFile) -> str:
        """It is taken at its word. HarnessError for a word in braces that stands for nothing, and for a parameter or a
        depth of the scene that the program is not told of: it would render another scene."""
        given = scene.values
        asked = self._asked()
        for name in sorted(asked - given.keys()):
            if name not in WORDS:
                allowed = ", ".join(f"{{{word}}}" for word in (*WORDS, *given))
                raise HarnessError(f"command `{self.template}`: unknown '{{{name}}}'; allowed: {allowed}")
        for name in sorted(dict(scene.parameters).keys() - asked):
            raise HarnessError(f"command `{self.template}`: the scene's parameter '{name}' does not reach it; pass "
                               f"{{{name}}} on to the program")
        if scene.max_depth is not None and (reason := self.takes_depth(scene)):
            raise HarnessError(f"command `{self.template}`: {reason}")
        return ""

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        """The words in braces that are no words of every command line."""
        return tuple(sorted(self._asked() - {*WORDS}))

    def takes_depth(self, scene: SceneFile) -> str:
        """Empty where {max_depth} reaches the program."""
        return "" if "max_depth" in self._asked() else "max_depth does not reach it; pass {max_depth} on to the program"

    def _asked(self) -> set[str]:
        """The words in braces."""
        return {name for word in shlex.split(self.template) for _, name, _, _ in Formatter().parse(word) if name}

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[CommandRenderer]:
        """Nothing runs before the first batch; images go to a folder that is gone in the end.

        HarnessError as `check`.
        """
        self.check(scene)
        with tempfile.TemporaryDirectory(prefix="harness-command-") as folder:
            yield CommandRenderer(self, scene, Path(folder))


class CommandRenderer:
    """Each replica is one run with a seed of its own. Two runs that are the same image are refused."""

    traits = Traits(streams="runs", counts=False)

    def __init__(self, command: Command, scene: SceneFile, folder: Path) -> None:
        self._command, self.scene, self._folder = command, scene, folder
        self._film = scene.film
        self._hash = scene.hash
        asked = command.takes_depth(scene) == ""
        self._depth = (scene.depth or UNBOUNDED) if asked else UNBOUNDED
        self._seen: dict[str, int] = {}  # seeds by the image that they gave

    @property
    def identity(self) -> dict[str, str]:
        """The command line and the scene; what the program is made of, nobody knows."""
        return {"renderer": "command", "command": self._command.template, "scene": self._hash}

    @spent("program")
    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """One run of `count` samples per pixel, its seed by the replica.

        HarnessError, in one line, for a program that cannot be run, takes too long, fails, leaves no image or one of
        another size, or ignores its seed.
        """
        if start:
            raise HarnessError(f"`{self._command.name}` draws whole runs; samples from {start} on cannot be had alone")
        seed, out = replica + FIRST_SEED, self._folder / f"run-{replica}{self._command.suffix}"
        watch, before = Watch(), resource.getrusage(resource.RUSAGE_CHILDREN)
        self._run(seed, count, out)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        cost = replace(watch.cost(cpu()), cpu=spent)
        if not out.is_file():
            raise self._error("wrote no file to {out}; let it write the image there")
        image = read_image(out).pixels
        out.unlink()
        if image.shape[:2] != (self._film.height, self._film.width):
            raise self._error(f"wrote an image of {image.shape[1]} x {image.shape[0]} pixels, the scene has "
                              f"{self._film.width} x {self._film.height}; pass {{width}} and {{height}} on, or set the "
                              "size to what it renders")
        self._require_another(seed, image)
        finite = np.isfinite(image).all(axis=-1)
        rejected = int((~finite).sum()) * count
        if advance is not None:
            advance(count)
        return Batch(np.where(finite[..., None], image, 0).astype(np.float32), count, rejected, cost)

    def _require_another(self, seed: int, image: np.ndarray) -> None:
        """Any two seeds that give one image, unless it is without noise at all."""
        other = self._seen.setdefault(digest(image), seed)
        if other != seed:
            raise self._error(f"gave the same image for seeds {other} and {seed}, so its runs cannot be told apart; "
                              "let the seed reach its random numbers (an image without noise: keep one file, and "
                              "compare that)")

    def _run(self, seed: int, spp: int, out: Path) -> None:
        values = {"scene": self.scene.path, "spp": spp, "seed": seed, "out": out, "width": self._film.width,
                  "height": self._film.height, "max_depth": self._depth, **self.scene.values}
        arguments = [word.format(**values) for word in shlex.split(self._command.template)]
        with tempfile.TemporaryFile() as said:
            try:
                process = subprocess.Popen(arguments, stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                                           start_new_session=True)
            except OSError as error:
                raise self._error(f"cannot be run ({error.strerror or error}); name a program that is installed"
                                  ) from None
            try:
                status = process.wait(self._command.seconds)
            except subprocess.TimeoutExpired:
                end(process)
                raise self._error(f"took longer than {self._command.seconds:g} s and was ended; ask for fewer samples, "
                                  "or allow more time") from None
            except BaseException:  # Ctrl-C: the program has a session of its own, and would go on
                end(process)
                raise
            if status:
                ended = f"signal {-status}" if status < 0 else f"exit status {status}"
                raise self._error(f"failed with {ended}: {last_line(said)}; try `{shlex.join(arguments)}`")

    def _error(self, message: str) -> HarnessError:
        return HarnessError(f"command `{self._command.name}` {message}")
