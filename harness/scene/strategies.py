"""The strategies: how directions are drawn and how light is found; their names, and the scenes that each suits.

A strategy is a draw, by which a path goes on, and one of three ways to light: to gather what the path meets, to sample
a light at every vertex (`+nee`), or both, weighted against each other (`+mis`). `nee` and `mis` alone are those of
`mixture`. To add a draw, give it a row of `TABLE` and a branch in glsl/lib/phong.glsl.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from harness.errors import HarnessError
from harness.scene.lights import lights_sampled
from harness.scene.model import Scene, is_black

HEURISTICS = ("balance", "power")
USUAL_DRAW, USUAL_HEURISTIC = "mixture", "balance"
# In the order in which glsl/lib/mis.glsl and lib/path.glsl number them.
LIGHTS = ("met", "nee", "mis")


@dataclass(frozen=True)
class Style:
    """How figures show a strategy: colour (hexadecimal), matplotlib's marker, and a glyph that looks like it."""

    colour: str
    marker: str
    glyph: str


def _nothing(scene: Scene) -> str:
    return ""


def _diffuse_term(scene: Scene) -> str:
    if any(not is_black(shape.material.kd) for shape in scene.shapes):
        return ("lobe-only sampling never draws most directions of a diffuse term (kd > 0): it is biased and its "
                "variance is enormous")
    return ""


@dataclass(frozen=True)
class Strategy:
    """A way to draw directions and to find light.

    `draw`: of `DRAWS`. `lights`: `met` where paths gather what they meet, `nee` where emitters and the environment are
    sampled at each vertex and gathered at the first alone, `mis` where both are done, each weighted by `heuristic`
    (Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation", section 9.2). `sentence`: what it does,
    for people; `style`: how figures show it, None for one that is not in `TABLE`. `missed`: what light of a scene it
    cannot reach, in words; "" for none.
    """

    name: str
    draw: str
    lights: Literal["met", "nee", "mis"] = "met"
    heuristic: Literal["balance", "power"] = "balance"
    sentence: str = ""
    style: Style | None = None
    missed: Callable[[Scene], str] = _nothing

    @property
    def samples_lights(self) -> bool:
        """Whether vertices send rays to lights."""
        return self.lights != "met"


# What tables and options list; other draws with `+nee`, `+mis`, and the other heuristic, are strategies as well.
# Colours are those of Okabe and Ito (2008, "Color Universal Design"), told apart with any common colour blindness; the
# markers tell lines apart in greyscale.
TABLE = (
    Strategy("uniform", "uniform", sentence="every direction of the hemisphere alike",
             style=Style("#0072b2", "o", "●")),
    Strategy("cosine", "cosine", sentence="by the cosine to the normal", style=Style("#e69f00", "s", "■")),
    Strategy("phong", "phong", sentence="by the specular lobe alone: for materials without a diffuse term",
             style=Style("#cc79a7", "^", "▲"), missed=_diffuse_term),
    Strategy("lobes", "lobes", sentence="by one of the two terms at random, divided by that term's density",
             style=Style("#009e73", "D", "◆")),
    Strategy("mixture", "mixture", sentence="by one of the two terms at random, divided by the density of both",
             style=Style("#d55e00", "v", "▼")),
    Strategy("nee", USUAL_DRAW, "nee", sentence="as mixture, and every vertex sends a ray to a light, chosen by "
             "its power; light that a path meets later is not gathered (next-event estimation)",
             style=Style("#56b4e9", "P", "✚")),
    Strategy("mis", USUAL_DRAW, "mis", sentence="as nee, but both are gathered, each weighed by what the other would "
             "have found (multiple importance sampling, balance heuristic)", style=Style("#000000", "X", "✖")),
)
STRATEGIES = tuple(each.name for each in TABLE)
_BY_NAME = {each.name: each for each in TABLE}
DRAWS = tuple(each.name for each in TABLE if not each.samples_lights)


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
    if name in _BY_NAME:
        return _BY_NAME[name]
    draw, plus, way = name.partition("+")
    if name and not plus:
        draw, way = USUAL_DRAW, name
    lights, dash, heuristic = way.partition("-")
    is_way = {"nee": not dash, "mis": not dash or heuristic in HEURISTICS}.get(lights, False)
    if draw not in DRAWS or not is_way:
        raise HarnessError(f"unknown strategy '{name}'; choose from {', '.join(STRATEGIES)}, a draw with +nee or +mis "
                           "(cosine+mis), or mis-balance, mis-power")
    if lights == "mis" and draw == "lobes":
        raise HarnessError(f"'{name}': lobes divides each term by its own density and not the direction's, so there is "
                           "no density to weigh against the lights'; use mixture+mis, or lobes+nee")
    return Strategy(name, draw, lights, heuristic or USUAL_HEURISTIC,  # type: ignore[arg-type]  # checked above
                    missed=_BY_NAME[draw].missed)


def check_strategy(scene: Scene, name: str) -> Suited:
    """Judge a strategy for a scene. Raises HarnessError for an unknown name."""
    missed = parse_strategy(name).missed(scene)
    return Suited(name, not missed, missed)


def suitable_strategies(scene: Scene) -> tuple[str, ...]:
    """The strategies that reach all light of the scene, in canonical order.

    `nee` and `mis` where there are lights to sample, and not a sky of one radiance alone: there `mis` is `mixture`, and
    `nee` misses nothing but gains nothing.
    """
    names = STRATEGIES if lights_sampled(scene, "mis") else DRAWS
    return tuple(name for name in names if check_strategy(scene, name).suits)
