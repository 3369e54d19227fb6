"""The `bsdf_path` integrator for Mitsuba 3: the tracer's own algorithm, for a fair comparison of speed.

No light sampling, no Russian roulette: each vertex adds the emission it meets, then one sample of the BSDF leads on.
`max_depth` counts as in Mitsuba's `path`: emission seen directly is depth 1, so N allows N-1 scatterings.

Measured alternatives: the first hit outside the loop, and all ray flags instead of the two that isotropic textured
BSDFs need, each cost 3-10 % more CPU time; Mitsuba's differentiable `prb_basic`, run forward, does both.
"""

from __future__ import annotations

from typing import Any


def plugin_class(mi: Any) -> type:
    """The plugin's class for the current variant; a class inside a function because its base changes with that."""
    import drjit as dr

    class BSDFPath(mi.SamplingIntegrator):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.max_depth = props.get("max_depth", 6)  # Mitsuba's own Python integrators' default
            if self.max_depth < 1:
                raise RuntimeError(f"bsdf_path: max_depth is {self.max_depth}; it must be at least 1")

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            context = mi.BSDFContext()
            flags = mi.RayFlags.UV | mi.RayFlags.ShadingFrame

            def vertex(sampler: Any, ray: Any, throughput: Any, radiance: Any, depth: Any, active: Any) -> Any:
                # Only camera rays are coherent, which Embree profits from.
                si = scene.ray_intersect(ray, ray_flags=flags, coherent=depth == 0, active=active)
                radiance = dr.fma(throughput, si.emitter(scene).eval(si, active), radiance)
                depth += 1
                active &= si.is_valid() & (depth < self.max_depth)
                scattered, weight = si.bsdf().sample(context, si, sampler.next_1d(active), sampler.next_2d(active),
                                                     active)
                throughput *= weight
                active &= dr.any(throughput != 0)
                return sampler, si.spawn_ray(si.to_world(scattered.wo)), throughput, radiance, depth, active

            state = (sampler, mi.Ray3f(ray), mi.Spectrum(1), mi.Spectrum(0), mi.UInt32(0), mi.Bool(active))
            _, _, _, radiance, _, _ = dr.while_loop(state, lambda *state: state[-1], vertex, label="bsdf_path")
            return radiance, mi.Bool(active), []

        def to_string(self) -> str:
            return f"BSDFPath[max_depth={self.max_depth}]"

    return BSDFPath
