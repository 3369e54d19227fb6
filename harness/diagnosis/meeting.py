"""Questions about what a ray meets: the shape, how far off, its normal, its texture coordinates, and its light."""

from __future__ import annotations

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.questions import QUESTIONS
from harness.diagnosis.seen import Seen
from harness.diagnosis.surface import residual, shell
from harness.diagnosis.tally import Tally
from harness.diagnosis.vertex import EMISSION, ENVIRONMENT, GRAZING, NORMAL, Vertex
from harness.reference.coupled_steps import NO_HIT

# Mitsuba's cylinder is off by up to 5e-4 in float32, its quadratic cancels; the shader's by 1.4e-5.
COARSE = 50.0
# The mesh that Mitsuba has for a displaced sphere: its facets, in the measure of `distance`.
MESH = 100.0
# The outermost part of the shell about a displaced sphere, in which no ray need march where that is cut too small.
OUTERMOST = 0.94
# A normal's length is rounded once, by 1e-7: it counts so many times as much as its direction.
UNIT = 50.0
# A sphere's equation is rounded as its radius is: by half the spacing of float32 at 1, times that, beyond what is
# rounding elsewhere. In the measure of `distance`.
ROUNDED = 2.0**-24 / QUESTIONS["distance"].tolerance
# Rays that round to one another: so far apart in direction, and in origins of order one; and of how many whose answers
# differ it is asked at most whether one of those meets what the shader met.
NEAR, NEAR_RAYS = 2e-5, 64


def ask_hit(case: Case, seen: Seen, vertex: Vertex, tally: Tally) -> np.ndarray:
    """Where both met the same shape."""
    theirs, mine = vertex.theirs, vertex.shape
    distance = np.where(mine >= 0, vertex["origin"][:, 3], NO_HIT)
    missed = (theirs.shape >= 0) & (theirs.distance < distance)
    known = theirs.shape >= -1
    about = np.where(missed, theirs.shape, mine)
    outside = _outside(case, vertex, about)
    unlike = known & (mine != theirs.shape)
    tally.ask("hit", mine[known], theirs.shape[known], vertex.lanes[known], vertex=vertex.number,
              difference=unlike[known].astype(float), certain=_beyond_rounding(case, seen, vertex, unlike)[known],
              shapes=about[known], notes=[("entered wrongly", outside[known])])
    same = (mine >= 0) & (mine == theirs.shape)
    where = np.flatnonzero(same)
    of = mine[where]
    origin, t = vertex["origin"][where, :3], vertex["origin"][where, 3]
    across = np.abs(theirs.cosine[where]) / (1 + np.abs(origin).max(axis=1) + theirs.distance[where])
    apart = np.abs(t - theirs.distance[where]) * across
    slack = np.where(case.of_kind("cylinder")[of], COARSE, np.where(case.of_kind("displacedsphere")[of], MESH, 1.0))
    slack = slack + ROUNDED * case.radii()[of]
    tally.ask("distance", t, theirs.distance[where], vertex.lanes[where], vertex=vertex.number, difference=apart,
              slack=slack, shapes=of, notes=[("entered wrongly", outside[where])])
    return same


def _beyond_rounding(case: Case, seen: Seen, vertex: Vertex, unlike: np.ndarray) -> np.ndarray:
    """Of rays (N,) whose answers are `unlike`, whether no ray that rounds to them meets in Mitsuba what they met in the
    shader: then no edge explains it."""
    found = np.zeros(len(unlike), dtype=bool)
    where = np.flatnonzero(unlike)[:NEAR_RAYS]
    if not len(where):
        return found
    origin, ray = vertex["origin"][where, :3], vertex["ray"][where, :3]
    mine, theirs = vertex.shape[where], vertex.theirs.shape[where]
    near = np.full(len(where), NEAR)
    for kind, coarse in (("cylinder", COARSE), ("displacedsphere", MESH)):
        near[case.of_kind(kind)[mine] | case.of_kind(kind)[theirs]] *= coarse
    across, along = expected.frame(ray)
    origins, rays = [], []
    for size in (0.1, 1.0):
        for side in (across, -across, along, -along):
            step = side * (size * near)[:, None]
            for moved in (step, -step, 0 * step):
                origins.append(origin + moved * (1 + np.abs(origin).max(axis=1, keepdims=True)))
                rays.append(ray + step)
    start, direction = (np.concatenate(each).astype(np.float32) for each in (origins, rays))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    answers = seen.once(("near", vertex.number), lambda: case.steps.vertices(start, direction, direction).shape)
    found[where] = (answers.reshape(len(origins), -1) != mine).all(axis=0)
    return found


def _outside(case: Case, vertex: Vertex, about: np.ndarray) -> np.ndarray:
    """Of rays that should meet a displaced sphere, whether they start within its shell, or meet it at its outermost:
    what sets out on the march decides there."""
    found = np.zeros(len(about), dtype=bool)
    for shape in np.flatnonzero(case.of_kind("displacedsphere")[:-1]):
        on = about == shape
        sphere = case.scene.shapes[shape]
        found[on] = ((shell(sphere, vertex["origin"][on, :3]) < 1)
                     | (shell(sphere, vertex.theirs.point[on].astype(np.float64)) > OUTERMOST))
    return found


def ask_surface(case: Case, vertex: Vertex, same: np.ndarray, tally: Tally) -> None:
    """The way that the loop takes, the normal, and the texture coordinates."""
    hit = vertex.shape >= 0
    shaded, escaped = (vertex.called & NORMAL) != 0, (vertex.called & ENVIRONMENT) != 0
    tally.ask("branch", np.c_[shaded, escaped], np.c_[hit, ~hit], vertex.lanes, vertex=vertex.number,
              difference=((shaded != hit) | (escaped == hit)).astype(float))
    where = np.flatnonzero(same & shaded)
    of = vertex.shape[where]
    normal, theirs = vertex["turned"][where, :3], vertex.theirs.normal[where].astype(np.float64)
    slack = np.where(case.of_kind("cylinder")[of], COARSE, 1.0)
    outside = _outside(case, vertex, vertex.shape)
    for shape in np.unique(of[case.of_kind("displacedsphere")[of]]):
        on = of == shape
        found = residual(case.scene.shapes[shape], vertex["place"][where[on], :3], vertex["normal"][where[on], :3])
        tally.ask("distance", found.height, np.zeros(int(on.sum())), vertex.lanes[where[on]], vertex=vertex.number,
                  slack=found.slack, shapes=of[on], notes=[("entered wrongly", outside[where[on]])])
        theirs[on], slack[on] = normal[on] - found.normal, found.normal_slack
    long = UNIT * np.abs(np.linalg.norm(normal, axis=1) - 1) * slack
    tally.ask("normal", normal, theirs, vertex.lanes[where], vertex=vertex.number, slack=slack, shapes=of,
              difference=np.maximum(np.abs(normal - theirs).max(axis=1), long))
    met, point = vertex["met"][where, :3], vertex.theirs.point[where].astype(np.float64)
    off = np.abs(((met - point) * vertex.theirs.normal[where]).sum(axis=1)) / (1 + np.abs(point).max(axis=1))
    smooth = ~case.of_kind("displacedsphere")[of]
    tally.ask("place", met[smooth], point[smooth], vertex.lanes[where[smooth]], vertex=vertex.number,
              difference=off[smooth], slack=slack[smooth] + ROUNDED * case.radii()[of[smooth]], shapes=of[smooth])
    uses = case.has_coordinates()[of]
    where, of = where[uses], of[uses]
    apart = _uv_apart(case, vertex["surface"][where, :2], vertex.theirs.uv[where], of)
    slack = np.where(case.of_kind("cylinder")[of], COARSE, 1.0)
    tally.ask("coordinate", vertex["surface"][where, :2], vertex.theirs.uv[where], vertex.lanes[where],
              vertex=vertex.number, difference=apart, slack=slack, shapes=of)


def _uv_apart(case: Case, mine: np.ndarray, theirs: np.ndarray, of: np.ndarray) -> np.ndarray:
    """How far texture coordinates are apart: angles modulo a turn, and less where their circle is small."""
    apart = np.abs(mine - theirs)
    for kinds, angle in ((("sphere", "cylinder"), 0), (("disk",), 1)):
        round_ = case.of_kind(*kinds)[of]
        turned = np.minimum(apart[:, angle], np.abs(1 - apart[:, angle]))
        sphere = case.of_kind("sphere")[of]
        circle = np.where(sphere, np.sin(np.pi * np.clip(theirs[:, 1], 0, 1)), 1.0)
        circle = np.where(case.of_kind("disk")[of], np.clip(theirs[:, 0], 0, 1), circle)
        apart[:, angle] = np.where(round_, turned * circle, apart[:, angle])
    return np.asarray(apart.max(axis=1)) if len(apart) else np.zeros(0)


def ask_light(case: Case, vertex: Vertex, same: np.ndarray, tally: Tally) -> np.ndarray:
    """What the shader gathered, (M, 3), zero where it asked for nothing."""
    theirs = vertex.theirs
    hit = vertex.shape >= 0
    asked, wanted = (vertex.called & EMISSION) != 0, (theirs.cosine > 0) & case.emits
    clear = np.flatnonzero(same & (np.abs(theirs.cosine) > GRAZING))
    tally.ask("gathers", asked[clear], wanted[clear], vertex.lanes[clear], vertex=vertex.number,
              difference=(asked != wanted)[clear].astype(float))
    gathered = (vertex.called & (EMISSION | ENVIRONMENT)) != 0
    light = np.where(gathered[:, None], vertex["light"][:, :3], 0.0)
    both = gathered & ((same & wanted) | (~hit & (theirs.shape == -1)))
    where = np.flatnonzero(both)
    expected_light = theirs.light[where].astype(np.float64)
    scale = 1e-3 + np.abs(expected_light).max(axis=1) + case.contrast_of_light()[vertex.shape[where]]
    difference = np.abs(light[where] - expected_light).max(axis=1) / scale
    tally.ask("light", light[where], expected_light, vertex.lanes[where], vertex=vertex.number, difference=difference,
              shapes=vertex.shape[where])
    tally.note_shift("light", light[where, 0], expected_light[:, 0], vertex.shape[where])
    return light
