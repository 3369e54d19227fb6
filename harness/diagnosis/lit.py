"""Questions about light sampling at the vertices of paths: which light, which way, how likely, and what it weighs.

Each function of the library is asked by itself, at the positions, normals and materials that the taps recorded, with
numbers of its own; the answer is compared with what its definition says (`diagnosis.expected_lights`), with Mitsuba's,
or with what the library's other functions said of the same vertex, where it only puts their answers together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.diagnosis import expected, expected_lights
from harness.diagnosis.case import Case
from harness.diagnosis.questions import QUESTIONS
from harness.diagnosis.seen import Seen
from harness.diagnosis.tally import Tally
from harness.diagnosis.vertex import GRAZING, SCATTER
from harness.gpu.lit import LitVertices, light_answers
from harness.reference.coupled_steps import Vertices
from harness.scene.lights import ENVIRONMENT, Light, lights_sampled
from harness.scene.model import EnvironmentMap
from harness.scene.motion import screw
from harness.scene.strategies import Strategy

# The part of the way to a point drawn on a light from which on what is met is the light: lib/lights.glsl.
NEARLY = 0.9999
# Cosines at a light below this amplify the rounding of where it is met.
STEEP = 0.02
# How far a unit vector's length may be off.
UNIT = 1e-4


@dataclass(frozen=True, eq=False)
class Lit:
    """The answers of N vertices: `at`, their places; `lanes`, `numbers`: the path and the vertex each is of. `said`
    (N, 64): see `light_answers`; `theirs`: what Mitsuba's ray to the light meets; `sky`: of each, direction and density
    that the environment's draw should have."""

    how: Strategy
    lights: tuple[Light, ...]
    at: LitVertices
    lanes: np.ndarray
    numbers: np.ndarray
    said: np.ndarray
    theirs: Vertices
    sky: tuple[np.ndarray, np.ndarray]

    def output(self, part: int, number: int) -> np.ndarray:
        """One vec4 of each vertex, (N, 4)."""
        first = 32 * part + 4 * number
        return self.said[:, first:first + 4]


def observe(case: Case, how: Strategy, seen: Seen) -> Lit | None:
    """The answers of the library at the vertices of a look; None where no path scatters, or where the library has other
    functions than ours."""
    found = _vertices(case, seen)
    if found is None:
        return None
    at, lanes, numbers = found
    look = seen.look
    said = light_answers(case.steps.reading, how.name, case.library, at, look.moment or 0.0)
    if said is None:
        return None
    said = said.astype(np.float64)
    if look.moment is not None:
        opens, closes = case.scene.camera.shutter
        case.steps.move(opens + (closes - opens) * float(np.float32(look.moment)))
    way = np.nan_to_num(said[:, 8:11], posinf=0, neginf=0).astype(np.float32)
    theirs = case.steps.vertices(at.origin, way, way)
    return Lit(how, lights_sampled(case.scene, how.lights), at, lanes, numbers, said, theirs,
               _sky(case, how, at, said, way))


def _vertices(case: Case, seen: Seen) -> tuple[LitVertices, np.ndarray, np.ndarray] | None:
    """Where paths of the look scatter."""
    kept: list[dict[str, np.ndarray]] = []
    lanes, numbers = [], []
    for number in range(case.scene.max_depth):
        records = seen.vertex(number)
        on = np.flatnonzero((seen.paths["gaze"][:, 3] > number) & (records["normal"][:, 3].astype(int) & SCATTER != 0)
                            & np.isfinite(records["facing"][:, :3]).all(axis=1))
        kept.append({name: records[name][on] for name in ("met", "lifted", "facing", "ray", "diffuse", "glossy")})
        lanes.append(on)
        numbers.append(np.full(len(on), number))
    whole = {name: np.concatenate([each[name] for each in kept]) for name in kept[0]}
    if not len(whole["met"]):
        return None
    normal, met = whole["facing"][:, :3], whole["met"][:, :3]
    offset = met + normal * (8.94e-5 * (1 + np.abs(met).max(axis=1)))[:, None]
    origin = np.where(whole["lifted"][:, 3:] > 0, whole["lifted"][:, :3], offset).astype(np.float32)
    at = LitVertices(origin, normal, -whole["ray"][:, :3], whole["diffuse"][:, :3], whole["glossy"][:, :3],
                     whole["diffuse"][:, 3], whole["glossy"][:, 3], np.arange(len(met), dtype=np.float32))
    return at, np.concatenate(lanes), np.concatenate(numbers)


def _sky(case: Case, how: Strategy, at: LitVertices, said: np.ndarray,
         way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    numbers = said[:, 32:36]
    if isinstance(case.scene.environment, EnvironmentMap):
        return case.steps.sky(numbers[:, 1:], way, compensated=how.lights == "mis")
    normal = at.normal.astype(np.float64)
    drawn = expected.about(normal, *expected.frame(normal), np.sqrt(1 - numbers[:, 2]), numbers[:, 3])
    return drawn, np.maximum((normal * way).sum(axis=1), 0) / np.pi


def ask(case: Case, lit: Lit, tally: Tally) -> None:
    """All questions, those about a vertex in their order."""
    with np.errstate(all="ignore"):
        for number in np.unique(lit.numbers):
            on = lit.numbers == number
            _ask_light(case, lit, on, int(number), tally)
            _ask_surface(case, lit, on, int(number), tally)
            _ask_met(case, lit, on, int(number), tally)
            _ask_together(case, lit, on, int(number), tally)


def _ask_light(case: Case, lit: Lit, on: np.ndarray, number: int, tally: Tally) -> None:
    """The light, the direction, its density, and the least distance."""
    chances = np.array([light.chance for light in lit.lights])
    shapes = np.array([light.shape for light in lit.lights])
    edges = np.cumsum(chances)[:-1]
    numbers, light, chance = lit.output(1, 0), lit.output(0, 3)[:, 0], lit.output(0, 3)[:, 1]
    which = np.searchsorted(edges, numbers[:, 0], side="right")
    firm = on & (np.abs(numbers[:, :1] - edges).min(axis=1, initial=1.0) > 1e-6)
    _ask(tally, "chosen", lit, firm, number, np.c_[light, chance], np.c_[shapes[which], chances[which]],
         np.where(light == shapes[which], np.abs(chance / chances[which] - 1), np.inf), light)
    for index in shapes:
        rows = firm & (light == index)
        if rows.any():
            _ask_towards(case, lit, rows, int(index), number, tally)


def _ask_towards(case: Case, lit: Lit, rows: np.ndarray, index: int, number: int, tally: Tally) -> None:
    direction, pdf, least = lit.output(0, 2)[:, :3], lit.output(0, 2)[:, 3], lit.output(0, 3)[:, 2]
    if index == ENVIRONMENT:
        wanted, density, distance = *lit.sky, np.zeros(len(pdf))
        firm = rows
        lit_up = density > 0
    else:
        turn, shift = _pose(case, lit, index)
        at = (lit.at.origin[rows] - shift) @ turn
        found = expected_lights.towards(case.scene.shapes[index], at, lit.output(1, 0)[rows, 2:])
        wanted, density, distance = np.zeros((len(pdf), 3)), np.zeros(len(pdf)), np.zeros(len(pdf))
        firm = np.zeros(len(pdf), dtype=bool)
        wanted[rows], density[rows], distance[rows], firm[rows] = (found.direction @ turn.T, found.density,
                                                                   found.distance, found.firm)
        lit_up = density > 0
    length = np.abs(np.linalg.norm(direction, axis=1) - 1)
    _ask(tally, "aimed", lit, firm & lit_up, number, direction, wanted, np.abs(direction - wanted).max(axis=1),
         np.full(len(pdf), index), [("towards", length > UNIT)])
    _ask(tally, "light pdf", lit, firm, number, pdf, density, np.abs(pdf - density) / (0.01 + density),
         np.full(len(pdf), index))
    _ask(tally, "least", lit, firm & lit_up, number, least, NEARLY * distance,
         np.abs(least - NEARLY * distance) / np.where(distance > 0, distance, 1), np.full(len(pdf), index))


def _pose(case: Case, lit: Lit, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Turn (3, 3) and shift (3,) of a shape at the moment of the look."""
    motion = case.scene.shapes[index].motion
    moment = case.kept[0].look.moment
    if motion is None or moment is None:
        return np.eye(3), np.zeros(3)
    opens, closes = case.scene.camera.shutter
    pose = screw(motion).pose(opens + (closes - opens) * float(np.float32(moment)))
    return pose[:3, :3], pose[:3, 3]


def _density(case: Case, lit: Lit, direction: np.ndarray) -> np.ndarray:
    """With which the strategy draws directions."""
    at, drawn = lit.at, case.drawn
    normal = at.normal.astype(np.float64)
    cosine = np.maximum((normal * direction).sum(axis=1), 0) / np.pi
    lobe = expected.lobe_pdf((expected.mirrored(normal, at.viewer) * direction).sum(axis=1), at.alpha)
    share = at.p_glossy.astype(np.float64)
    found = {"uniform": np.full(len(cosine), 0.5 / np.pi), "cosine": cosine, "phong": lobe}
    return found.get(drawn, (1 - share) * cosine + share * lobe)


def _ask_surface(case: Case, lit: Lit, on: np.ndarray, number: int, tally: Tally) -> None:
    """What the surface reflects of a light, and with which density it draws a direction."""
    at, direction = lit.at, lit.output(0, 2)[:, :3]
    normal = at.normal.astype(np.float64)
    above = on & ((normal * direction).sum(axis=1) > GRAZING)
    above &= np.abs(np.linalg.norm(direction, axis=1) - 1) < UNIT
    lobe = expected.lobe_pdf((expected.mirrored(normal, at.viewer) * direction).sum(axis=1), at.alpha)
    wanted = expected.brdf(at.kd.astype(np.float64), at.ks.astype(np.float64), lobe)
    found, inner = lit.output(0, 4)[:, :3], lit.output(1, 6)[:, :3]
    scale = 0.01 + wanted.max(axis=1)
    off = np.abs(inner - wanted).max(axis=1) / scale > QUESTIONS["reflected"].tolerance
    _ask(tally, "reflected", lit, above, number, found, wanted, np.abs(found - wanted).max(axis=1) / scale,
         None, [("eval_phong", off)])
    if lit.how.lights != "mis":
        return
    drawn = lit.output(1, 4)
    for name, pdf, itself, way in (("bsdf pdf", lit.output(0, 3)[:, 3], lit.output(0, 4)[:, 3], direction),
                                   ("bsdf pdf", lit.output(1, 5)[:, 0], lit.output(1, 5)[:, 1], drawn[:, :3]),
                                   ("drawn pdf", drawn[:, 3], lit.output(1, 5)[:, 1], drawn[:, :3])):
        density = _density(case, lit, way)
        rows = on & ((normal * way).sum(axis=1) > GRAZING) & (np.abs(np.linalg.norm(way, axis=1) - 1) < UNIT)
        off = np.abs(itself - density) / (0.01 + density) > QUESTIONS[name].tolerance
        _ask(tally, name, lit, rows, number, pdf, density, np.abs(pdf - density) / (0.01 + density), None,
             [("pdf_phong", off)])
    own, other = lit.output(0, 3)[:, 1] * lit.output(0, 2)[:, 3], lit.output(0, 3)[:, 3]
    a, b = (own**2, other**2) if lit.how.heuristic == "power" else (own, other)
    rows = on & (own > 0) & (other > 0) & np.isfinite(a + b)
    found, wanted = np.c_[lit.output(0, 6)[:, 3], lit.output(0, 7)[:, 3]], np.c_[a / (a + b), b / (a + b)]
    _ask(tally, "heuristic", lit, rows, number, found, wanted, np.abs(found - wanted).max(axis=1), None)


def _ask_met(case: Case, lit: Lit, on: np.ndarray, number: int, tally: Tally) -> None:
    """What the light sends back, and with which density it is sampled where a ray has met it."""
    light, met = lit.output(0, 3)[:, 0], lit.output(0, 5)
    shape, t, facing = met[:, 0], met[:, 1], met[:, 2]
    way = lit.output(0, 2)[:, :3]
    unit = np.abs(np.linalg.norm(way, axis=1) - 1) < UNIT
    sent = lit.output(0, 6)[:, :3]
    same = on & unit & (shape == light) & (lit.theirs.shape == light) & ((facing > STEEP) | (shape < 0))
    wanted = lit.theirs.light.astype(np.float64)
    scale = 1e-3 + np.abs(wanted).max(axis=1) + case.contrast_of_light()[light.astype(int)]
    _ask(tally, "sent", lit, same, number, sent, wanted, np.abs(sent - wanted).max(axis=1) / scale, light)
    if lit.how.lights != "mis":
        return
    for each in lit.lights:
        rows = on & unit & (shape == each.shape) & ((facing > STEEP) | (shape < 0))
        if not rows.any():
            continue
        if each.shape == ENVIRONMENT:
            density = lit.sky[1]
        else:
            turn, shift = _pose(case, lit, each.shape)
            density = expected_lights.density(case.scene.shapes[each.shape], (lit.at.origin - shift) @ turn, t, facing)
        wanted, found = each.chance * density, met[:, 3]
        _ask(tally, "met pdf", lit, rows, number, found, wanted, np.abs(found - wanted) / (0.01 + wanted),
             np.full(len(found), each.shape))


def _ask_together(case: Case, lit: Lit, on: np.ndarray, number: int, tally: Tally) -> None:
    """Whether aim_at_light and light_reached make of the other functions' answers what they should."""
    ray, weight = lit.output(0, 0), lit.output(0, 1)
    found, chosen, answer = lit.output(0, 2), lit.output(0, 3), lit.output(0, 4)
    cosine = (lit.at.normal * found[:, :3]).sum(axis=1)
    pdf = chosen[:, 1] * found[:, 3]
    lit_up = (cosine > 0) & (pdf > 0)
    whole = np.where(lit_up[:, None], answer[:, :3] * np.where(lit_up, cosine / pdf, 0)[:, None], 0.0)
    whole *= lit.output(0, 6)[:, 3:] if lit.how.lights == "mis" else 1.0
    mine, theirs = np.c_[weight[:, :3], ray, weight[:, 3]], np.c_[whole, found[:, :3], chosen[:, 0], chosen[:, 2]]
    apart = np.abs(mine - theirs)
    apart[:, :3] /= 0.01 + np.abs(whole).max(axis=1, keepdims=True)
    apart[:, 7] /= 1 + np.abs(theirs[:, 7])
    _ask(tally, "light weight", lit, on & (np.abs(cosine) > GRAZING) & np.isfinite(theirs).all(axis=1), number, mine,
         theirs, apart.max(axis=1), chosen[:, 0])
    met, sent = lit.output(0, 5), lit.output(0, 6)[:, :3]
    counts = (met[:, 0] == chosen[:, 0]) & (met[:, 1] >= chosen[:, 2])
    wanted = np.where(counts[:, None], sent, 0.0)
    scale = 0.01 + np.abs(sent).max(axis=1)
    parts = [np.abs(lit.output(0, 7)[:, :3] - wanted).max(axis=1) / scale, np.abs(lit.output(1, 1)[:, :3]).max(axis=1),
             np.where(chosen[:, 2] > 0, np.abs(lit.output(1, 2)[:, :3]).max(axis=1), 0),
             np.abs(lit.output(1, 3)[:, :3]).max(axis=1) / scale]
    _ask(tally, "shadow", lit, on & np.isfinite(found).all(axis=1), number, lit.output(0, 7)[:, :3], wanted,
         np.maximum.reduce(parts), chosen[:, 0])


def _ask(tally: Tally, name: str, lit: Lit, rows: np.ndarray, number: int, mine: np.ndarray, theirs: np.ndarray,
         difference: np.ndarray, shapes: np.ndarray | None, notes: list[tuple[str, np.ndarray]] | None = None) -> None:
    """Ask of some vertices."""
    tally.ask(name, mine[rows], theirs[rows], lit.lanes[rows], vertex=number, difference=difference[rows],
              shapes=None if shapes is None else shapes[rows].astype(int),
              notes=[(word, holds[rows]) for word, holds in notes or []])
