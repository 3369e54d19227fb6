"""Questions about a vertex: its ray, what that meets, how it looks, and where the path goes from there."""

from __future__ import annotations

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.meeting import ask_hit, ask_light, ask_surface
from harness.diagnosis.scattering import ask_sampling, ask_scattering
from harness.diagnosis.seen import Seen
from harness.diagnosis.tally import Tally
from harness.diagnosis.vertex import SCATTER, Progress, Vertex
from harness.diagnosis.weights import ask_weight
from harness.reference.coupled_steps import NO_HIT, Vertices

# How far an origin may be lifted off the surface, in units of 1 + its largest coordinate: Mitsuba's offset is 8.94e-5.
# A quarter of it meets its own surface again, twice as much leaks light past contacts.
LEAST_LIFT, MOST_LIFT = 0.5 * 8.94e-5, 2.0 * 8.94e-5
# An offset may also cover what float32 knows of a long ray's end: so much of its length, eight units in the last place.
LONG_RAY = 8 * 2.0**-24


def ask_vertex(case: Case, seen: Seen, number: int, progress: Progress, tally: Tally) -> None:
    """All questions about vertex `number` of the paths that reach it."""
    lanes = np.flatnonzero(seen.paths["gaze"][:, 3] > number)
    if not len(lanes):
        return
    records = {name: values[lanes] for name, values in seen.vertex(number).items()}
    theirs = seen.once(("vertices", number), lambda: case.steps.vertices(
        records["origin"][:, :3], records["ray"][:, :3], records["direction"][:, :3]))
    vertex = Vertex(number, lanes, records, _within_reach(theirs, records["place"][:, 3]),
                     records["ray"][:, 3].astype(int), records["normal"][:, 3].astype(int))
    _ask_ray(case, seen, vertex, progress, tally)
    same = ask_hit(case, seen, vertex, tally)
    ask_surface(case, vertex, same, tally)
    light = ask_light(case, vertex, same, tally)
    progress.radiance[lanes] += progress.throughput[lanes] * light.astype(np.float32)
    scattered = ask_scattering(case, vertex, same, progress, tally)
    ask_sampling(case, vertex, scattered, tally)
    ask_weight(case, vertex, scattered, tally)
    drew = (vertex.called & SCATTER) != 0
    weight = np.where(drew[:, None], records["weight"][:, :3], 0).astype(np.float32)
    progress.throughput[lanes] *= weight
    taken = np.where(drew, records["direction"][:, 3], 0).astype(int)
    progress.taken[lanes] += taken
    for steps in np.unique(taken[taken > 0]):
        those = lanes[taken == steps]
        progress.state[those] = expected.advance(expected.uint32(seen.vertex(number)["states"][those, :2]), steps)
    progress.direction[lanes], progress.met[lanes] = records["direction"][:, :3], records["met"][:, :3]
    progress.lifted[lanes], progress.normal[lanes] = records["lifted"][:, :3], records["facing"][:, :3]
    if "loop" not in case.own:
        goes = drew & (progress.throughput[lanes] != 0).any(axis=1)
        further = seen.paths["gaze"][lanes, 3] > number + 1
        tally.ask("goes on", further, goes, lanes, vertex=number, difference=(further != goes).astype(float))


def _within_reach(theirs: Vertices, reach: np.ndarray) -> Vertices:
    """Mitsuba's ray has no end; what lies beyond the shader's is not met."""
    beyond = theirs.distance > reach * (1 + 1e-5)
    theirs.shape[beyond & (theirs.shape >= 0)] = -2  # nor is what Mitsuba gathers there what is gathered
    return theirs


def _ask_ray(case: Case, seen: Seen, vertex: Vertex, progress: Progress, tally: Tally) -> None:
    """Whether the ray is the one that the camera made, or that was scattered, and starts where it should."""
    lanes, origin, reach = vertex.lanes, vertex["origin"][:, :3], vertex["place"][:, 3]
    if vertex.number == 0:
        eye, gaze = seen.paths["eye"][lanes], seen.paths["gaze"][lanes, :3]
        tally.ask("arguments", np.c_[origin, vertex["ray"][:, :3], reach], np.c_[eye[:, :3], gaze, eye[:, 3]], lanes,
                  difference=np.maximum(np.abs(origin - eye[:, :3]).max(axis=1), np.abs(reach - eye[:, 3])))
        return
    before = vertex.number - 1
    tally.ask("arguments", reach, np.full(len(lanes), NO_HIT), lanes, vertex=before,
              difference=(reach < 0.99 * NO_HIT).astype(float))
    place, normal = progress.met[lanes], progress.normal[lanes]
    unit = 1 + np.abs(place).max(axis=1)
    if "loop" not in case.own:
        apart = np.abs(vertex["ray"][:, :3] - progress.direction[lanes]).max(axis=1)
        asked = seen.vertex(before)["lifted"][lanes, 3] > 0
        moved = np.abs(origin - progress.lifted[lanes]).max(axis=1) / unit
        tally.ask("origin", np.c_[origin, vertex["ray"][:, :3]],
                  np.c_[np.where(asked[:, None], progress.lifted[lanes], origin), progress.direction[lanes]], lanes,
                  vertex=before, difference=np.maximum(apart, np.where(asked, moved, 0)))
        start = np.where(asked[:, None], progress.lifted[lanes], origin)
    else:
        start = origin
    lift = ((start - place) * normal).sum(axis=1) / unit
    aside = np.abs(start - place - normal * (lift * unit)[:, None]).max(axis=1) / unit
    most = MOST_LIFT + LONG_RAY * seen.vertex(before)["origin"][lanes, 3] / unit
    outside = (lift < LEAST_LIFT) | (lift > most) | (aside > most)
    tally.ask("offset", lift, np.clip(lift, LEAST_LIFT, most), lanes, vertex=before,
              difference=outside.astype(float))
