"""Shapes that move, for Mitsuba, which has none: batches that average still scenes over the shutter's interval.

Sample k of replica r sees the scene at the time `open + (close - open) tent(frac(φ(⌊k/4⌋) + s_r))`: φ is the radical
inverse in base 2 (van der Corput 1935), s_r a uniform random shift of the replica's own (Cranley & Patterson 1976), and
tent(u) = 1 - |2u - 1| (the baker's transformation, Hickernell 2002): the last moment meets the first, so that the shift
costs no accuracy at the ends. Four samples share a moment, since moving shapes takes as long as drawing as many
(where they are huge meshes, 32 do).

- Unbiased: whatever k, the time is uniform over the interval, so a batch's expectation is the integral over time.
- Replicas are independent: their shifts are, and their seeds.
- A sample depends on its replica and number only, so prefixes of a run are runs.
- 4 n samples from a multiple of 4 n, n a power of two, see one moment in each of n equal parts of the interval (as the
  tent folds it): the batches of the store from 8 samples on. What is left of the error in time differs from batch to
  batch, and so counts in the variance by batch means; but all batches together interleave their moments, so that in
  their mean most of it cancels. Batch means overstate it, which is the safe side. A disk that flies through the view,
  free of all other noise, in 2048 samples: standard error of the image's mean 1.1e-4 of itself over replicas, 1.0e-3 by
  batch means; of a pixel that is covered or not, 0.0010 and 0.0038, where 2048 independent times give 0.0062.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.scene import Scene
from harness.scene.motion import moving, screw

# Moving the shapes of a scene and launching a kernel take about as long as this many samples at 192 x 144: with 4 a
# moment, 2048 samples of motion_blur.xml take 15 s, with 1, 38 s, with 64, 8 s.
SAMPLES_PER_MOMENT = 4
# The same where a displaced sphere moves: the search structure of a mesh of 3 million triangles takes 2 CPU seconds to
# build (for an instance of a group too, since Mitsuba builds that anew), so 2048 samples see 64 moments.
SAMPLES_PER_MOMENT_OF_A_MESH = 32
# Tells the shifts' random stream from other uses of the replica's number.
SHIFT_STREAM = 0x4D6F7665


def moving_id(index: int) -> str:
    """The id that `expand_shapes` gives to moving shape number `index` of a scene, by which it is found again."""
    return f"moving shape {index}"


def samples_per_moment(scene: Scene) -> int:
    """How many samples of a moving scene share a moment."""
    displaced = any(scene.shapes[index].displacement is not None for index in moving(scene))
    return SAMPLES_PER_MOMENT_OF_A_MESH if displaced else SAMPLES_PER_MOMENT


def moments(first: int, count: int, sharing: int, samples_per_call: int) -> list[tuple[int, int]]:
    """Pieces (first sample, samples) of a range that each see one moment, of `sharing` samples, and fit into a call."""
    pieces = []
    end = first + count
    while first < end:
        size = min(sharing - first % sharing, samples_per_call, end - first)
        pieces.append((first, size))
        first += size
    return pieces


def moment(shutter: tuple[float, float], replica: int, sample: int, sharing: int) -> float:
    """The time at which sample number `sample` of a replica sees the scene, where `sharing` samples share a moment."""
    shift = np.random.default_rng([SHIFT_STREAM, replica]).random()
    u = (radical_inverse(sample // sharing) + shift) % 1.0
    opens, closes = shutter
    return opens + (closes - opens) * (1.0 - abs(2.0 * u - 1.0))


def radical_inverse(index: int) -> float:
    """The digits of `index` in base 2, mirrored at the point: in [0, 1)."""
    return int(f"{index:b}"[::-1], 2) / (1 << index.bit_length()) if index else 0.0


class MovingShapes:
    """The shapes of an instantiated Mitsuba scene that move, and the parameters by which they are moved.

    Updating parameters takes 2 ms for five shapes; instantiating the scene again takes several times that, and reads
    every image and mesh again.
    """

    def __init__(self, mi: Any, mitsuba_scene: Any, scene: Scene) -> None:
        self._mi, self._mitsuba_scene = mi, mitsuba_scene
        found = {shape.id(): shape for shape in mitsuba_scene.shapes()}
        self._shapes = []
        for index in moving(scene):
            motion = scene.shapes[index].motion
            assert motion is not None
            parameters = mi.traverse(found[moving_id(index)])
            self._shapes.append((screw(motion), parameters, _at_rest(parameters)))

    def move(self, time: float) -> None:
        """Put every moving shape where it is at `time`, with the textures that lie on it in object space."""
        import drjit as dr

        for steady, parameters, at_rest in self._shapes:
            pose = steady.pose(time)
            to_rest = self._mi.AffineTransform4f(np.linalg.inv(pose))
            dr.make_opaque(to_rest)  # else each time would be a constant of another kernel
            for key in parameters.keys():
                if key.endswith(".to_rest"):
                    parameters[key] = to_rest
            if "to_world" in at_rest:
                self._move_analytic(parameters, pose @ at_rest["to_world"])
            else:
                self._move_mesh(parameters, at_rest, pose)
        self._mitsuba_scene.parameters_changed()  # builds the acceleration structure again

    def _move_mesh(self, parameters: Any, at_rest: dict[str, np.ndarray], pose: np.ndarray) -> None:
        turn, shift = pose[:3, :3], pose[:3, 3]
        parameters["vertex_positions"] = self._mi.Float((at_rest["vertex_positions"] @ turn.T + shift).ravel())
        if "vertex_normals" in at_rest:
            parameters["vertex_normals"] = self._mi.Float((at_rest["vertex_normals"] @ turn.T).ravel())
        parameters.update()

    def _move_analytic(self, parameters: Any, to_world: np.ndarray) -> None:
        # Mitsuba's sphere and cylinder turn their normals over at every update under a mirroring transform, when they
        # should at the first only; a second update turns them back.
        for _ in range(1 if np.linalg.det(to_world[:3, :3]) > 0 else 2):
            parameters["to_world"] = self._mi.AffineTransform4f(to_world)
            parameters.update()


def _at_rest(parameters: Any) -> dict[str, np.ndarray]:
    """A shape's place as Mitsuba holds it: `to_world`, (4, 4), or what it has of vertices and their normals, (N, 3)."""
    if "to_world" in parameters:
        # Not what the file says: of a disk, `flip_normals` is part of it.
        return {"to_world": np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)}
    return {key: np.array(parameters[key], dtype=np.float64).reshape(-1, 3)
            for key in ("vertex_positions", "vertex_normals") if key in parameters}
