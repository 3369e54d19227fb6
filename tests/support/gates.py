"""What the gates' tests share: a scene that costs nothing, a gates file about it, and a renderer of known noise."""

from __future__ import annotations

from pathlib import Path

from harness.estimators.base import Renderer
from harness.gates import Gate, load_gates
from harness.scene import Scene
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


class Noise:
    """Makes renderers of the gate's size: the relative `bias` of 0.5, the standard deviation `sigma` of a sample."""

    def __init__(self, bias: float = 0.0, sigma: float = 0.01) -> None:
        self.bias, self.sigma = bias, sigma
        self.made: list[NoiseRenderer] = []

    def __call__(self, gate: Gate, scene: Scene) -> Renderer:
        self.made.append(NoiseRenderer(0.5 * (1 + self.bias), self.sigma, (scene.height, scene.width)))
        return self.made[-1]
