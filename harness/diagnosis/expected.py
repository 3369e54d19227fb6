"""What the functions of glsl/lib/ should return for arguments that were recorded, in float64: written from the papers
that they cite, not from their text."""

from __future__ import annotations

import numpy as np

# O'Neill 2014 (PCG-RXS-M-XS-32): the step of the generator and its output permutation.
_FACTOR, _INCREMENT, _OUTPUT = 747796405, 2891336453, 277803737
_SECOND_KEY = 0x9E3779B9
# Of an axis's z, where Duff's basis changes its sign: no face along the axes has a normal there.
TURNS_AT = -0.4


def uint32(halves: np.ndarray) -> np.ndarray:
    """Integers (N,) from their upper and lower halves (N, 2)."""
    return (halves[:, 0].astype(np.uint64) << np.uint64(16) | halves[:, 1].astype(np.uint64)).astype(np.uint32)


def advance(state: np.ndarray, steps: int = 1) -> np.ndarray:
    """The generator's state, uint32, so many numbers later."""
    for _ in range(steps):
        state = _wrap(state.astype(np.uint64) * _FACTOR + _INCREMENT)
    return state


def output(state: np.ndarray) -> np.ndarray:
    """The 32 bits that a state gives."""
    shift = (state >> np.uint32(28)) + np.uint32(4)
    word = _wrap(((state >> shift) ^ state).astype(np.uint64) * _OUTPUT)
    return (word >> np.uint32(22)) ^ word


def pcg_hash(value: np.ndarray) -> np.ndarray:
    """Jarzynski & Olano 2020, listing 5."""
    return output(advance(value.astype(np.uint32)))


def number(state: np.ndarray) -> np.ndarray:
    """The number in [0, 1), float64, that `rand` makes of a state."""
    return (output(state) >> np.uint32(8)) * 2.0**-24


def pixel_stream(x: np.ndarray, y: np.ndarray, replica: int) -> tuple[np.ndarray, np.ndarray]:
    """Two words for each pixel, (0, 0) at the bottom left, uint32."""
    inner = pcg_hash(np.full(x.shape, replica, dtype=np.uint32))
    a = pcg_hash(_wrap(x.astype(np.uint64) + pcg_hash(_wrap(y.astype(np.uint64) + inner))))
    return a, pcg_hash(a ^ np.uint32(_SECOND_KEY))


def seed(stream: tuple[np.ndarray, np.ndarray], index: int) -> np.ndarray:
    """The state from which a sample's numbers are drawn."""
    first, second = stream
    return _wrap(pcg_hash(first ^ np.uint32(index)).astype(np.uint64) + second)


def frame(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tangent and bitangent, (N, 3), about unit axes: Duff et al. 2017, listing 3, whose sign changes at TURNS_AT."""
    x, y, z = axis.astype(np.float64).T
    sign = np.where(z < TURNS_AT, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1),
            np.stack([b, sign + y * y * a, -y], axis=-1))


def mirrored(normal: np.ndarray, viewer: np.ndarray) -> np.ndarray:
    """The mirror images of directions about normals, (N, 3)."""
    return 2 * (normal * viewer).sum(axis=1, keepdims=True) * normal - viewer


def polar_cosine(sampler: np.ndarray, exponent: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The cosine to its axis that a sampler (1 uniform, 2 cosine, 3 lobe) draws with its first number u, (N,)."""
    with np.errstate(all="ignore"):
        lobe = (1 - u) ** (1 / (exponent + 1))
    return np.where(sampler == 1, u, np.where(sampler == 2, np.sqrt(1 - u), lobe))


def lobe_pdf(cosine: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """Lafortune & Willems 1994, eq. 10, per steradian, (N,)."""
    cosine, exponent = np.asarray(cosine, dtype=np.float64), np.asarray(exponent, dtype=np.float64)
    return np.where(cosine > 0, (exponent + 1) / (2 * np.pi) * np.maximum(cosine, 1e-300)**exponent, 0.0)


def glossy_share(kd: np.ndarray, ks: np.ndarray) -> np.ndarray:
    """The probability of the lobe, (N,): its share of what the two terms reflect at most."""
    diffuse, glossy = kd.max(axis=1), ks.max(axis=1)
    both = diffuse + glossy
    return np.where(both > 0, glossy / np.where(both > 0, both, 1), 0.0)


def brdf(kd: np.ndarray, ks: np.ndarray, lobe: np.ndarray) -> np.ndarray:
    """The course's BRDF, (N, 3), of directions with this density of the lobe."""
    return kd / np.pi + ks * lobe[:, None]


def weight(drawn: str, value: np.ndarray, kd: np.ndarray, ks: np.ndarray, share: np.ndarray, cosine: np.ndarray,
           lobe: np.ndarray, glossy: np.ndarray) -> np.ndarray:
    """f cos / pdf of directions, (N, 3), zero below the surface.

    `drawn`: the strategy; `value`: f cos; `share` of the lobe; `cosine` to the normal; `lobe`: the lobe's density;
    `glossy`: by which term `lobes` drew them.
    """
    diffuse = np.maximum(cosine, 0) / np.pi
    if drawn == "lobes":
        # Each term against its own density, of which only the share is left: in a lobe's tail both are tiny.
        whole = np.where(glossy[:, None], ks * (cosine / share)[:, None], kd / (1 - share)[:, None])
    else:
        density = {"uniform": 0.5 / np.pi, "cosine": diffuse, "phong": lobe,
                   "mixture": (1 - share) * diffuse + share * lobe}[drawn]
        whole = value / np.broadcast_to(density, len(cosine))[:, None]
    return np.where(np.isfinite(whole) & (cosine > 0)[:, None], whole, 0.0)


def scattered(drawn: str, normal: np.ndarray, mirror: np.ndarray, share: np.ndarray, alpha: np.ndarray,
              numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) that a strategy draws by numbers (N, 3), and by which term, (N,)."""
    glossy = {"lobes": numbers[:, 0] < share, "mixture": numbers[:, 0] < share}.get(
        drawn, np.full(len(normal), drawn == "phong"))
    axis = np.where(glossy[:, None], mirror, normal)
    sampler = np.full(len(normal), {"uniform": 1, "cosine": 2}.get(drawn, 3))
    cosine = polar_cosine(sampler, np.where(glossy, alpha, 1.0), numbers[:, 1])
    tangent, bitangent = frame(axis)
    return about(axis, tangent, bitangent, cosine, numbers[:, 2]), glossy


def about(axis: np.ndarray, tangent: np.ndarray, bitangent: np.ndarray, cosine: np.ndarray,
          u: np.ndarray) -> np.ndarray:
    """Directions (N, 3) at a polar cosine and the azimuth 2π u in a basis."""
    phi, sine = 2 * np.pi * u[:, None], np.sqrt(np.maximum(0, 1 - cosine**2))[:, None]
    turned: np.ndarray = np.cos(phi) * tangent + np.sin(phi) * bitangent
    return sine * turned + cosine[:, None] * axis


def _wrap(value: np.ndarray) -> np.ndarray:
    return (value & np.uint64(0xFFFFFFFF)).astype(np.uint32)
