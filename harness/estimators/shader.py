"""Somebody's shader as an estimator: single frames on an empty past, drawn in a child process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.errors import HarnessError
from harness.progress import Advance
from harness.samples.cost import Cost, Watch, cpu
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest, digest
from harness.samples.spent import spent
from harness.samples.traits import Traits
from harness.scene.file import SceneFile
from harness.shader.contract import Contract, Law
from harness.shader.hosts import read
from harness.shader.hosts.reading import Answer
from harness.shader.named import named, with_values
from harness.strangers.law import find_law, weight_is_of_the_new, with_weight_of_the_new
from harness.strangers.process import Limits, Process
from harness.strangers.single import Encoding
from harness.strangers.state import state_pixels

# Frames of a replica. Their numbers must stay small: many a seed is a float that loses its last digits far from zero.
RUN = 1024
LIMITS = Limits()


@dataclass(frozen=True)
class Shader:
    """A shader of any host that can be read: a Gratin body or pipeline, a Shadertoy, WebGL, …

    `files`: its files, or a folder; `host`: the dialect, told by its syntax if None; `values`: what is said of its
    uniforms by name; else what is set in the scene, or besides it, reaches what has that name in the shader
    (`harness.shader.named`). `contract`: in place of what would be read from the files. One sample is one frame,
    however many paths the author traces in it. `run`: frames of a replica, the next of which begins with the number
    after them. `encoding`: what each frame is put through, to be undone before frames are averaged.
    """

    files: tuple[Path, ...]
    host: str | None = None
    values: tuple[tuple[str, Answer], ...] = ()
    contract: Contract | None = None
    run: int = RUN
    encoding: Encoding = ""
    limits: Limits = LIMITS

    @property
    def name(self) -> str:
        """The first file's."""
        return self.files[0].stem if self.files else (self.contract.radiance if self.contract else "shader")

    def read(self) -> Contract:
        """Its contract, with or without a law. ShaderError for files that are no shader, or that lack what the host
        must be told."""
        contract = self._bare()
        require_known(contract)
        return contract

    def on(self, scene: SceneFile) -> Contract:
        """Its contract with the values that are set in the scene, or besides it. Errors as `read`, and for a value that
        does not fit."""
        contract = self._bare()
        if scene.values:
            taken = set(self._named(contract))
            contract = with_values(contract, {name: text for name, text in scene.values.items() if name in taken})
        require_known(contract)
        return contract

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        """The names that are not said otherwise. ShaderError for files that are no shader."""
        return self._named(self._bare())

    def _bare(self) -> Contract:
        return self.contract or read(self.files, self.host, dict(self.values))

    def _named(self, contract: Contract) -> tuple[str, ...]:
        said = dict(self.values)
        return tuple(name for name in named(contract) if name not in said)

    def check(self, scene: SceneFile) -> str:
        """It draws what it draws; nobody knows of it which scene that is. HarnessError where the author has written
        another size in."""
        require_size(self.on(scene), scene)
        return ""

    @contextmanager
    def open(self, scene: SceneFile, process: Process | None = None) -> Iterator[ShaderRenderer]:
        """Compiles, and measures the law unless the contract has it. `process`: draws it, and goes on afterwards; if
        None one of its own, which ends. ShaderError where it does not compile or takes too long, HarnessError for a
        size that is not the author's."""
        contract = self.on(scene)
        require_size(contract, scene)
        film = scene.film
        with nullcontext(process) if process else Process(self.limits) as held:
            yield ShaderRenderer(self, contract, (film.width, film.height), held)


class ShaderRenderer:
    """Batches of single frames; frame and replica tell the number, so any can be drawn in any order."""

    traits = Traits()

    def __init__(self, estimator: Shader, contract: Contract, size: tuple[int, int], process: Process) -> None:
        self._estimator, self._process = estimator, process
        process.open(contract, size)
        if contract.law is None:
            contract = with_law(contract, size, process)
        self.contract = contract
        self.law = contract.law or Law("none")

    def state(self) -> np.ndarray:
        """(H, W): pixels that hold something of the author's own and no radiance, rows as a batch has them."""
        found = state_pixels(self._process, self.law)
        return found if self.contract.flipped else found[::-1]

    @property
    def identity(self) -> dict[str, str]:
        """The shader's whole text, its contract and size, the device, and the code that draws."""
        width, height = self._process.size
        facts = {name: str(self._process.facts[name]) for name in ("gl_renderer", "gl_version", "gl_vendor")}
        return {"renderer": "shader", "contract": digest(self.contract, 16), "size": f"{width}x{height}",
                "run": str(self._estimator.run), "encoding": self._estimator.encoding,
                "code": code_digest("harness.strangers.child"), **facts}

    @spent("shader of others")
    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """Frames start … start+count-1 of a replica. HarnessError for frames beyond the replica's own; ShaderError, in
        one line, where a frame takes too long or the driver with it."""
        run = self._estimator.run
        if count < 1 or start < 0 or start + count > run:
            raise HarnessError(f"a replica of {self._estimator.name} has {run} frames, found {count} from {start}; ask "
                               "for fewer, or for a longer run")
        watch, before = Watch(), self._process.spent
        # The first frame of all is often special; whether it is averaged rightly is not judged here.
        first = self.contract.first_frame + 1 + replica * run + start
        found = self._process.singles(self.law, range(first, first + count), encoding=self._estimator.encoding,
                                      count=0 if self.law.count == "uniform" else None)
        if advance is not None:
            advance(count)
        mean = found.mean if self.contract.flipped else found.mean[::-1]
        return Batch(mean.astype(np.float32), count, found.rejected, self._cost(watch, before))

    def _cost(self, watch: Watch, before: float) -> Cost:
        """What the child spent: the processor's seconds where that draws; a graphics card's are not measured."""
        renderer = str(self._process.facts["gl_renderer"])
        if self._process.facts["clock"] == "cpu":
            return replace(watch.cost(f"{renderer}, {cpu()}"), cpu=self._process.spent - before)
        return watch.cost(renderer, None, "gpu")


def with_law(contract: Contract, size: tuple[int, int], process: Process) -> Contract:
    """The contract with the law that is measured; the process has it open before and after."""
    found = find_law(process)
    if weight_is_of_the_new(found):
        contract = with_weight_of_the_new(contract)
        found = find_law(process.open(contract, size))
    contract = replace(found.contract, law=found.law)
    process.open(contract, size)
    return contract


def require_known(contract: Contract) -> None:
    """HarnessError where nobody knows what a uniform is for: it is asked for by its name."""
    if contract.unknown:
        first, *others = contract.unknown
        also = f" (and of {', '.join(one.name for one in others)})" if others else ""
        raise HarnessError(f"{first.where}: nobody knows what '{first.kind} {first.name}' is for{also}; say so: --set "
                           f"{first.name}=VALUE, or what it is, such as frame, time or resolution")


def require_size(contract: Contract, scene: SceneFile) -> None:
    """HarnessError where the author has written in another size than the scene's film has."""
    film = scene.film
    if contract.size and contract.size != (film.width, film.height):
        width, height = contract.size
        raise HarnessError(f"{contract.radiance}: a size of {width} x {height} is written into the shader, the film "
                           f"has {film.width} x {film.height}; give --size {width}x{height}")
