"""The shader's samplers against their pdfs, its BRDF against Mitsuba's plugin; and where samples fall in a pixel.

The χ² tests here would reject a right shader, all of them together, in one of a thousand changes of the seeds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.checks import Crowded, Finding, chi2, shared_level
from harness.checks.domains import UP, Axis
from harness.checks.shader import Probe, Vertex, sampler
from harness.course.variants import LOBE_PDF
from harness.reference.plugins import register_plugins
from harness.scene import Scene
from harness.scene.strategies import DRAWS
from tests.support.tracer import TracerRenderer, evaluate

FAMILY = 1e-3
SAMPLER_CASES = [("uniform", 0.0), ("cosine", 1.0), *(("lobe", alpha) for alpha in (0.0, 1.0, 10.0, 100.0, 1000.0))]
AXES: dict[str, Axis] = {name: (float(x), float(y), float(z)) for name, (x, y, z) in (
    ("111", np.float32(np.ones(3) / np.sqrt(3))),
    ("tilted", np.float32(np.array([-0.4, 0.5, -0.2]) / np.linalg.norm([-0.4, 0.5, -0.2]))))}
STRATEGY_CASES = [(strategy, alpha, angle) for strategy in DRAWS for alpha in (10.0, 1000.0)
                  for angle in (30.0, 85.0)]
TESTS = len(SAMPLER_CASES) * len(AXES) + len(STRATEGY_CASES)
GLOSSY = 0.6  # probability of the lobe where a strategy chooses
LEVEL = shared_level(FAMILY, TESTS)


def columns(*arrays: Any) -> np.ndarray:
    """Arrays of drjit or NumPy, or numbers, side by side as a probe's input (N, 4)."""
    broadcast = np.broadcast_arrays(*map(np.asarray, arrays), *[0.0] * (4 - len(arrays)))
    return np.stack(broadcast, axis=-1)


def sampler_chi2(name: str, alpha: float, axis: Axis, probe: Probe = evaluate) -> Finding:
    """Directions from a library's sampler about an axis, against its own pdf."""
    sample, pdf = sampler(probe, name, axis, alpha)
    return chi2(sample, pdf, Crowded(axis), level=LEVEL)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("name", "alpha"), SAMPLER_CASES)
def test_samplers_follow_their_pdfs(name: str, alpha: float, axis: str) -> None:
    found = sampler_chi2(name, alpha, AXES[axis])
    assert found.passed, found.sentence


@pytest.mark.parametrize(("strategy", "alpha", "angle"), STRATEGY_CASES)
def test_strategies_follow_their_pdfs(strategy: str, alpha: float, angle: float) -> None:
    """The directions that the estimator goes on in, those below the surface included, for a viewer at `angle`."""
    vertex = Vertex(alpha, np.radians(angle).item(), kd=(0.4, 0.4, 0.4), ks=(0.6, 0.6, 0.6), share=GLOSSY)
    sample, pdf = vertex.sampler(evaluate, strategy, replica=5)
    found = chi2(sample, pdf, Crowded(vertex.mirror if strategy in ("phong", "lobes", "mixture") else UP), level=LEVEL)
    assert found.passed, found.sentence


@pytest.mark.parametrize("alpha", [1.0, 10.0, 1000.0])
def test_the_same_test_rejects_the_handouts_pdf(alpha: float) -> None:
    """Over π² where 2π belongs, with directions that are right."""
    assert not sampler_chi2("lobe", alpha, AXES["111"], LOBE_PDF.probe).passed


def test_the_same_test_rejects_an_exponent_five_percent_off() -> None:
    """Directions for α = 105 against the pdf for 100."""
    axis = AXES["tilted"]
    sample, _ = sampler(evaluate, "lobe", axis, 105.0)
    _, pdf = sampler(evaluate, "lobe", axis, 100.0)
    assert not chi2(sample, pdf, Crowded(axis), level=LEVEL).passed


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
    found = evaluate("phong.frag", columns(0.0, 0.0, 1.0, np.zeros(len(v))), columns(*v.T), columns(*light.T),
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
