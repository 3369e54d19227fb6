"""What the gates' tests share: a scene that costs nothing, a gates file about it, and a renderer of known noise."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.estimators.base import Estimator, Renderer
from harness.estimators.tracer import Tracer
from harness.gates import Gate, load_gates
from harness.scene import SceneFile
from tests.support.fakes import NoiseRenderer

# Nothing but sky: every renderer is exact with one sample.
SKY = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="perspective"><film type="hdrfilm"><rfilter type="box"/></film></sensor>
    <emitter type="constant"><rgb name="radiance" value="0.5, 0.5, 0.5"/></emitter>
</scene>
"""
GATES = """
[defaults]
size = [40, 40]
spp = 1
replicas = 64
reference = { value = [0.5, 0.5, 0.5] }

[[gate]]
name = "sky"
scene = "sky.xml"
strategy = "cosine"
reason = "Nothing can go wrong."
"""


def write(folder: Path, gates: str = GATES) -> Path:
    """A gates file, and the scene that it names, in a folder."""
    (folder / "sky.xml").write_text(SKY, encoding="utf-8")
    path = folder / "gates.toml"
    path.write_text(gates, encoding="utf-8")
    return path


def one_gate(folder: Path, gates: str = GATES) -> Gate:
    """The only gate of that file."""
    gate, = load_gates(write(folder, gates)).gates
    return gate


@dataclass(frozen=True)
class Noise:
    """An estimator that draws normal noise of the scene's size: the relative `bias` of 0.5, the standard deviation
    `sigma` of a sample. `made`: the renderers that were opened."""

    bias: float = 0.0
    sigma: float = 0.01
    name: str = "cosine"
    made: list[NoiseRenderer] = field(default_factory=list, compare=False)

    def check(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
        film = scene.film
        self.made.append(NoiseRenderer(0.5 * (1 + self.bias), self.sigma, (film.height, film.width)))
        yield self.made[-1]


@dataclass(frozen=True)
class Opens:
    """An estimator that opens a ready renderer."""

    renderer: Renderer
    name: str = "ready"

    def check(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Renderer]:
        yield self.renderer


def judging(gate: Gate, test: Estimator | Renderer) -> Gate:
    """The gate with something else under test: an estimator, or a ready renderer."""
    return replace(gate, test=test if hasattr(test, "open") else Opens(test))  # type: ignore[arg-type]


def with_own(gate: Gate, **own: Path) -> Gate:
    """The gate with somebody's own `shader`, or `folder` of files, under test."""
    return replace(gate, test=Tracer(gate.strategy, **own))  # type: ignore[arg-type]


def small(gate: Gate, side: int) -> Gate:
    """The gate at another size."""
    return replace(gate, scene=gate.scene.sized(side, side))
