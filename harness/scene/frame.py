"""The frame in which a scene is rendered: its own, or one in which what the camera sees has an ordinary size and place.

Rays that leave a surface start a little off it, by OFFSET (1 + max |p|) at p, in Mitsuba and in our tracer alike. The 1
is a length in the scene's units: over a scene a thousandth of a unit wide, or one that lies a thousand units away,
light passes under whatever stands on a floor, and both renderers are wrong together (a tile by 35 %). And what float32
loses at 10,000 units from the origin no renderer finds again. Radiance does not change where everything is
scaled and shifted alike, so both renderers are given such scenes in a frame made for them: our tracer in its literals,
Mitsuba in what its parser has read (`harness.reference.prepare`). Transforms are multiplied in float64, before either
rounds them.

A camera a thousand radii away meets its subject at distances that float32 knows to 1e-4 of a radius only. Its rays
start at the near plane, so that plane is moved up to where the first shape may be.

Scenes of an ordinary size and place are left alone, to the bit.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from harness.scene.displaced import bounds
from harness.scene.model import Camera, Scene, Shape, as_matrix
from harness.scene.motion import moving, screw, settled

# Mitsuba's SurfaceInteraction::offset_p, and lib/path.glsl.
OFFSET = 8.94e-5
# A part of the width of what is seen: beyond it the offset shows, in contacts and thin gaps.
LARGEST_OFFSET = 1e-3
# A scene is left alone where the offset is no larger than half of that, what is seen is no wider than this (else
# float32 loses more than the offset where a large scene passes through its origin), ...
ORDINARY_OFFSET, ORDINARY_WIDTH = 5e-4, 200.0
# ... and its spheres and cylinders have radii up to this: Mitsuba meets and offsets them in float32, whose errors grow
# with the radius, while the offset at a ground's contact point does not.
ORDINARY_RADIUS = 150.0
# How wide what is seen is in a frame that is made, about: the factor is a power of 2, which rounds nothing.
WIDTH = 4.0
# Rays through the film, a side, by which is found what the camera sees.
RAYS = 24
# In widths of what is seen: a camera from which all shapes are farther than this has its near plane moved. Mitsuba's
# cylinder loses the square of it: it solves the quadratic equation as it stands (41 % of a furnace from 700 radii).
FAR_CAMERA, FAR_CAMERA_OF_CYLINDERS = 128.0, 16.0
# What the near plane stays before the first shape, as a part of its depth: float32 rounds the start of a ray.
BOX_MARGIN = 1e-6
# Moments of the shutter's interval at which a moving shape is looked for.
MOMENTS = 9


@dataclasses.dataclass(frozen=True)
class Frame:
    """Takes a point p of the scene's file to scale (p - center); the identity where `scale` is 1 and `center` 0.

    `near`: depth (units of the file) of a near plane that may take the place of the camera's; 0 where that is not far.
    `offset`: by what rays are lifted off the surfaces that are seen, as a part of the width of what is seen, here.
    """

    scale: float = 1.0
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    near: float = 0.0
    offset: float = 0.0

    @property
    def is_own(self) -> bool:
        """Whether the scene is left as its file has it."""
        return self.scale == 1.0 and not any(self.center) and not self.near

    @property
    def matrix(self) -> np.ndarray:
        """The transform of points, (4, 4) float64."""
        matrix = np.diag([self.scale, self.scale, self.scale, 1.0])
        matrix[:3, 3] = -self.scale * np.array(self.center)
        return matrix

    @property
    def inverse(self) -> np.ndarray:
        """Its inverse, likewise."""
        matrix = np.diag([1 / self.scale, 1 / self.scale, 1 / self.scale, 1.0])
        matrix[:3, 3] = self.center
        return matrix

    def camera_to_world(self, matrix: np.ndarray) -> np.ndarray:
        """A camera's transform, (4, 4), in this frame: moved, not scaled, which sensors must not be."""
        moved = matrix.copy()
        moved[:3, 3] = self.scale * (matrix[:3, 3] - np.array(self.center))
        return moved


@functools.lru_cache(maxsize=64)
def frame_of(scene: Scene) -> Frame:
    """The frame in which a scene of our reading is rendered."""
    points, distances = seen(scene)
    if not len(points):
        return Frame()
    center = np.median(points, axis=0)
    # By the near part of what is seen, whose details are the smallest.
    width = 2 * max(scene.camera.tan_x, scene.camera.tan_y) * float(np.median(distances))
    radius = max((_radius(shape) for shape in settled(scene).shapes), default=0.0)
    near = _first_depth(scene)
    far = FAR_CAMERA_OF_CYLINDERS if any(shape.kind == "cylinder" for shape in scene.shapes) else FAR_CAMERA
    if not far * width < near < scene.camera.far_clip or near < scene.camera.near_clip:
        near = 0.0
    own = Frame(near=near, offset=_offset(1.0, float(np.abs(center).max()), width))
    if own.offset <= ORDINARY_OFFSET and width <= ORDINARY_WIDTH and radius <= ORDINARY_RADIUS:
        return own
    scale = min(WIDTH / width, max(ORDINARY_RADIUS / max(radius, 1e-300), OFFSET / LARGEST_OFFSET / width))
    scale = 2.0 ** math.floor(math.log2(scale) + 0.5)
    x, y, z = (float(value) for value in center)
    return Frame(scale, (x, y, z), near, _offset(scale, 0.0, width))


def framed(scene: Scene) -> Scene:
    """The scene in its frame; the scene itself where that is its own."""
    frame = frame_of(scene)
    if frame.is_own:
        return scene
    return dataclasses.replace(scene, camera=_camera(scene.camera, frame),
                               shapes=tuple(_shape(shape, frame) for shape in scene.shapes))


def seen(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Points, (N, 3), where rays through an even grid of the film meet the scene when the shutter opens, and their
    distances from the camera, (N,). By formulas in float64; a displaced sphere counts as one that is not."""
    camera = scene.camera
    side = (np.arange(RAYS) + 0.5) / RAYS * 2 - 1
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    local = np.column_stack([x * camera.tan_x + camera.principal_point[0], y * camera.tan_y + camera.principal_point[1],
                             np.ones(len(x))])
    slant = np.linalg.norm(local, axis=1)
    d = local @ camera.matrix[:3, :3].T / slant[:, None]
    o = camera.matrix[:3, 3] + camera.near_clip * slant[:, None] * d
    reach = (camera.far_clip - camera.near_clip) * slant
    nearest = reach.copy()
    for shape in _at_opening(scene).shapes:
        inverse = np.linalg.inv(shape.matrix)
        nearest = np.minimum(nearest, _hit(shape.kind, o @ inverse[:3, :3].T + inverse[:3, 3], d @ inverse[:3, :3].T))
    met = nearest < reach
    return (o + nearest[:, None] * d)[met], (nearest + camera.near_clip * slant)[met]


def _at_opening(scene: Scene) -> Scene:
    opens = scene.camera.shutter[0]
    return settled(dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, shutter=(opens, opens))))


def _hit(kind: str, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distances (N,) along rays in canonical object space, (N, 3) both, to a shape's nearest point; inf beside it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind in ("rectangle", "disk"):
            t = -o[:, 2] / d[:, 2]
            at = (o + t[:, None] * d)[:, :2]
            inside = np.abs(at).max(axis=1) <= 1 if kind == "rectangle" else np.square(at).sum(axis=1) <= 1
            roots = [np.where(inside, t, np.inf)]
        elif kind == "cube":
            ends = np.sort(np.stack([(-1 - o) / d, (1 - o) / d]), axis=0)
            entry, leave = ends[0].max(axis=1), ends[1].min(axis=1)
            roots = [np.where(entry <= leave, root, np.inf) for root in (entry, leave)]
        else:
            axes = slice(0, 2 if kind == "cylinder" else 3)
            a, half_b = np.square(d[:, axes]).sum(axis=1), (o[:, axes] * d[:, axes]).sum(axis=1)
            root = np.sqrt(half_b**2 - a * (np.square(o[:, axes]).sum(axis=1) - 1))
            roots = [(-half_b - root) / a, (-half_b + root) / a]
            if kind == "cylinder":
                roots = [np.where(np.abs(2 * (o + t[:, None] * d)[:, 2] - 1) <= 1, t, np.inf) for t in roots]
    return np.min([np.where(root > 0, root, np.inf) for root in roots], axis=0)


def spread(scene: Scene) -> float:
    """No ray between shapes, or from the near plane, is longer than this: the diagonal of a box around them all."""
    camera = scene.camera
    corners = [camera.matrix[:3, 3] + camera.near_clip * camera.matrix[:3, 2]]
    for shape in settled(scene).shapes:
        times = np.linspace(*camera.shutter, MOMENTS) if shape.motion is not None else [0.0]
        for time in times:
            matrix = shape.matrix if shape.motion is None else screw(shape.motion).pose(float(time)) @ shape.matrix
            half = _extent(shape) * np.abs(matrix[:3, :3]).sum(axis=1)
            corners += [matrix[:3, 3] - half, matrix[:3, 3] + half]
    return float(np.linalg.norm(np.ptp(corners, axis=0)))


def _first_depth(scene: Scene) -> float:
    """A depth before which the camera meets no shape; 0 where something moves, which may come from anywhere."""
    if moving(scene):
        return 0.0
    to_camera = np.linalg.inv(scene.camera.matrix)
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)  # of a box around every canonical form
    depths = [(to_camera @ shape.matrix)[2] @ np.r_[corner * _extent(shape), 1.0]
              for shape in settled(scene).shapes for corner in corners]
    return max(0.0, float(min(depths, default=0.0)) * (1 - BOX_MARGIN))


def _extent(shape: Shape) -> float:
    return 1.0 if shape.displacement is None else bounds(shape.displacement).highest


def _radius(shape: Shape) -> float:
    """The radius of a sphere or cylinder, the larger one where it is not round; 0 of what is flat."""
    return float(np.linalg.norm(shape.matrix[:3, :2], 2)) if shape.kind in ("sphere", "cylinder") else 0.0


def _offset(scale: float, distance: float, width: float) -> float:
    return OFFSET * (1 / scale + distance) / width


def _camera(camera: Camera, frame: Frame) -> Camera:
    return dataclasses.replace(
        camera, to_world=as_matrix(frame.camera_to_world(camera.matrix)),
        near_clip=max(camera.near_clip, frame.near) * frame.scale, far_clip=camera.far_clip * frame.scale,
        aperture_radius=camera.aperture_radius * frame.scale, focus_distance=camera.focus_distance * frame.scale)


def _shape(shape: Shape, frame: Frame) -> Shape:
    motion = shape.motion
    if motion is not None:
        motion = as_matrix(frame.matrix @ np.array(motion, dtype=np.float64) @ frame.inverse)
    return dataclasses.replace(shape, to_world=as_matrix(frame.matrix @ shape.matrix), motion=motion)
