"""The reference renderer: batches of a scene rendered by Mitsuba 3, averaged in float64."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import metadata
from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.machine.mitsuba_runtime import REFERENCE_VARIANT, import_mitsuba, use_reference_variant
from harness.reference import footprint as footprints
from harness.reference.motion import MovingShapes, moment, moments, samples_per_moment
from harness.reference.prepare import INDEPENDENT, Prepared, prepare, reason
from harness.samples.cost import Watch, cpu
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest
from harness.samples.spent import spent
from harness.samples.traits import Traits
from harness.scene import SceneFile, motion
from harness.scene.footprint import BOX, Footprint

INTEGRATORS = ("path", "bsdf_path")
FILES_OWN = "file"  # the integrator that the scene file names

# Mitsuba's film adds up one call in float32: at 256 samples a pixel that is off by about 1e-5, at 2^14 by 1.6e-4.
MAX_SPP_PER_CALL = 256
# Samples (pixels x spp) in one uninterruptible call: about a second on two cores, so that Ctrl-C and progress bars
# stay alive; a quarter of the samples a call costs no measurable time. Memory sets no limit: a call is one fused
# kernel, and 2^25 samples left the process below 150 MB. Mitsuba itself crashes from 2^32 samples on.
MAX_SAMPLES_PER_CALL = 1 << 22
# Seeds have 32 bits: 10 for the replica, 22 for the first sample, so that no two calls of a scene share one.
REPLICA_BITS, START_BITS = 10, 22
# Never reached by a path of bounded depth, so Russian roulette stays off.
RR_DEPTH_OFF = 1 << 20


class ReferenceRenderer:
    """Renders batches of one scene with Mitsuba; holds the instantiated scene.

    A batch depends on scene, integrator, variant, replica and sample range only; a range gives the same samples
    whether it is rendered in one batch or in several whose borders are multiples of `samples_per_call`. Where shapes
    move, calls are short, and each sees one moment: see `harness.reference.motion`.
    """

    traits = Traits(repeats=False)  # to 5e-7: its threads add up in any order

    @spent("Mitsuba")
    def __init__(self, scene: SceneFile, integrator: str = FILES_OWN, *, max_depth: int | None = None,
                 variant: str = REFERENCE_VARIANT, sampler: str = INDEPENDENT, footprint: Footprint = BOX) -> None:
        """Instantiate the scene's file. `integrator`: the file's own, or the name of another: Mitsuba's `path`, our
        `bsdf_path` without light sampling, or any that Mitsuba has. `max_depth`: in place of the file's. `footprint`:
        how rays are spread about a pixel's centre.

        `sampler`: with any other than the independent one the samples of a call depend on each other, so only whole
        replicas of at most `samples_per_call` samples are independent, and batches of one replica are not.

        Raises HarnessError for an unknown integrator or variant, and whatever `prepare` raises.
        """
        self.scene, self.variant, self.sampler, self.footprint = scene, variant, sampler, footprint
        if variant not in (known := import_mitsuba().variants()):
            raise HarnessError(f"unknown variant '{variant}'; allowed: {', '.join(known)}")
        self._prepared: Prepared | None = None
        self._moving_shapes: MovingShapes | None = None
        prepared = self._instantiate()
        self.integrator = prepared.integrator if integrator == FILES_OWN else integrator
        self.max_depth = max_depth or prepared.max_depth
        # Our reading knows what of the file does not change the image, such as its comments.
        self._scene_hash = prepared.reading.content_hash if prepared.reading else scene.hash
        self.samples_per_call = max(1, min(MAX_SPP_PER_CALL,
                                           MAX_SAMPLES_PER_CALL // (prepared.film.width * prepared.film.height)))
        self._sharing = samples_per_moment(prepared.reading) if prepared.reading else 1
        self._integrator = self._make_integrator(prepared, own=integrator == FILES_OWN)

    def _make_integrator(self, prepared: Prepared, *, own: bool) -> Any:
        """Bounded paths without Russian roulette, whose noise is ours to measure; whatever else the file says stays."""
        mi = use_reference_variant(self.variant)
        if own and (prepared.reading is None or self.max_depth is None):
            return prepared.scene.integrator()
        options: dict[str, Any] = {} if self.max_depth is None else {"max_depth": self.max_depth}
        if self.integrator == "path" and options:
            options["rr_depth"] = RR_DEPTH_OFF
        try:
            return mi.load_dict({"type": self.integrator, **options})
        except Exception as error:  # of a name that is none, or one that asks for more, or has no depth
            if options and '"max_depth"' in str(error):
                self.max_depth = None
                return self._make_integrator(prepared, own=False)
            raise HarnessError(f"integrator '{self.integrator}' cannot be used ({reason(str(error))}); allowed: "
                               f"{', '.join(INTEGRATORS)}, and those of Mitsuba's that need no more than a depth; or "
                               "write it into the scene file and leave --integrator out") from None

    @property
    def identity(self) -> dict[str, str]:
        """What a batch depends on besides replica and sample range, for the store."""
        return {
            "renderer": "mitsuba",
            "scene": self._scene_hash,
            "integrator": self.integrator,
            "max_depth": str(self.max_depth),
            "mitsuba": metadata.version("mitsuba"),
            "drjit": metadata.version("drjit"),
            "variant": self.variant,
            "code": code_digest(__name__),
            **({} if self.sampler == INDEPENDENT else {"sampler": self.sampler}),
            **({} if self.footprint == BOX else {"footprint": str(self.footprint)}),
        }

    @spent("Mitsuba")
    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[int], None] | None = None) -> Batch:
        """Samples start … start+count-1 of one replica; `advance(n)` is told of every n samples per pixel done.

        A call's pixel that is not finite is left out of the mean, its samples counted as rejected. (A path whose
        throughput becomes NaN ends inside Mitsuba without contribution, and cannot be counted.)

        Raises HarnessError for a range outside what seeds can tell apart.
        """
        _check_range(replica, start, count)
        use_reference_variant(self.variant)
        if self._prepared is None:
            self._instantiate()
        watch = Watch()
        mean, rejected = average(self._calls(replica, start, count, advance))
        return Batch(mean.astype(np.float32), count, rejected, watch.cost(cpu()))

    def release(self) -> None:
        """Let go of Mitsuba's scene; the next batch instantiates it again.

        A renderer that is kept but not used slows down all others of the process: drjit 1.5 puts into a virtual call
        the code of every living instance of the class, whichever scene it belongs to. With 15 other scenes alive one
        scene took 7 times as long to compile, anew each time, and 3 times as long to render a small batch.
        """
        self._prepared = self._moving_shapes = None

    def _instantiate(self) -> Prepared:
        self._prepared = prepare(self.scene, self.variant, self.sampler)
        if self._prepared.reading and motion.moving(self._prepared.reading):
            self._moving_shapes = MovingShapes(use_reference_variant(self.variant), self._prepared.scene,
                                               self._prepared.reading)
        return self._prepared

    def _calls(self, replica: int, start: int, count: int,
               advance: Callable[[int], None] | None) -> Iterable[tuple[np.ndarray, int]]:
        """Mitsuba's images of the range's pieces, (H, W, 3) float32, each with its samples per pixel."""
        assert self._prepared is not None, "render_batch has instantiated it"
        scene, reading = self._prepared.scene, self._prepared.reading
        sensor = scene.sensors()[0]
        for first, spp in self._pieces(start, count):
            if self._moving_shapes is not None and reading is not None:
                self._moving_shapes.move(moment(reading.camera.shutter, replica, first, self._sharing))
            seed = call_seed(replica, first)
            if self.footprint == BOX:
                rendered: Any = self._integrator.render(scene, sensor, seed=seed, spp=spp)
            else:
                rendered = footprints.render(use_reference_variant(self.variant), scene, self._integrator,
                                             self.footprint, seed, spp)
            image = np.array(rendered)  # the copy waits for Mitsuba to finish
            if image.shape[-1] != 3:
                raise HarnessError(f"integrator '{self.integrator}' renders {image.shape[-1]} channels where three are "
                                   "expected; choose another with --integrator or --variant")
            yield image, spp
            if advance is not None:
                advance(spp)

    def _pieces(self, start: int, count: int) -> list[tuple[int, int]]:
        """The calls (first sample, samples) that a range is drawn in."""
        if self._moving_shapes is not None:
            return moments(start, count, self._sharing, self.samples_per_call)
        return [(first, min(self.samples_per_call, start + count - first))
                for first in range(start, start + count, self.samples_per_call)]


def average(calls: Iterable[tuple[np.ndarray, int]]) -> tuple[np.ndarray, int]:
    """Mean of images (H, W, 3) weighted by samples, float64, and the number of samples left out as not finite.

    A pixel that is not finite in one image is left out of that image; it is 0 where it is finite in none.
    """
    total: Any = 0.0
    weight: Any = 0
    rejected = 0
    for image, spp in calls:
        finite = np.isfinite(image).all(axis=-1, keepdims=True)
        total = total + np.where(finite, image, 0).astype(np.float64) * spp
        weight = weight + finite * spp
        rejected += int((~finite).sum()) * spp
    return total / np.maximum(weight, 1), rejected


def call_seed(replica: int, first: int) -> int:
    """The 32-bit seed of the call whose first sample is `first`: a bijection, so distinct calls never share streams.

    Mitsuba hashes the seed with the pixel's index (TEA); mixing it here too keeps neighbours apart in any case.
    The mixer is the finalizer of MurmurHash3 (Appleby 2011), each step of which can be undone.
    """
    seed = (replica << START_BITS) + first + 1 & 0xFFFFFFFF
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        seed ^= seed >> shift
        seed = seed * factor & 0xFFFFFFFF
    return seed ^ seed >> 16


def _check_range(replica: int, start: int, count: int) -> None:
    if not 0 <= replica < 1 << REPLICA_BITS:
        raise HarnessError(f"replica is {replica}; the reference has replicas 0 to {(1 << REPLICA_BITS) - 1}")
    if count < 1 or start < 0 or start + count > 1 << START_BITS:
        raise HarnessError(f"samples {start} to {start + count - 1} of a replica are out of range; allowed: at least "
                           f"one, from 0 to {(1 << START_BITS) - 1} (take another replica for more)")
