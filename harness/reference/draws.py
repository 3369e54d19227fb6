"""The tracer's random numbers, and the directions it makes of them, in drjit: `lib/random.glsl` and
`lib/sampling.glsl`.

Written out a second time, so that a renderer built on Mitsuba follows the shader's own paths
(`harness.reference.coupled`). Nothing here knows a scene: what both sides share cannot show in their difference, so it
is proved alone, the integers bit for bit and the directions by their moments. Arrays are drjit's, of any variant that
has them; `state` is the generator's, of unsigned 32-bit integers, and goes in and out, as the shader's global variable
does; that of the sampler `sobol` has two components, and its numbers come from `harness.reference.sobol`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from harness.reference import sobol

MULTIPLIER, INCREMENT, PERMUTATION = 747796405, 2891336453, 277803737
# Where Duff's basis turns over: see to_world in lib/sampling.glsl, which has it from here or the other way round.
BASIS_TURNS_AT = -0.4


def pcg_hash(v: Any) -> Any:
    """A bijective hash of 32 bits: PCG-RXS-M-XS-32, Jarzynski & Olano 2020, JCGT 9(3), listing 5."""
    return _permuted(v * MULTIPLIER + INCREMENT)


def pixel_stream(px: Any, py: Any, replica: Any) -> tuple[Any, Any]:
    """The two words of a pixel's stream; rows count from the bottom, as GL's do."""
    first = pcg_hash(px + pcg_hash(py + pcg_hash(replica)))
    return first, pcg_hash(first ^ 0x9E3779B9)


def seed_sample(stream: tuple[Any, Any], index: Any, sampler: str = "independent") -> Any:
    """The state with which sample number `index` of a stream begins, with a sampler by its name."""
    if sampler == "sobol":
        return sobol.seed_sample(stream, index)
    return pcg_hash(index ^ stream[0]) + stream[1]


def rand(state: Any) -> tuple[Any, Any]:
    """A number in [0, 1) of 24 bits, and the state after it."""
    import drjit as dr

    if _is_sobol(state):
        return sobol.rand(state)
    float32: Any = dr.float32_array_t(type(state))
    return float32(_permuted(state) >> 8) * (1.0 / 16777216.0), state * MULTIPLIER + INCREMENT


def rand2(state: Any) -> tuple[Any, Any, Any]:
    """Two numbers, and the state after them."""
    if _is_sobol(state):
        return sobol.rand2(state)
    first, state = rand(state)
    second, state = rand(state)
    return first, second, state


def _is_sobol(state: Any) -> bool:
    import drjit as dr

    return dr.depth_v(type(state)) > 1


def _permuted(state: Any) -> Any:
    word = ((state >> ((state >> 28) + 4)) ^ state) * PERMUTATION
    return (word >> 22) ^ word


def to_world(x: Any, y: Any, z: Any, axis: Any) -> Any:
    """Local coordinates, z along `axis`, in world space: Duff et al. 2017, JCGT 6(1), listing 3."""
    import drjit as dr

    s = dr.select(axis.z < BASIS_TURNS_AT, type(z)(-1.0), type(z)(1.0))
    a = -dr.rcp(s + axis.z)
    b = axis.x * axis.y * a
    vector = type(axis)
    tangent = vector(1.0 + s * axis.x * axis.x * a, s * b, -s * axis.x)
    bitangent = vector(b, s + axis.y * axis.y * a, -axis.y)
    return x * tangent + y * bitangent + z * axis


def direction_about(axis: Any, cos_theta: Any, u: Any) -> Any:
    """The direction at polar angle acos(`cos_theta`) and azimuth 2π `u` about `axis`."""
    import drjit as dr

    sin_theta = dr.sqrt(dr.maximum(0.0, 1.0 - cos_theta * cos_theta))
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u)
    return to_world(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta, axis)


def sample_uniform(n: Any, u: Any, v: Any) -> Any:
    """Uniform over the hemisphere about n."""
    return direction_about(n, u, v)


def sample_cosine(n: Any, u: Any, v: Any) -> Any:
    """Proportional to the cosine about n."""
    import drjit as dr

    return direction_about(n, dr.sqrt(1.0 - u), v)


def sample_lobe(axis: Any, alpha: Any, u: Any, v: Any) -> Any:
    """Proportional to cos^α about `axis`: Lafortune & Willems 1994, eq. 10."""
    import drjit as dr

    return direction_about(axis, dr.power(1.0 - u, 1.0 / (alpha + 1.0)), v)


@dataclass(frozen=True)
class Draw:
    """How a strategy draws directions in a scene: `sample_phong` of `lib/phong.glsl`, less its weights.

    `has_glossy`: whether any material of the scene has a lobe. Where none has, `lobes` and `mixture` draw as `cosine`.
    """

    strategy: str
    has_glossy: bool

    @property
    def by_cosine(self) -> bool:
        """Directions go by the cosine, whatever the material."""
        return self.strategy == "cosine" or (not self.has_glossy and self.strategy in ("lobes", "mixture"))

    @property
    def needs_lobe(self) -> bool:
        """The material's exponent counts, and with two lobes to choose from the lobe's probability as well."""
        return self.strategy == "phong" or self.chooses

    @property
    def chooses(self) -> bool:
        """A number is spent on the choice between the two lobes."""
        return self.has_glossy and self.strategy in ("lobes", "mixture")

    def direction(self, n: Any, v: Any, alpha: Any, p_glossy: Any, state: Any) -> tuple[Any, Any, Any]:
        """The direction from a surface with unit normal `n` towards `v`'s side, whether it comes from the lobe, and the
        state after the draw. `alpha`, `p_glossy` count where `needs_lobe` says so."""
        import drjit as dr

        no = dr.mask_t(n.z)(False)
        if self.strategy == "uniform":
            a, b, state = rand2(state)
            return sample_uniform(n, a, b), no, state
        if self.by_cosine:
            a, b, state = rand2(state)
            return sample_cosine(n, a, b), no, state
        mirror = 2.0 * dr.dot(n, v) * n - v
        if self.strategy == "phong":
            a, b, state = rand2(state)
            return sample_lobe(mirror, alpha, a, b), ~no, state
        choice, state = rand(state)
        glossy = choice < p_glossy
        a, b, state = rand2(state)
        # The cosine hemisphere is the lobe with exponent 1 about n.
        return sample_lobe(dr.select(glossy, mirror, n), dr.select(glossy, alpha, 1.0), a, b), glossy, state
