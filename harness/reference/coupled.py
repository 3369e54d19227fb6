"""The coupled oracle: Mitsuba follows the very random numbers of the tracer.

Sample number k of replica r of a pixel draws the same numbers in the same order as the shader does, and makes
directions of them by the same formulas (`harness.reference.draws`); but rays leave Mitsuba's sensor, meet Mitsuba's
shapes, gather Mitsuba's emitters and are weighted by Mitsuba's BSDFs. Both renderers then follow the same path up to
rounding, and the difference of their images has a variance 1e4 to 1e14 times smaller than that of either. Its
expectation is the difference of the two means whether single paths part or not: nothing is trimmed, nothing
conditioned on.

What both share cannot show in the difference: the generator, and the directions that it is turned into. The pdf of
`mixture` is the BSDF's own; those of the other strategies follow from its value.

Where shapes move, each path sees the shutter's interval at the moment that its own number picks, as in the shader:
Mitsuba's shapes rest, and the ray is carried to where each of them does (`Mover`).

The pieces, for whoever steps through paths instead of rendering them (all arrays are drjit's, one lane a path):
`lanes` and `begin` give the state with which paths start; `meet` and `scatter` are the two halves of a vertex.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from typing import Any, NamedTuple

import numpy as np

from harness.machine.mitsuba_runtime import use_reference_variant
from harness.reference.draws import Draw, pixel_stream, rand, rand2, seed_sample
from harness.reference.light_draws import LightDraws
from harness.reference.motion import moving_id
from harness.reference.movers import Mover, at_rest, scene_of, turned_back
from harness.reference.prepare import prepare
from harness.reference.shape_index import shape_table
from harness.samples.cost import Watch, cpu
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest
from harness.samples.spent import spent
from harness.samples.traits import Traits
from harness.scene import Scene, SceneFile, load
from harness.scene.lights import lights_sampled
from harness.scene.model import is_black
from harness.scene.motion import moving, screw

# Paths of one kernel: with more, Ctrl-C waits for seconds; with a quarter, launches begin to count.
LANES = 1 << 21
# Samples of a pixel that are added up in float32 before float64 takes over: 64 leave 2e-7 of the sum.
BLOCK = 64


class Lanes(NamedTuple):
    """Which paths a kernel follows: pixels from the left and from the bottom, sample numbers; mi.UInt32 all."""

    x: Any
    y: Any
    sample: Any


class Begun(NamedTuple):
    """Paths before their first vertex: the generator's state as it was seeded and after the draws so far, the ray of
    the camera, the numbers for film and lens, and the moment (open … close of the shutter)."""

    seed: Any
    state: Any
    ray: Any
    film: Any
    lens: Any
    moment: Any


@dataclass
class Met:
    """What a ray met: Mitsuba's interaction `si`, of a shape that moves where it rests; `emitted`, the radiance that
    the ray gathers; `normal`, on the side that the ray came from, world space; and the pose that carries a shape at
    rest to where it is (`turn`, a Matrix3f, and `shift`, None both where nothing moves)."""

    si: Any
    emitted: Any
    normal: Any
    turn: Any
    shift: Any


class Scattered(NamedTuple):
    """Where a path goes on: the direction, the weight f cos / pdf, the ray that follows, the state after the draws."""

    direction: Any
    weight: Any
    ray: Any
    state: Any


class CoupledRenderer:
    """Renders batches of one scene with one strategy: those of the tracer's random numbers, by Mitsuba.

    The same (replica, start, count) as the tracer's gives the same paths; see the module. Kernels do not depend on
    replica, sample range or depth.
    """

    def __init__(self, scene: SceneFile, strategy: str, draw: str, lights: str, heuristic: str,
                 sampler: str = "independent") -> None:
        """Instantiate the scene. `strategy`: the name; what it means in `draw`, `lights` and `heuristic`, as
        `harness.scene.strategies.Strategy` has them; `sampler`: where numbers come from, a name of
        `harness.shader.samplers`. SceneError for a scene outside our tracer's subset: it has no paths to follow
        there."""
        self.scene, self.sampler = scene, sampler
        # As ReferenceRenderer's: the library's sums may come in any order.
        self.traits = Traits(repeats=False, independent_batches=sampler == "independent")
        self.strategy, self.lights, self.heuristic = strategy, lights, heuristic
        self._scene_hash = load(scene).content_hash  # SceneError here, where Mitsuba alone would go on
        prepared = prepare(scene)
        assert prepared.reading is not None, "the scene could be read"
        self.reading: Scene = prepared.reading  # in the frame in which both renderers see it
        self.draw = Draw(draw, any(not is_black(shape.material.ks) for shape in self.reading.shapes))
        self.mi = use_reference_variant()
        whole = prepared.scene
        self.sensor = whole.sensors()[0]
        self.shapes = whole.shapes()
        self._still, self._movers = self._parted(whole) if moving(self.reading) else (whole, [])
        self._lights = LightDraws(self.mi, self.reading, lights_sampled(self.reading, lights), lights == "mis")
        self._table = self.mi.Int32(shape_table(self.mi, self.shapes, self.reading))

    def _parted(self, whole: Any) -> tuple[Any, list[Mover]]:
        """The scene taken apart: what rests, and each shape that moves in a scene of its own."""
        indices = {moving_id(index): index for index in moving(self.reading)}
        # Into a scene shapes go by names that become their ids: they are told apart before.
        resting, movers = [], {}
        for shape in whole.shapes():
            if shape.id() in indices:
                movers[indices[shape.id()]] = shape
            else:
                resting.append(shape)
        if (environment := whole.environment()) is not None:
            resting.append(environment)
        motions = {index: self.reading.shapes[index].motion for index in movers}
        return scene_of(self.mi, resting), [Mover(index, screw(motion), scene_of(self.mi, [movers[index]]))
                                          for index, motion in motions.items() if motion]

    @property
    def identity(self) -> dict[str, str]:
        """What a batch depends on besides replica and sample range, for the store."""
        return {
            "renderer": "coupled",
            "scene": self._scene_hash,
            "strategy": self.strategy,
            **({"sampler": self.sampler} if self.sampler != "independent" else {}),
            "max_depth": str(self.reading.max_depth),
            "mitsuba": metadata.version("mitsuba"),
            "drjit": metadata.version("drjit"),
            "code": code_digest(__name__),
        }

    def release(self) -> None:
        """Let go of Mitsuba's scenes: see `ReferenceRenderer.release`."""
        del self._still, self._movers, self._lights, self._table, self.shapes, self.sensor

    @spent("Mitsuba, coupled")
    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[int], None] | None = None) -> Batch:
        """Samples start … start+count-1 of one replica. A sample that is not finite is left out, and counted."""
        use_reference_variant()
        watch = Watch()
        width, height = self.reading.width, self.reading.height
        total = np.zeros((height, width, 3))
        counted = np.zeros((height, width, 1))
        largest = np.zeros((height, width, 3), np.float32)
        for first in range(start, start + count, BLOCK):
            samples = min(BLOCK, start + count - first)
            rows = max(1, min(height, LANES // (width * samples)))
            for top in range(0, height, rows):
                part = slice(top, min(height, top + rows))
                sums, number, most = self._sums(replica, first, samples, part.start, part.stop)
                total[part] += sums
                counted[part] += number
                largest[part] = np.maximum(largest[part], most)
            if advance is not None:
                advance(samples)
        mean = total / np.maximum(counted, 1)
        rejected = count * width * height - int(counted.sum())
        return Batch(mean.astype(np.float32), count, rejected, watch.cost(cpu()), largest)

    def _sums(self, replica: int, first: int, samples: int, top: int,
              bottom: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the rows from the top: sums of radiance (rows, W, 3), how many samples are in them (rows, W, 1), and the
        largest of these in each channel (rows, W, 3), which bounds what one that parts is off by."""
        import drjit as dr

        radiance = self._trace(self.begin(self.lanes(samples, top, bottom, first), replica))
        finite = dr.all(dr.isfinite(radiance))
        radiance = dr.select(finite, radiance, 0)
        ones = self.mi.Float(dr.select(finite, self.mi.Float(1), 0))
        dr.eval(radiance, ones)  # or each sum would trace all paths anew
        found = [dr.block_sum(values, samples) for values in (*radiance, ones)]
        found += [dr.block_reduce(dr.ReduceOp.Max, values, samples) for values in radiance]
        dr.eval(found)
        image = np.stack([np.array(values, dtype=np.float64) for values in found], -1)
        image = image.reshape(bottom - top, self.reading.width, 7)
        return image[..., :3], image[..., 3:4], image[..., 4:]

    def lanes(self, samples: int, top: int, bottom: int, first: int) -> Lanes:
        """All samples of the rows from `top` to before `bottom`, counted from the image's top; samples run fastest."""
        mi = self.mi
        import drjit as dr

        # Counted by drjit, by numbers that are no part of the kernel: arrays of NumPy's begin at any multiple of 16
        # bytes, and drjit compiles a kernel for each way in which three of them are aligned or not.
        width, height = self.reading.width, self.reading.height
        many, start, row = (dr.opaque(mi.UInt32, number) for number in (samples, first, height - 1 - top))
        lane = dr.arange(mi.UInt32, (bottom - top) * width * samples)
        pixel = lane // many
        return Lanes(pixel % width, row - pixel // width, start + lane % many)

    def begin(self, lanes: Lanes, replica: int) -> Begun:
        """The camera's rays: the numbers of `trace_samples` in lib/path.glsl, in its order."""
        mi = self.mi
        import drjit as dr

        camera = self.reading.camera
        stream = pixel_stream(lanes.x, lanes.y, dr.opaque(mi.UInt32, replica))
        seed = seed_sample(stream, lanes.sample, self.sampler)
        a, b, state = rand2(seed)
        film = mi.Point2f((mi.Float(lanes.x) + a) * (1.0 / self.reading.width),
                          1.0 - (mi.Float(lanes.y) + b) * (1.0 / self.reading.height))
        lens = mi.Point2f(0.5)
        if camera.aperture_radius > 0:
            c, d, state = rand2(state)
            lens = mi.Point2f(c, d)
        opens, closes = camera.shutter
        moment = mi.Float(opens)
        if self._movers:
            u, state = rand(state)
            moment = opens + (closes - opens) * u
        ray, _ = self.sensor.sample_ray(mi.Float(opens), 0.5, film, lens)
        return Begun(seed, state, mi.Ray3f(ray), film, lens, moment)

    def meet(self, ray: Any, moment: Any, active: Any) -> Met:
        """What each ray meets at its moment."""
        mi = self.mi
        import drjit as dr

        flags = mi.RayFlags.UV | mi.RayFlags.ShadingFrame
        si = self._still.ray_intersect(ray, ray_flags=flags, coherent=False, active=active)
        turn: Any = None
        shift: Any = None
        if self._movers:
            turn, shift = mi.Matrix3f(1), mi.Vector3f(0)
        for mover in self._movers:
            pose = mover.pose(mi, moment)
            hit = mover.scene.ray_intersect(at_rest(mi, ray, *pose), ray_flags=flags, coherent=False, active=active)
            nearer = hit.is_valid() & (hit.t < si.t)
            si = dr.select(nearer, hit, si)
            turn, shift = dr.select(nearer, pose[0], turn), dr.select(nearer, pose[1], shift)
        emitted = si.emitter(self._still).eval(si, active)
        normal = dr.select(si.wi.z < 0, -si.sh_frame.n, si.sh_frame.n)
        return Met(si, emitted, normal if turn is None else turn @ normal, turn, shift)

    def scatter(self, met: Met, ray: Any, state: Any, active: Any) -> Scattered:
        """One direction from each surface met."""
        mi = self.mi
        import drjit as dr

        alpha = p_glossy = mi.Float(0)
        if self.draw.needs_lobe:
            bsdf = met.si.bsdf()
            lobe = bsdf.eval_attribute_3("lobe", met.si, active)
            alpha, p_glossy = lobe.x, lobe.y
            if not self.draw.chooses:  # a BSDF without a lobe has one of exponent 1 here, as in the shader
                alpha = dr.select(bsdf.has_attribute("lobe", active), alpha, 1.0)
        direction, glossy, after = self.draw.direction(met.normal, -ray.d, alpha, p_glossy, state)
        return Scattered(direction, self.weight(met, direction, glossy, p_glossy, alpha, active),
                         self.leave(met, direction), after)

    def weight(self, met: Met, direction: Any, glossy: Any, p_glossy: Any, alpha: Any, active: Any) -> Any:
        """f cos / pdf of a direction: the value is Mitsuba's, the pdf that of the strategy (of `mixture`: the BSDF's
        own)."""
        mi = self.mi
        import drjit as dr

        bsdf, context = met.si.bsdf(), mi.BSDFContext()
        wo = met.si.to_local(turned_back(direction, met.turn))
        if self.draw.strategy == "uniform":
            return bsdf.eval(context, met.si, wo, active) * dr.two_pi
        if self.draw.by_cosine:
            # Of a surface with two sides both cosines may be negative; the BSDF knows which sides count.
            return _ratio(bsdf.eval(context, met.si, wo, active) * dr.pi, dr.abs(mi.Frame3f.cos_theta(wo)))
        if self.draw.strategy == "lobes":
            parts = []
            for kind, chance in ((mi.BSDFFlags.DiffuseReflection, 1.0 - p_glossy),
                                 (mi.BSDFFlags.GlossyReflection, p_glossy)):
                context = mi.BSDFContext()
                context.type_mask = kind
                value, pdf = bsdf.eval_pdf(context, met.si, wo, active)
                parts.append(_ratio(value, chance * pdf))
            return dr.select(glossy, parts[1], parts[0])
        if self.draw.strategy == "phong":
            # By the lobe alone, whatever the BSDF would draw by.
            return _ratio(bsdf.eval(context, met.si, wo, active), _lobe_pdf(mi.reflect(met.si.wi), wo, alpha))
        return _ratio(*bsdf.eval_pdf(context, met.si, wo, active))

    def leave(self, met: Met, direction: Any) -> Any:
        """The ray that leaves a surface, lifted off it as Mitsuba does."""
        ray = met.si.spawn_ray(turned_back(direction, met.turn))
        if met.turn is not None:
            ray.o = self.mi.Point3f(met.turn @ ray.o + met.shift)
            ray.d = direction
        return ray

    def direction_pdf(self, met: Met, direction: Any, alpha: Any, active: Any) -> Any:
        """The density per steradian with which the strategy draws a direction: of `mixture` the BSDF's own."""
        mi = self.mi
        import drjit as dr

        wo = met.si.to_local(turned_back(direction, met.turn))
        if self.draw.strategy == "uniform":
            return mi.Float(0.5 * float(dr.inv_pi))
        if self.draw.by_cosine:
            return dr.abs(mi.Frame3f.cos_theta(wo)) * dr.inv_pi
        if self.draw.strategy == "phong":
            return _lobe_pdf(mi.reflect(met.si.wi), wo, alpha)
        return met.si.bsdf().pdf(mi.BSDFContext(), met.si, wo, active)

    def lit(self, met: Met, ray: Any, moment: Any, state: Any, active: Any) -> tuple[Any, Any]:
        """What one light sends to each surface met, reflected: radiance, and the state after the draws."""
        mi = self.mi
        import drjit as dr

        o = self.leave(met, met.normal).o
        aimed = self._lights.aim(o, met.normal, state, *self._carriers(moment))
        to_light = mi.Ray3f(o, aimed.direction)
        found = self.meet(to_light, moment, active)
        met_shape, facing = self._shape(found), _facing(found, aimed.direction)
        pdf = aimed.chance * dr.select(
            aimed.shape < 0, self._lights.sky_density(aimed.direction, met.normal),
            self._lights.density(aimed.shape, o, found.si.t, facing, self._carriers(moment)[0]))
        seen = active & (met_shape == aimed.shape) & ((facing > 0) | (aimed.shape < 0)) & (
            dr.dot(met.normal, aimed.direction) > 0)
        bsdf, wo = met.si.bsdf(), met.si.to_local(turned_back(aimed.direction, met.turn))
        value = bsdf.eval(mi.BSDFContext(), met.si, wo, active)
        if self.lights == "mis":
            value *= _weight(pdf, self.direction_pdf(met, aimed.direction, self._exponent(met, active), active),
                             self.heuristic)
        return dr.select(seen, _ratio(value * found.emitted, pdf), 0), aimed.state

    def _of_met(self, met: Met, ray: Any, moment: Any, depth: Any, direction_pdf: Any) -> Any:
        """What counts of the emission that a path has met by itself, at the vertex number `depth` from 0."""
        import drjit as dr

        if not self._lights.lights:
            return self.mi.Float(1)
        if self.lights == "nee":
            return dr.select(depth == 0, 1.0, 0.0)
        shape = self._shape(met)
        pdf = self._lights.chance(shape) * dr.select(
            shape < 0, self._lights.sky_density(ray.d, ray.d),
            self._lights.density(shape, ray.o, met.si.t, _facing(met, ray.d), self._carriers(moment)[0]))
        return dr.select((depth == 0) | ~(pdf > 0), 1.0, _weight(direction_pdf, pdf, self.heuristic))

    def _exponent(self, met: Met, active: Any) -> Any:
        return met.si.bsdf().eval_attribute_3("lobe", met.si, active).x if self.draw.strategy == "phong" else 0

    def _shape(self, met: Met) -> Any:
        """The index of the shape met, -1 where the ray escaped."""
        mi = self.mi
        import drjit as dr

        valid = met.si.is_valid()
        registered: Any = dr.reinterpret_array(mi.UInt32, met.si.shape)
        return dr.select(valid, dr.gather(mi.Int32, self._table, registered, valid), -1)

    def _carriers(self, moment: Any) -> tuple[Any, Any]:
        """How points are carried to where a shape rests at each moment, and directions back."""
        poses = {mover.shape: mover.pose(self.mi, moment) for mover in self._movers}

        def to_rest(p: Any, shape: int) -> Any:
            return self.mi.Point3f(poses[shape][0].T @ (self.mi.Vector3f(p) - poses[shape][1])) if shape in poses else p

        def from_rest(d: Any, shape: int) -> Any:
            return poses[shape][0] @ d if shape in poses else d

        return to_rest, from_rest

    def _trace(self, begun: Begun) -> Any:
        """Radiance of every path."""
        mi = self.mi
        import drjit as dr

        deepest = dr.opaque(mi.UInt32, self.reading.max_depth)
        samples_lights = bool(self._lights.lights)

        def vertex(state: Any, ray: Any, moment: Any, throughput: Any, radiance: Any, depth: Any, drawn: Any,
                   active: Any) -> Any:
            met = self.meet(ray, moment, active)
            radiance = dr.fma(throughput, met.emitted * self._of_met(met, ray, moment, depth, drawn), radiance)
            depth = depth + 1
            active = active & met.si.is_valid() & (depth < deepest)
            if samples_lights:
                light, state = self.lit(met, ray, moment, state, active)
                radiance = dr.fma(throughput, light, radiance)
            to = self.scatter(met, ray, state, active)
            if self.lights == "mis":
                drawn = self.direction_pdf(met, to.direction, self._exponent(met, active), active)
            throughput = throughput * to.weight
            return to.state, to.ray, moment, throughput, radiance, depth, drawn, active & dr.any(throughput != 0)

        loop = (begun.state, begun.ray, begun.moment, mi.Spectrum(1), mi.Spectrum(0), mi.UInt32(0), mi.Float(0),
                mi.Bool(True))
        return dr.while_loop(loop, lambda *loop: loop[-1], vertex, label="coupled")[4]


def _lobe_pdf(axis: Any, wo: Any, alpha: Any) -> Any:
    """cos^α about `axis`, normalised; 0 behind it, where a power would be NaN."""
    import drjit as dr

    cosine = dr.dot(axis, wo)
    ahead = cosine > 0
    return dr.select(ahead, (alpha + 1) * (0.5 * dr.inv_pi) * dr.power(dr.select(ahead, cosine, 1), alpha), 0)


def _ratio(value: Any, by: Any) -> Any:
    """value / by, zero where `by` is."""
    import drjit as dr

    positive = by > 0
    return dr.select(positive, value / dr.select(positive, by, 1), 0)


def _facing(met: Met, direction: Any) -> Any:
    """The cosine between a ray and the normal of what it met, positive in front."""
    import drjit as dr

    normal = met.si.sh_frame.n if met.turn is None else met.turn @ met.si.sh_frame.n
    return -dr.dot(normal, direction)


def _weight(own: Any, other: Any, heuristic: str) -> Any:
    """Of multiple importance sampling, for what was drawn with density `own`: Veach & Guibas 1995."""
    import drjit as dr

    if heuristic == "power":
        own, other = own * own, other * other
    return dr.select(own > 0, own / (own + other), 0)
