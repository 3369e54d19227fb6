"""The `phong` BSDF for Mitsuba 3: the course's model with eval, sample and pdf together.

    f(wi, wo) = kd/π + ks (α+1)/(2π) max(r·wo, 0)^α,   r the mirror image of wi about the normal

Parameters, each a colour, number or texture: `kd` within [0, 1] (default 0.5), `ks` at least 0 (default 0), `alpha` at
least 0 (default 10; of a colour, red counts). The normalisation is the course's α+1, not the α+2 that conserves energy
at normal incidence. At α = 0 the clamp stays: the lobe is constant where r·wo > 0 and zero elsewhere.

Conventions are Mitsuba's: directions are local, unit, and point away from the surface; `eval` includes the cosine of
`wo`; the back is black (wrap the plugin in `twosided` to shade both sides).
"""

from __future__ import annotations

from typing import Any

import numpy as np

# The same defaults as the loader's (harness/scene/loader.py); a test compares them.
DEFAULTS = {"kd": 0.5, "ks": 0.0, "alpha": 10.0}


def _texture(mi: Any, dr: Any, props: Any, name: str) -> Any:
    """The parameter as a Mitsuba texture; RuntimeError when it is constant and outside its range."""
    texture = props.get_unbounded_texture(name, DEFAULTS[name])
    if name not in props or props.type(name) != mi.Properties.Type.Object:
        largest = 1.0 if name == "kd" else np.inf
        values = np.ravel(np.array(texture.eval(dr.zeros(mi.SurfaceInteraction3f))))
        if not (np.isfinite(values) & (values >= 0) & (values <= largest)).all():
            allowed = "finite and at least 0" if largest == np.inf else f"within [0, {largest:g}]"
            raise RuntimeError(f"phong: {name} is {', '.join(f'{v:g}' for v in values)}; it must be {allowed}")
    return texture


def _largest_share(dr: Any, part: Any, rest: Any) -> Any:
    """What of two colours' largest channels is the first's; 0 where both are black."""
    both = dr.max(part) + dr.max(rest)
    return dr.select(both > 0, dr.max(part) / dr.select(both > 0, both, 1), 0)


def plugin_class(mi: Any) -> type:
    """The plugin's class for the current variant; a class inside a function because its base changes with that."""
    import drjit as dr

    class Phong(mi.BSDF):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.kd = _texture(mi, dr, props, "kd")
            self.ks = _texture(mi, dr, props, "ks")
            self.alpha = _texture(mi, dr, props, "alpha")
            diffuse = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            glossy = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [diffuse, glossy]
            self.m_flags = diffuse | glossy

        def _parameters(self, ctx: Any, si: Any, active: Any) -> tuple[Any, Any, Any, Any]:
            """kd, ks (black where `ctx` switches the lobe off), alpha, and the share of samples for the diffuse lobe.

            The share goes by the largest channel, so that it is 0 or 1 only where one lobe is black in all channels.
            """
            kd = self.kd.eval(si, active) if ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 0) else mi.Spectrum(0)
            ks = self.ks.eval(si, active) if ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 1) else mi.Spectrum(0)
            # Not eval_1: Mitsuba 3.9's checkerboard swaps its two colours there.
            return kd, ks, self.alpha.eval(si, active)[0], _largest_share(dr, kd, ks)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
            _, _, alpha, share = self._parameters(ctx, si, active)
            choose_diffuse = sample1 < share
            # Lafortune and Willems 1994, "Using the modified Phong reflectance model": cos = ξ^(1/(α+1)).
            cos_lobe = dr.power(sample2.y, dr.rcp(alpha + 1))
            sin_lobe = dr.safe_sqrt(1 - dr.square(cos_lobe))
            sin_phi, cos_phi = dr.sincos(dr.two_pi * sample2.x)
            around_mirror = mi.Frame3f(mi.reflect(si.wi)).to_world(
                mi.Vector3f(cos_phi * sin_lobe, sin_phi * sin_lobe, cos_lobe))

            bs = mi.BSDFSample3f()
            bs.wo = dr.select(choose_diffuse, mi.warp.square_to_cosine_hemisphere(sample2), around_mirror)
            bs.eta = 1.0
            bs.sampled_component = dr.select(choose_diffuse, mi.UInt32(0), mi.UInt32(1))
            bs.sampled_type = dr.select(choose_diffuse, mi.UInt32(+mi.BSDFFlags.DiffuseReflection),
                                        mi.UInt32(+mi.BSDFFlags.GlossyReflection))
            value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
            # A lobe sample under the surface has pdf 0 here and carries nothing: the estimator stays unbiased.
            sampled = bs.pdf > 0
            return bs, dr.select(sampled, value / dr.select(sampled, bs.pdf, 1), 0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            kd, ks, alpha, share = self._parameters(ctx, si, active)
            cos_o = mi.Frame3f.cos_theta(wo)
            active &= (mi.Frame3f.cos_theta(si.wi) > 0) & (cos_o > 0)
            cos_lobe = dr.dot(mi.reflect(si.wi), wo)
            in_lobe = cos_lobe > 0
            # power(0, 0) and a negative base are NaN in drjit: choose the base before raising it.
            power = dr.power(dr.select(in_lobe, cos_lobe, 1), alpha)
            lobe = dr.select(in_lobe, (alpha + 1) * (0.5 * dr.inv_pi) * power, 0)
            value = (kd * dr.inv_pi + ks * lobe) * cos_o
            pdf = share * cos_o * dr.inv_pi + (1 - share) * lobe
            return dr.select(active, value, 0), dr.select(active, pdf, 0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        # What whoever draws directions in Mitsuba's place must know of the surface: see harness.reference.coupled.
        # `lobe` is alpha and the lobe's probability in one, since each call costs as much as an evaluation.
        def has_attribute(self, name: str, active: Any = True) -> Any:
            return name in ("kd", "ks", "lobe")

        def eval_attribute_3(self, name: str, si: Any, active: Any = True) -> Any:
            if name == "lobe":
                kd, ks, alpha, share = self._parameters(mi.BSDFContext(), si, active)
                return mi.Color3f(alpha, _largest_share(dr, ks, kd), share)
            return (self.kd if name == "kd" else self.ks).eval(si, active)

        def traverse(self, callback: Any) -> None:
            for name in ("kd", "ks", "alpha"):
                callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

        def to_string(self) -> str:
            return f"Phong[kd={self.kd}, ks={self.ks}, alpha={self.alpha}]"

    return Phong
