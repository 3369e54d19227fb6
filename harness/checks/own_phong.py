"""The BRDF of lib/phong.glsl by its formula, and the weights of its strategies by what they must come to on average."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from harness.checks.domains import Lobe
from harness.checks.finding import Finding
from harness.checks.integral import quadrature
from harness.checks.shader import Probe, Vertex
from harness.checks.weight import weight
from harness.scene.strategies import DRAWS

VALUES = 4096  # directions at which the BRDF is held against its formula, each of them over a whole hemisphere
DRAWN = 1 << 16
POINTS = (400, 100)  # of the quadrature, good to 1e-5 of lights that are as smooth as these
ANGLES = (0.0, 40.0, 75.0)  # of the viewer to the normal, in degrees
# Materials with what chooses their lobe: matt, glossy alone, both.
VERTICES = (Vertex(1.0, 0.0, (0.8, 0.5, 0.2), (0.0, 0.0, 0.0), 0.0),
            Vertex(10.0, 0.0, (0.0, 0.0, 0.0), (0.9, 0.6, 0.3)),
            Vertex(20.0, 0.0, (0.15, 0.45, 0.18), (0.4, 0.3, 0.4), 0.45))
ALPHAS = (0.0, 1.0, 10.0, 100.0)
# Whole light: from everywhere, and more from one side than from the other; what a weight must gather of each.
LIGHTS = ("an even sky", "a sky that brightens towards +x", "a sky that brightens towards +y",
          "a sky that brightens towards the normal")
NAMES = tuple(f"{channel} under {light}" for light in LIGHTS for channel in ("red", "green", "blue"))


def findings(probe: Probe) -> Iterator[Finding]:
    """The formula first, then what each strategy gathers of four skies."""
    for alpha in ALPHAS:
        yield values(probe, alpha)
    for strategy in DRAWS:
        for vertex in VERTICES:
            if strategy == "phong" and max(vertex.kd) > 0:
                continue  # lobe-only sampling never draws most directions of a diffuse term
            for angle in ANGLES:
                yield gathered(probe, strategy, replace(vertex, angle=float(np.radians(angle))), angle)


def values(probe: Probe, alpha: float) -> Finding:
    """f(l, v) over both hemispheres and about the mirror direction, against kd/pi + ks (alpha+1)/(2 pi) cos^alpha."""
    rng = np.random.default_rng(int(alpha))
    v, l = rng.normal(size=(2, VALUES, 3))  # noqa: E741
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    v[:, 2] = np.abs(v[:, 2])
    l[::2] = v[::2] * [-1, -1, 1] + 0.05 * l[::2]
    v, l = (_exact(d / np.linalg.norm(d, axis=1, keepdims=True)) for d in (v, l))  # noqa: E741
    kd, ks = np.array([0.4, 0.1, 0.0]), np.array([0.3, 0.0, 0.6])
    rows = [np.c_[d, np.zeros(VALUES)] for d in (np.tile([0.0, 0.0, 1.0], (VALUES, 1)), v, l)]
    found = np.asarray(probe("phong.frag", *rows, outputs=3, uniforms={"kd": kd, "ks": ks, "alpha": alpha,
                       "p_glossy": 0.5, "replica": 0})[:, :3], dtype=np.float64)
    cosine = (v * [-1, -1, 1] * l).sum(axis=1)
    lobe = np.where(cosine > 0, (alpha + 1) / (2 * np.pi) * np.maximum(cosine, 1e-300)**alpha, 0.0)
    expected = kd / np.pi + ks * lobe[:, None]
    # A float32 power multiplies the rounding of its base by the exponent; at the lobe's edge its base is near 0.
    clear = np.abs(cosine) > 1e-3
    bound = 1e-4 + (1e-5 + 1e-5 * alpha / np.maximum(np.abs(cosine), 1e-2)[:, None]) * expected
    off = np.nan_to_num(np.abs(found - expected) / bound, nan=np.inf)[clear]
    row, channel = np.unravel_index(off.argmax(), off.shape)
    value, right = found[clear][row, channel], expected[clear][row, channel]
    sentence = (f"f is {value:.5g} where kd/pi + ks (alpha + 1)/(2 pi) cos^alpha is {right:.5g}: alpha = {alpha:g}, "
                f"kd = {kd[channel]:g}, ks = {ks[channel]:g}, cosine to the mirror direction {cosine[clear][row]:.3g}")
    return Finding("formula", float(value), float(right), bool(off.max() <= 1), sentence,
                   error=float(bound[clear][row, channel]), function="eval_phong")


def gathered(probe: Probe, strategy: str, vertex: Vertex, angle: float) -> Finding:
    """The mean of weight times the light from where the direction points, against its integral."""
    directions, weights = vertex.draw(probe, strategy, DRAWN, by_sample=True)
    lit = (weights[:, None, :] * _light(directions)[:, :, None]).reshape(DRAWN, -1)
    found = weight(lambda _: lit, _expected(vertex).ravel(), names=NAMES)
    share = found.value / found.expected if found.expected else np.nan
    times = f", {share:.4g} times as much" if not found.passed and np.isfinite(share) else ""
    surface = f"kd = {_shown(vertex.kd)}, ks = {_shown(vertex.ks)}, alpha = {vertex.alpha:g}"
    sentence = f"strategy '{strategy}': {found.sentence}{times}; {surface}, seen from {angle:g} degrees"
    return replace(found, function="sample_phong", sentence=sentence)


def _light(d: np.ndarray) -> np.ndarray:
    """The four lights, (N, 4), none negative."""
    return np.stack([np.ones(len(d)), 0.5 + 0.5 * d[:, 0], 0.5 + 0.5 * d[:, 1], np.maximum(d[:, 2], 0)], axis=-1)


def _expected(vertex: Vertex) -> np.ndarray:
    """∫ f cos light over the hemisphere, (4, 3)."""
    diffuse, glossy = _terms(vertex.alpha, vertex.angle)
    return diffuse[:, None] * np.array(vertex.kd) + glossy[:, None] * np.array(vertex.ks)


@functools.cache
def _terms(alpha: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """The same of kd = 1 and of ks = 1, (4,) each."""
    mirror = Vertex(alpha, angle).mirror

    def diffuse(d: np.ndarray) -> np.ndarray:
        return _light(d) * np.maximum(d[:, 2:], 0) / np.pi

    def glossy(d: np.ndarray) -> np.ndarray:
        lobe = (alpha + 1) / (2 * np.pi) * np.maximum(d @ np.array(mirror), 0)**alpha
        return _light(d) * np.maximum(d[:, 2:], 0) * lobe[:, None]

    return quadrature(diffuse, Lobe(), POINTS), quadrature(glossy, Lobe(mirror, alpha), POINTS)


def _exact(d: np.ndarray) -> np.ndarray:
    """Rounded to what float32 holds."""
    return d.astype(np.float32).astype(np.float64)


def _shown(values: tuple[float, float, float]) -> str:
    return f"({', '.join(f'{value:g}' for value in values)})"
