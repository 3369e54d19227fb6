"""The strategies by which directions are drawn: their names, and the scenes that each suits."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import HarnessError
from harness.scene.model import Scene, is_black

STRATEGIES = ("uniform", "cosine", "phong", "lobes", "mixture")


@dataclass(frozen=True)
class Strategy:
    """Whether a strategy reaches all light of a scene; `warning` says what it misses."""

    name: str
    suits: bool
    warning: str = ""


def check_strategy(scene: Scene, name: str) -> Strategy:
    """Judge a strategy for a scene. Raises HarnessError for an unknown name."""
    if name not in STRATEGIES:
        raise HarnessError(f"unknown strategy '{name}'; choose from {', '.join(STRATEGIES)}")
    if name == "phong" and any(not is_black(shape.material.kd) for shape in scene.shapes):
        return Strategy(name, False, "lobe-only sampling never draws most directions of a diffuse term (kd > 0): "
                                     "it is biased and its variance is enormous")
    return Strategy(name, True)


def suitable_strategies(scene: Scene) -> tuple[str, ...]:
    """The strategies that reach all light of the scene, in canonical order."""
    return tuple(name for name in STRATEGIES if check_strategy(scene, name).suits)
