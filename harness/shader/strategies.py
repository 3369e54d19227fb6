"""The strategies: how directions are drawn and how light is found; their names, and the scenes that each suits.

A strategy is a draw of `DRAWS`, by which a path goes on, and one of three ways to light: to gather what the path
meets, to sample a light at every vertex (`+nee`), or both, weighted against each other (`+mis`). `nee` and `mis` alone
are those of `mixture`. To add a draw, give it a name here and a branch in glsl/lib/phong.glsl.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from harness.errors import HarnessError
from harness.scene.lights import lights_sampled
from harness.scene.model import Scene, is_black

DRAWS = ("uniform", "cosine", "phong", "lobes", "mixture")
# What tables and options list; other draws with `+nee`, `+mis`, and the other heuristic, are strategies as well.
STRATEGIES = (*DRAWS, "nee", "mis")
HEURISTICS = ("balance", "power")
USUAL_DRAW, USUAL_HEURISTIC = "mixture", "balance"
# In the order in which glsl/lib/mis.glsl and lib/path.glsl number them.
LIGHTS = ("met", "nee", "mis")


@dataclass(frozen=True)
class Strategy:
    """A way to draw directions and to find light.

    `draw`: of `DRAWS`. `lights`: `met` where paths gather what they meet, `nee` where emitters and the environment are
    sampled at each vertex and gathered at the first alone, `mis` where both are done, each weighted by `heuristic`
    (Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation", section 9.2).
    """

    name: str
    draw: str
    lights: Literal["met", "nee", "mis"] = "met"
    heuristic: Literal["balance", "power"] = "balance"

    @property
    def samples_lights(self) -> bool:
        """Whether vertices send rays to lights."""
        return self.lights != "met"


@dataclass(frozen=True)
class Suited:
    """Whether a strategy reaches all light of a scene; `warning` says what it misses."""

    name: str
    suits: bool
    warning: str = ""


def parse_strategy(name: str) -> Strategy:
    """The strategy of a name: one of `STRATEGIES`, or DRAW+nee, DRAW+mis; a mis may end in -balance or -power.

    HarnessError for a name that is none, and for one that cannot be: `lobes` with mis.
    """
    draw, plus, way = name.partition("+")
    if name and not plus and name not in DRAWS:
        draw, way = USUAL_DRAW, name
    lights, dash, heuristic = way.partition("-")
    is_way = {"": not plus and not dash, "nee": not dash, "mis": not dash or heuristic in HEURISTICS}.get(lights, False)
    if draw not in DRAWS or not is_way:
        raise HarnessError(f"unknown strategy '{name}'; choose from {', '.join(STRATEGIES)}, a draw with +nee or +mis "
                           "(cosine+mis), or mis-balance, mis-power")
    if lights == "mis" and draw == "lobes":
        raise HarnessError(f"'{name}': lobes divides each term by its own density and not the direction's, so there is "
                           "no density to weigh against the lights'; use mixture+mis, or lobes+nee")
    return Strategy(name, draw, lights or "met", heuristic or USUAL_HEURISTIC)  # type: ignore[arg-type]  # checked


def check_strategy(scene: Scene, name: str) -> Suited:
    """Judge a strategy for a scene. Raises HarnessError for an unknown name."""
    found = parse_strategy(name)
    if found.draw == "phong" and any(not is_black(shape.material.kd) for shape in scene.shapes):
        return Suited(name, False, "lobe-only sampling never draws most directions of a diffuse term (kd > 0): "
                                   "it is biased and its variance is enormous")
    return Suited(name, True)


def suitable_strategies(scene: Scene) -> tuple[str, ...]:
    """The strategies that reach all light of the scene, in canonical order.

    `nee` and `mis` where there are lights to sample, and not a sky of one radiance alone: there `mis` is `mixture`, and
    `nee` misses nothing but gains nothing.
    """
    names = STRATEGIES if lights_sampled(scene, "mis") else DRAWS
    return tuple(name for name in names if check_strategy(scene, name).suits)
