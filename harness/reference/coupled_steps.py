"""Single steps of a path by Mitsuba, each from a state that somebody else recorded: what the autopsy compares with.

Rays meet Mitsuba's shapes, start at its sensor, gather its emitters and are scattered by its BSDFs. Nothing is carried
from one step to the next, so rounding does not grow along a path: what differs is what this one step computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.machine.mitsuba_runtime import use_reference_variant
from harness.reference.map_draws import MapDraws
from harness.reference.motion import MovingShapes
from harness.reference.prepare import prepare
from harness.reference.shape_index import shape_table
from harness.scene import Scene, SceneFile, load
from harness.scene.model import EnvironmentMap
from harness.scene.motion import moving

# What a distance is where nothing is met, as the shader's NO_HIT.
NO_HIT = 1e30
# Arrays are filled up to a multiple of this: drjit compiles a kernel anew where an input is not aligned as before,
# which takes a hundred times as long as running it.
LANES, ALIGNMENT = 1024, 64  # entries, bytes


@dataclass(frozen=True, eq=False)
class Rays:
    """Camera rays: origins and unit directions (N, 3), lengths up to the far plane (N,)."""

    origin: np.ndarray
    direction: np.ndarray
    reach: np.ndarray


@dataclass(frozen=True, eq=False)
class Vertices:
    """What Mitsuba finds at the end of each ray; arrays of N rows, colours and vectors (N, 3).

    `shape`: index in `Scene.shapes`, -1 where the ray escapes; `distance` NO_HIT there. `point`: where it
    meets it. `normal` is the shading normal
    as the shape has it, whichever side was met; `cosine` that of the ray to it, positive in front. `light`: what
    is gathered. `two_sided`: whether the back is shaded. `kd`, `ks`, `alpha` of the material. `value`, `diffuse`,
    `glossy`: the BSDF times the cosine in the recorded direction: whole, and its two terms.
    """

    shape: np.ndarray
    distance: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    cosine: np.ndarray
    uv: np.ndarray
    light: np.ndarray
    two_sided: np.ndarray
    kd: np.ndarray
    ks: np.ndarray
    alpha: np.ndarray
    value: np.ndarray


class CoupledSteps:
    """Mitsuba's scene of a file, asked for single steps.

    `file`: the scene's; `reading`: ours of it; `scene`: the same as it is rendered, by Mitsuba and by our shader.
    """

    def __init__(self, file: SceneFile) -> None:
        """HarnessError for a scene that our tracer does not understand, and whatever `prepare` raises."""
        self._mi = use_reference_variant()
        self.file = file
        prepared = prepare(file)
        if prepared.reading is None:
            raise HarnessError(f"{file.path}: the scene holds what the tracer has no words for; `harness reference` "
                               "renders it, but there are no paths of ours to compare")
        self.reading: Scene = load(file)
        self.scene: Scene = prepared.reading
        self._mitsuba = prepared.scene
        self._sensor = prepared.scene.sensors()[0]
        self._moving = MovingShapes(self._mi, prepared.scene, self.scene) if moving(self.scene) else None
        self._shapes = shape_table(self._mi, prepared.scene.shapes(), self.scene)

    def move(self, time: float) -> None:
        """Put all that moves where it is at this time."""
        if self._moving is not None:
            self._moving.move(time)

    def camera(self, film: np.ndarray, lens: np.ndarray) -> Rays:
        """Rays through film points (N, 2), (0,0) at the bottom left; numbers (N, 2) pick the points of the lens."""
        mi = self._mi
        place = mi.Point2f(self._floats(film[:, 0]), 1.0 - self._floats(film[:, 1]))
        ray, _ = self._sensor.sample_ray(self.scene.camera.shutter[0], 0.5, place,
                                         mi.Point2f(self._floats(lens[:, 0]), self._floats(lens[:, 1])))
        count = len(film)
        return Rays(_array(ray.o, count), _array(ray.d, count), _array(ray.maxt, count))

    def vertices(self, origin: np.ndarray, direction: np.ndarray, scattered: np.ndarray) -> Vertices:
        """What rays meet, and what the BSDF there says of the directions `scattered`; all (N, 3)."""
        mi = self._mi
        import drjit as dr

        si, bsdf, valid = self._met(origin, direction)
        light = si.emitter(self._mitsuba).eval(si, mi.Bool(True))
        back = (bsdf.flags() & (+mi.BSDFFlags.BackSide)) != 0
        wo = si.to_local(self._vectors(scattered))
        known = bsdf.has_attribute("ks", valid)
        kd = dr.select(known, bsdf.eval_attribute_3("kd", si, valid), bsdf.eval_diffuse_reflectance(si, valid))
        ks = dr.select(known, bsdf.eval_attribute_3("ks", si, valid), mi.Color3f(0.0))
        alpha = dr.select(known, bsdf.eval_attribute_3("lobe", si, valid).x, 1.0)
        found: dict[str, Any] = {
            "shape": dr.select(valid, dr.reinterpret_array(mi.UInt32, si.shape), 0),
            "distance": dr.select(valid, si.t, NO_HIT), "point": si.p, "normal": si.sh_frame.n, "cosine": si.wi.z,
            "uv": si.uv, "light": light, "two_sided": back, "kd": kd, "ks": ks, "alpha": alpha,
            "value": bsdf.eval(mi.BSDFContext(), si, wo, valid)}
        dr.eval(found)
        arrays = {name: _array(value, len(origin)) for name, value in found.items()}
        arrays["shape"] = np.where(arrays["distance"] < NO_HIT, self._shapes[arrays["shape"]], -1)
        return Vertices(**arrays)

    def scatter(self, origin: np.ndarray, direction: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions that Mitsuba's BSDF draws where rays meet it, (N, 3), by numbers (N, 3), and their weights."""
        mi = self._mi
        import drjit as dr

        si, bsdf, valid = self._met(origin, direction)
        first, second, third = (self._floats(numbers[:, k]) for k in range(3))
        sample, weight = bsdf.sample(mi.BSDFContext(), si, first, mi.Point2f(second, third), valid)
        drawn = si.to_world(sample.wo)
        dr.eval(drawn, weight)
        return _array(drawn, len(origin)), _array(weight, len(origin))

    def sky(self, numbers: np.ndarray, asked: np.ndarray, *, compensated: bool) -> tuple[np.ndarray, np.ndarray]:
        """Directions (N, 3) that numbers (N, 3), the texel's and two of the direction, draw from the environment map,
        and the densities per steradian of the directions `asked`, (N,). `compensated`: see `MapDraws`."""
        import drjit as dr

        assert isinstance(self.scene.environment, EnvironmentMap), "the scene has a map"
        draws = MapDraws(self._mi, self.scene.environment, compensated)
        direction = draws.direction(*(self._floats(numbers[:, k]) for k in range(3)))
        density = draws.density(self._vectors(asked))
        dr.eval(direction, density)
        return _array(direction, len(numbers)), _array(density, len(numbers))

    def _met(self, origin: np.ndarray, direction: np.ndarray) -> tuple[Any, Any, Any]:
        mi = self._mi
        ray = mi.Ray3f(mi.Point3f(self._vectors(origin)), self._vectors(direction))
        si = self._mitsuba.ray_intersect(ray, ray_flags=mi.RayFlags.UV | mi.RayFlags.ShadingFrame, coherent=False,
                                         active=mi.Bool(True))
        return si, si.bsdf(), si.is_valid()

    def _floats(self, values: np.ndarray) -> Any:
        return self._mi.Float(_aligned(np.pad(values, (0, -len(values) % LANES), mode="edge")))

    def _vectors(self, values: np.ndarray) -> Any:
        return self._mi.Vector3f(*(self._floats(values[:, axis]) for axis in range(3)))


def _aligned(values: np.ndarray) -> np.ndarray:
    """A float32 copy (N,) that begins at a multiple of ALIGNMENT: drjit takes NumPy's memory as it lies."""
    buffer = np.empty(values.size * 4 + ALIGNMENT, dtype=np.uint8)
    start = -buffer.ctypes.data % ALIGNMENT
    copy = buffer[start:start + values.size * 4].view(np.float32)
    copy[:] = values
    return copy


def _array(value: Any, count: int) -> np.ndarray:
    """The first `count` entries of a drjit array, or its one for all, as (count,) or (count, k)."""
    found = np.array(value)
    found = found.T if found.ndim == 2 else found
    return np.broadcast_to(found, (count, *found.shape[1:])).copy() if len(found) == 1 else found[:count].copy()
