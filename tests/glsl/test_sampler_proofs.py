"""The shader's samplers and BRDF against Mitsuba: its own chi² test, its plugin's values; and where samples fall.

Directions and pdfs come from the shader, the tables and the statistic from `mi.chi2`. The chi² tests here would reject
a right shader, all of them together, in one of a thousand changes of the seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.course.variants import LOBE_PDF, OURS, Variant
from harness.reference.plugins import register_plugins
from harness.scene import Scene
from harness.shader.strategies import STRATEGIES
from tests.support.tracer import TracerRenderer

FAMILY = 1e-3
SAMPLERS = {"uniform": 0, "cosine": 1, "lobe": 2}
SAMPLER_CASES = [("uniform", 0.0), ("cosine", 1.0), *(("lobe", alpha) for alpha in (0.0, 1.0, 10.0, 100.0, 1000.0))]
AXES = {"111": np.ones(3) / np.sqrt(3), "tilted": np.array([-0.4, 0.5, -0.2]) / np.linalg.norm([-0.4, 0.5, -0.2])}
STRATEGY_CASES = [(strategy, alpha, angle) for strategy in STRATEGIES for alpha in (10.0, 1000.0)
                  for angle in (30.0, 85.0)]
TESTS = len(SAMPLER_CASES) * len(AXES) + len(STRATEGY_CASES)
SAMPLES = 1 << 18
# Rows of cells, half as many columns; steps of the trapezoid rule in each, for the pdf jumps inside one at the horizon.
CELLS, STEPS = 51, 20
GLOSSY = 0.6  # probability of the lobe where a strategy chooses

Evaluate = Callable[[Any], np.ndarray]


class Stretched:
    """The sphere as (φ, t) about an axis, 1 - cos θ = 2 t⁴: cells shrink towards the axis, where narrow lobes are.

    Mitsuba's SphericalDomain puts the whole lobe of α = 1000 into one row of cells. Densities are to be multiplied by
    `jacobian`.
    """

    def __init__(self, mi: Any, axis: np.ndarray) -> None:
        self.mi, self.frame = mi, mi.Frame3f(mi.Vector3f(*map(float, axis)))

    def bounds(self) -> Any:
        return self.mi.ScalarBoundingBox2f([-np.pi, 0], [np.pi, 1])

    def aspect(self) -> int:
        return 2

    def map_forward(self, p: Any) -> Any:
        import drjit as dr

        drop = 2 * dr.square(dr.square(p.y))
        sine = dr.safe_sqrt(drop * (2 - drop))
        return self.frame.to_world(self.mi.Vector3f(dr.cos(p.x) * sine, dr.sin(p.x) * sine, 1 - drop))

    def map_backward(self, d: Any) -> Any:
        import drjit as dr

        local = self.frame.to_local(d)
        drop = dr.select(local.z > 0, (dr.square(local.x) + dr.square(local.y)) / (1 + local.z), 1 - local.z)
        t = dr.sqrt(dr.sqrt(dr.clip(0.5 * drop, 0, 1)))
        return self.mi.Vector2f(dr.atan2(local.y, local.x), t)

    def jacobian(self, d: Any) -> Any:
        import drjit as dr

        t = self.map_backward(d).y
        return 8 * dr.square(t) * t


def chi2(mi: Any, axis: np.ndarray, directions: Evaluate, pdf: Evaluate) -> Any:
    """`mi.chi2.ChiSquareTest` of directions (N, 3) from two uniform numbers, against their pdf; not yet run."""
    domain = Stretched(mi, axis)

    def sample(u: Any) -> Any:
        drawn = np.float32(directions(u))
        assert np.isfinite(drawn).all()  # of NaN the histogram would take whatever cell, outside its memory too
        return mi.Vector3f(*drawn.T)

    return mi.chi2.ChiSquareTest(
        domain, sample, lambda d: mi.Float(np.float32(pdf(d))) * domain.jacobian(d),
        sample_count=SAMPLES, res=CELLS, ires=STEPS)


def columns(*arrays: Any) -> np.ndarray:
    """Arrays of drjit or NumPy, or numbers, side by side as a probe's input (N, 4)."""
    broadcast = np.broadcast_arrays(*map(np.asarray, arrays), *[0.0] * (4 - len(arrays)))
    return np.stack(broadcast, axis=-1)


def lobe_pdf(variant: Variant, cosine: np.ndarray, alpha: float) -> np.ndarray:
    """The shader's three pdfs (N, 3) at cosines (N,)."""
    return variant.probe("pdf.frag", columns(cosine, alpha))[:, :3]


def sampler_test(mi: Any, sampler: str, alpha: float, axis: np.ndarray, variant: Variant = OURS) -> Any:
    """Directions from the variant's sampler about an axis, against the variant's own pdf."""
    frame = np.float32(axis).astype(float)

    def directions(u: Any) -> np.ndarray:
        return variant.probe("sampling.frag", columns(*frame, np.full(SAMPLES, alpha)), columns(u.x, u.y),
                             defines={"SAMPLER": SAMPLERS[sampler]})[:, :3]

    def pdf(d: Any) -> np.ndarray:
        return lobe_pdf(variant, np.array(d).T @ frame, alpha)[:, SAMPLERS[sampler]]

    return chi2(mi, frame, directions, pdf)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("sampler", "alpha"), SAMPLER_CASES)
def test_samplers_follow_their_pdfs(mi: Any, sampler: str, alpha: float, axis: str) -> None:
    test = sampler_test(mi, sampler, alpha, AXES[axis])
    assert test.run(FAMILY, test_count=TESTS, quiet=True), test.messages


@pytest.mark.parametrize(("strategy", "alpha", "angle"), STRATEGY_CASES)
def test_strategies_follow_their_pdfs(mi: Any, strategy: str, alpha: float, angle: float) -> None:
    """The directions that the estimator goes on in, those below the surface included, for a viewer at `angle`.

    lobes and mixture draw from the same pair of terms; they differ in what they divide by.
    """
    normal, mirror = np.array([0.0, 0.0, 1.0]), np.array([-np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])

    def directions(u: Any) -> np.ndarray:
        n, v = columns(*normal, np.zeros(SAMPLES)), columns(*(mirror * [-1, 1, 1]), np.zeros(SAMPLES))
        material = {"kd": (0.4, 0.4, 0.4), "ks": (0.6, 0.6, 0.6), "alpha": alpha, "p_glossy": GLOSSY, "replica": 5}
        found = OURS.probe("phong.frag", n, v, v, outputs=3, uniforms=material,
                           defines={"STRATEGY": STRATEGIES.index(strategy)})
        return found[:, 4:7]

    def pdf(d: Any) -> np.ndarray:
        at = np.array(d).T
        uniform, cosine = lobe_pdf(OURS, at @ normal, alpha)[:, :2].T
        lobe = lobe_pdf(OURS, at @ mirror, alpha)[:, 2]
        mixed = (1 - GLOSSY) * cosine + GLOSSY * lobe
        return {"uniform": uniform, "cosine": cosine, "phong": lobe, "lobes": mixed, "mixture": mixed}[strategy]

    test = chi2(mi, mirror if strategy in ("phong", "lobes", "mixture") else normal, directions, pdf)
    assert test.run(FAMILY, test_count=TESTS, quiet=True), test.messages


@pytest.mark.parametrize("alpha", [1.0, 10.0, 1000.0])
def test_the_same_test_rejects_the_handouts_pdf(mi: Any, alpha: float) -> None:
    """Over π² where 2π belongs, with directions that are right."""
    assert not sampler_test(mi, "lobe", alpha, AXES["111"], LOBE_PDF).run(FAMILY, test_count=TESTS, quiet=True)


def test_the_same_test_rejects_an_exponent_five_percent_off(mi: Any) -> None:
    """Directions for α = 105 against the pdf for 100."""
    axis = np.float32(AXES["tilted"]).astype(float)
    test, other = (sampler_test(mi, "lobe", alpha, axis) for alpha in (100.0, 105.0))
    test.sample_func = other.sample_func
    assert not test.run(FAMILY, test_count=TESTS, quiet=True)


@pytest.mark.parametrize("alpha", [0.0, 1.0, 10.0, 1000.0])
def test_the_brdf_has_the_plugins_values(mi: Any, alpha: float) -> None:
    """f(l, v) against the `phong` plugin's eval, which includes the cosine, all over the hemisphere and in the lobe."""
    register_plugins()
    import drjit as dr

    kd, ks = (0.4, 0.1, 0.0), (0.3, 0.0, 0.6)
    rng = np.random.default_rng(int(alpha))
    v, light = rng.normal(size=(2, 20_000, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    light[::2] = v[::2] * [-1, -1, 1] + 0.05 * light[::2]
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    v[:, 2], light[:, 2] = np.abs(v[:, 2]), np.abs(light[:, 2])
    v, light = np.float32(v), np.float32(light)
    material = {"kd": kd, "ks": ks, "alpha": alpha, "p_glossy": 0.5, "replica": 0}
    found = OURS.probe("phong.frag", columns(0.0, 0.0, 1.0, np.zeros(len(v))), columns(*v.T), columns(*light.T),
                       outputs=3, uniforms=material)[:, :3]
    bsdf = mi.load_dict({"type": "phong", "kd": {"type": "rgb", "value": list(kd)}, "alpha": alpha,
                         "ks": {"type": "rgb", "value": list(ks)}})
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(*v.T)
    theirs = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*light.T))).T / light[:, 2:]
    # Two float32 powers: each multiplies the rounding of its base by the exponent.
    np.testing.assert_allclose(found, theirs, rtol=1e-5 + 4e-7 * alpha, atol=2e-6)


GRID = 4  # parts of a pixel, each way
BATCH, BATCHES = 128, 512
PER_SCENE = 8  # parts lit at once: a channel's sum in float32 holds three counts of up to BATCH
PIXEL = """<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm"><rfilter type="box"/>
    <integer name="width" value="1"/><integer name="height" value="1"/></film></sensor>"""


def lamps(first: int) -> str:
    """A lamp over each of the pixel's parts from `first` on, each worth its own digit of its own channel."""
    half = np.tan(np.radians(20))
    shapes = []
    for digit in range(PER_SCENE):
        row, column = divmod(first + digit, GRID)
        x, y = half * (1 - 2 * (column + 0.5) / GRID), half * (1 - 2 * (row + 0.5) / GRID)
        radiance = np.zeros(3, dtype=int)
        radiance[digit // 3] = (BATCH + 1) ** (digit % 3)
        shapes.append(f"""<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/>
            <scale value="{half / GRID}"/><translate x="{x}" y="{y}" z="1"/></transform><bsdf type="diffuse"/>
            <emitter type="area"><rgb name="radiance" value="{', '.join(map(str, radiance))}"/></emitter></shape>""")
    return "".join(shapes)


def part_counts(loaded: Scene) -> np.ndarray:
    """How many samples of BATCHES batches fell on each of a scene's lamps, (PER_SCENE,)."""
    renderer = TracerRenderer(loaded, "cosine")
    digit = np.arange(PER_SCENE)
    counts = np.zeros(PER_SCENE)
    for replica in range(BATCHES):
        sums = np.rint(renderer.render_batch(replica, 0, BATCH).mean[0, 0].astype(float) * BATCH).astype(int)
        counts += sums[digit // 3] // (BATCH + 1) ** (digit % 3) % (BATCH + 1)
    renderer.release()
    return counts


def test_samples_fill_the_pixel(scene: Any) -> None:
    """As rendered, the places of samples in a pixel are uniform: χ² over its parts, false once in 10,000 seeds."""
    parts = [part_counts(scene(lamps(first), sensor=PIXEL)) for first in range(0, GRID * GRID, PER_SCENE)]
    counts = np.concatenate(parts)
    assert counts.sum() == pytest.approx(BATCH * BATCHES, abs=4)  # a seam between lamps may lose a sample
    assert stats.chisquare(counts).pvalue > 1e-4
