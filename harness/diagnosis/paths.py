"""Questions about whole paths: what main asks for, the numbers, the film, the time, the camera, and the sum."""

from __future__ import annotations

import numpy as np

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.seen import Seen
from harness.diagnosis.tally import Tally
from harness.scene.motion import moving, screw

# Where moving shapes are looked at: to_rest and from_rest of this point.
POINT = (0.7, -0.4, 1.1)
# Film points lie evenly in their pixels, by whatever numbers: so many standard errors their mean and variance may be
# off.
FILM_ERRORS = 5.0


def ask_beginning(case: Case, seen: Seen, tally: Tally) -> np.ndarray:
    """The questions before the first vertex. Returns the generator's state there, uint32 (N,)."""
    paths, look = seen.paths, seen.look
    lanes = np.arange(len(seen.observed.accumulated))
    _ask_pass(case, seen, tally, lanes)
    pixel = _pixels(case)
    begun = lanes[paths["gaze"][:, 3] > 0]
    state = expected.uint32(paths["seed"][:, 2:])
    tally.ask("index", expected.uint32(paths["seed"][:, :2])[begun],
              np.full(len(begun), look.first + look.tapped), begun)
    if "generator" not in case.own:
        stream = expected.pixel_stream(pixel[:, 0], pixel[:, 1], look.replica)
        recorded = expected.uint32(paths["stream"][:, :2]), expected.uint32(paths["stream"][:, 2:])
        tally.ask("stream", np.stack(recorded, axis=1), np.stack(stream, axis=1), lanes)
        tally.ask("seed", state[begun], expected.seed(recorded, look.first + look.tapped)[begun], begun)
        tally.ask("numbers", paths["generator"][:, :2], np.zeros((len(lanes), 2)), lanes)
    if not len(begun):
        return state
    _ask_film(case, paths["film"], pixel, state, tally, begun)
    if case.moves:
        _ask_time(case, paths["time"], state, tally, begun)
        _ask_pose(case, seen, tally, begun)
    rays = seen.once("camera", lambda: case.steps.camera(paths["film"][begun, :2], paths["film"][begun, 2:]))
    eye, gaze = paths["eye"][begun], paths["gaze"][begun, :3]
    reach = np.abs(eye[:, 3] - rays.reach) / rays.reach
    # The near plane of a distant camera may be moved up to the scene: its place is rounded as the camera's own is.
    far = np.abs(case.scene.camera.matrix[:3, 3]).max()
    apart = np.abs(eye[:, :3] - rays.origin).max(axis=1) / (1 + np.maximum(np.abs(rays.origin).max(axis=1), far))
    tally.ask("camera", np.c_[eye, gaze], np.c_[rays.origin, rays.reach, rays.direction], begun,
              difference=np.maximum.reduce([np.abs(gaze - rays.direction).max(axis=1), apart, 0.2 * reach]))
    return expected.advance(state, case.before_scattering)


def ask_end(case: Case, seen: Seen, before: np.ndarray, gathered: np.ndarray, tally: Tally) -> None:
    """The questions about the sum. `before`: what the pass's samples before the tapped one leave by themselves, (N, 4);
    `gathered`: light times weights of the tapped path, (N, 3)."""
    paths, look = seen.paths, seen.look
    lanes = np.arange(len(gathered))
    given, returned = paths["given"].astype(np.float64), paths["returned"].astype(np.float64)
    finite = np.isfinite(gathered).all(axis=1) & (before[:, 3] == look.tapped)
    tally.ask("counted", returned[finite, 3] - given[finite, 3], np.full(int(finite.sum()), look.samples),
              lanes[finite], vertex=case.scene.max_depth)
    if "loop" not in case.own:
        counted = finite & (returned[:, 3] - given[:, 3] == look.samples)
        whole = given[:, :3] + before[:, :3] + gathered
        tally.ask("radiance", returned[counted, :3], whole[counted], lanes[counted], vertex=case.scene.max_depth,
                  difference=(np.abs(returned[:, :3] - whole).max(axis=1)
                              / (0.01 + np.abs(whole).max(axis=1)))[counted])
    known = paths["finite"][:, 3] > 0
    tally.ask("finite", paths["finite"][known, :3], np.array([[0.0, 0.0, 1.0]] * int(known.sum())).reshape(-1, 3),
              lanes[known])


def _ask_pass(case: Case, seen: Seen, tally: Tally, lanes: np.ndarray) -> None:
    """The sum that is handed on must be the previous pass's, or nothing; the samples those that were asked for."""
    look = seen.look
    given = look.previous.reshape(-1, 4) if look.number else np.zeros((len(lanes), 4))
    asked = seen.paths["asked"]
    first = expected.uint32(asked[:, :2]).astype(np.float64)
    size = np.array([case.scene.width, case.scene.height])
    mine = np.c_[first, asked[:, 2:], seen.paths["given"], seen.paths["pixel"], seen.observed.accumulated]
    theirs = np.c_[np.full(len(lanes), look.first), np.full(len(lanes), look.replica),
                   np.full(len(lanes), look.samples), given, _pixels(case), np.tile(size, (len(lanes), 1)),
                   seen.paths["returned"]]
    same = (mine == theirs) | (np.isnan(mine) & np.isnan(theirs))
    tally.ask("pass", mine, theirs, lanes, difference=(~same).any(axis=1).astype(float))


def _ask_film(case: Case, film: np.ndarray, pixel: np.ndarray, state: np.ndarray, tally: Tally,
              lanes: np.ndarray) -> None:
    size = np.array([case.scene.width, case.scene.height])
    if case.own & {"generator", "loop"}:
        inside = film[lanes, :2].astype(np.float64) * size - pixel[lanes]
        slack = 1e-6 * size.max()
        outside = ((inside < -slack) | (inside > 1 + slack)).any(axis=1)
        count = max(len(lanes), 1)
        # Of uniform numbers: variance 1/12, and that of their squared deviations 1/180.
        off = np.maximum(np.abs(inside.mean(axis=0) - 0.5) / np.sqrt(1 / 12 / count),
                         np.abs(((inside - 0.5)**2).mean(axis=0) - 1 / 12) / np.sqrt(1 / 180 / count))
        uneven = bool((off > FILM_ERRORS).any())
        tally.ask("film", inside, np.full_like(inside, 0.5), lanes, difference=(outside | uneven).astype(float))
        return
    numbers = [expected.number(expected.advance(state, step)) for step in range(4)]
    points = (pixel + np.stack(numbers[:2], axis=1)) / size
    lens = np.stack(numbers[2:], axis=1) if case.has_lens else np.zeros_like(points)
    tally.ask("film", film[lanes], np.c_[points, lens][lanes], lanes)


def _ask_time(case: Case, times: np.ndarray, state: np.ndarray, tally: Tally, lanes: np.ndarray) -> None:
    opens, closes = case.scene.camera.shutter
    if not case.own & {"generator", "loop"}:
        number = expected.number(expected.advance(state, case.before_scattering - 1))
        tally.ask("time", times[lanes][:, [0, 2]], np.c_[number, np.ones_like(number)][lanes], lanes)
    else:
        tally.ask("time", times[lanes, 2], np.ones(len(lanes)), lanes)
    moment = opens + (closes - opens) * times[lanes, 0].astype(np.float64)
    tally.ask("moment", times[lanes, 1], moment, lanes, slack=max(abs(opens), abs(closes)))


def _ask_pose(case: Case, seen: Seen, tally: Tally, lanes: np.ndarray) -> None:
    """All paths of the look see one moment, so any of them tells where the shapes are."""
    opens, closes = case.scene.camera.shutter
    look = seen.look
    assert look.moment is not None
    for shape in moving(case.scene):
        motion = case.scene.shapes[shape].motion
        assert motion is not None
        pose = screw(motion).pose(opens + (closes - opens) * float(np.float32(look.moment)))
        posed = seen.once(("pose", shape), lambda shape=shape: case.tap.observe(look, shape, POINT).paths)  # type: ignore[misc]
        turn, shift = pose[:3, :3], pose[:3, 3]
        rest, turned = (np.array(POINT) - shift) @ turn, turn @ np.array(POINT)
        for word, mine, theirs in (("to_rest", "pose", rest), ("from_rest", "pose_normal", turned)):
            found = posed[mine][lanes, :3]
            tally.ask("pose", found, np.tile(theirs, (len(lanes), 1)), lanes,
                      slack=1 + float(np.abs(np.r_[POINT, shift]).max()), shapes=np.full(len(lanes), shape),
                      notes=[(word, np.ones(len(lanes), dtype=bool))])


def _pixels(case: Case) -> np.ndarray:
    """Of each path, its pixel, (N, 2), (0, 0) at the bottom left."""
    width, height = case.scene.width, case.scene.height
    y, x = np.divmod(np.arange(width * height), width)
    return np.stack([x, height - 1 - y], axis=1)
