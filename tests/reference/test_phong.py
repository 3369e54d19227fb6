"""The `phong` BSDF against Mitsuba's own chi² test, against quadrature, and against the formula written in NumPy.

chi² compares samples with the pdf and says little about weights, so weights and values are tested on their own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from harness.reference.plugins import register_plugins
from harness.scene import load_scene

EXPONENTS = [0, 1, 5, 10, 50, 100, 1000]
INCIDENCES = [0, 30, 60, 75, 85]  # degrees from the normal
DIFFUSE = [0.0, 0.4]  # a lone lobe; a mixture
KS = 0.5
CHI2_CASES = len(EXPONENTS) * len(INCIDENCES) * len(DIFFUSE)
CHI2_SIGNIFICANCE = 0.01  # of the whole family, Šidák over its cases; the seeds are fixed, so no run differs


def direction(theta: float, phi: float = 0.0) -> list[float]:
    """Unit vector from degrees."""
    t, p = np.radians(theta), np.radians(phi)
    return [float(np.sin(t) * np.cos(p)), float(np.sin(t) * np.sin(p)), float(np.cos(t))]


def load(mi: Any, kd: Any, ks: Any, alpha: float) -> Any:
    """The plugin; colours as three numbers, or one."""
    def colour(value: Any) -> dict[str, Any]:
        return {"type": "rgb", "value": [float(v) for v in np.broadcast_to(value, 3)]}
    return mi.load_dict({"type": "phong", "kd": colour(kd), "ks": colour(ks), "alpha": float(alpha)})


def interaction(mi: Any, wi: Any) -> Any:
    """Surface interactions seen from `wi`: one direction, or arrays x, y, z."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(*wi)
    return si


def formula(wi: np.ndarray, wo: np.ndarray, kd: np.ndarray, ks: np.ndarray, alpha: float) -> np.ndarray:
    """f·cos as DESIGN states it, directions (N, 3), result (N, 3)."""
    mirror = wi * [-1, -1, 1]
    cos_lobe = np.sum(mirror * wo, axis=-1)
    lobe = np.where(cos_lobe > 0, np.abs(cos_lobe) ** alpha, 0.0) * (alpha + 1) / (2 * np.pi)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    return np.where(above, wo[:, 2], 0.0)[:, None] * (kd / np.pi + ks * lobe[:, None])


def lobe_albedo(alpha: float, theta: float) -> float:
    """∫ (α+1)/(2π) max(r·l, 0)^α max(n·l, 0) dl by quadrature over u = r·l, the turn about r done analytically."""
    def turn(u: float) -> float:
        a = u * np.cos(np.radians(theta))
        b = np.sqrt(1 - u * u) * np.sin(np.radians(theta))
        if a >= b:
            return 2 * np.pi * a
        end = np.arccos(-a / b)
        return 2 * (a * end + b * np.sin(end))
    kink = np.sin(np.radians(theta))  # where a = b: below it the cone about r dips under the surface
    return quad(lambda u: (alpha + 1) / (2 * np.pi) * u**alpha * turn(u), 0, 1, points=[kink, 1 - 2 / (alpha + 2)],
                limit=200, epsabs=1e-10)[0]


def fraction_above(alpha: float, theta: float) -> float:
    """The share of lobe samples above the surface: ∫ (α+1)/(2π) max(r·l, 0)^α over n·l > 0, by quadrature."""
    def turn(u: float) -> float:
        a = u * np.cos(np.radians(theta))
        b = np.sqrt(1 - u * u) * np.sin(np.radians(theta))
        return 2 * np.pi if a >= b else 2 * np.arccos(-a / b)
    kink = np.sin(np.radians(theta))
    return quad(lambda u: (alpha + 1) / (2 * np.pi) * u**alpha * turn(u), 0, 1, points=[kink, 1 - 2 / (alpha + 2)],
                limit=200, epsabs=1e-10)[0]


class LobeDomain:
    """Spherical coordinates (φ, t) about an axis, cos θ = 1 - 2 t⁴, for chi² tests of lobes far narrower than a cell.

    Mitsuba's SphericalDomain puts the whole lobe of α = 1000 into one row of cells, where its trapezoid rule is
    1 % off. The map is not area preserving: densities must be multiplied by `jacobian`.
    """

    def __init__(self, mi: Any, axis: list[float]) -> None:
        self.mi, self.frame = mi, mi.Frame3f(mi.Vector3f(axis))

    def bounds(self) -> Any:
        return self.mi.ScalarBoundingBox2f([-np.pi, 0], [np.pi, 1])

    def aspect(self) -> int:
        return 2

    def map_forward(self, p: Any) -> Any:
        import drjit as dr

        one_minus_cos = 2 * dr.square(dr.square(p.y))
        sin_theta = dr.safe_sqrt(one_minus_cos * (2 - one_minus_cos))
        sin_phi, cos_phi = dr.sincos(p.x)
        return self.frame.to_world(self.mi.Vector3f(cos_phi * sin_theta, sin_phi * sin_theta, 1 - one_minus_cos))

    def map_backward(self, d: Any) -> Any:
        import drjit as dr

        local = self.frame.to_local(d)
        sin2 = dr.square(local.x) + dr.square(local.y)
        one_minus_cos = dr.select(local.z > 0, sin2 / (1 + local.z), 1 - local.z)  # no cancellation near the axis
        return self.mi.Vector2f(dr.atan2(local.y, local.x), dr.clip(dr.sqrt(dr.sqrt(0.5 * one_minus_cos)), 0, 1))

    def jacobian(self, d: Any) -> Any:
        import drjit as dr

        t = self.map_backward(d).y
        return 8 * dr.square(t) * t


@pytest.mark.parametrize("theta", INCIDENCES)
@pytest.mark.parametrize("kd", DIFFUSE)
@pytest.mark.parametrize("alpha", EXPONENTS)
def test_samples_follow_the_pdf(mi: Any, alpha: int, kd: float, theta: float) -> None:
    """Mitsuba's own chi² test of `sample` against `pdf`, a million samples a case."""
    wi = direction(theta)
    sample, pdf = mi.chi2.BSDFAdapter("phong", {"type": "phong", "kd": kd, "ks": KS, "alpha": float(alpha)}, wi=wi)
    domain, density = mi.chi2.SphericalDomain(), pdf
    if alpha > 100:
        domain = LobeDomain(mi, [-wi[0], -wi[1], wi[2]])
        density = lambda d: pdf(d) * domain.jacobian(d)  # noqa: E731
    test = mi.chi2.ChiSquareTest(domain, sample, density, sample_dim=3, res=201 if alpha >= 100 else 101, ires=32)
    # quiet: a failing run would leave a file in the working directory; its log is shown here instead.
    assert test.run(CHI2_SIGNIFICANCE, test_count=CHI2_CASES, quiet=True), test.messages


@pytest.mark.parametrize("theta", INCIDENCES)
@pytest.mark.parametrize("alpha", EXPONENTS)
def test_sample_weights_average_to_the_albedo(mi: Any, alpha: int, theta: float) -> None:
    """E[weight] is ∫ f·cos in each channel, within 4.5 standard errors (105 comparisons: seeds are fixed)."""
    kd, ks = np.array([0.4, 0.1, 0.0]), np.array([0.3, 0.0, 0.6])
    bsdf = load(mi, kd, ks, alpha)
    count = 1 << 18
    rng = np.random.default_rng([alpha, int(theta)])
    xi = rng.random((3, count), dtype=np.float32)
    si = interaction(mi, direction(theta, 20))
    sample, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(xi[0]), mi.Point2f(xi[1], xi[2]))
    weight = np.array(weight, dtype=np.float64)
    expected = kd + ks * lobe_albedo(alpha, theta)
    error = weight.mean(axis=1) - expected
    standard_error = weight.std(axis=1) / np.sqrt(count)
    assert (np.abs(error) <= 4.5 * standard_error + 1e-6).all(), (error, standard_error)
    # Nothing under the surface carries weight.
    assert (weight[:, np.array(sample.wo)[2] <= 0] == 0).all()


@pytest.mark.parametrize("theta", INCIDENCES)
@pytest.mark.parametrize("alpha", EXPONENTS)
def test_pdf_integrates_to_the_fraction_above_the_surface(mi: Any, alpha: int, theta: float) -> None:
    """A lobe's pdf loses exactly the samples that fall under the surface, and is never renormalised."""
    diffuse, glossy = 0.25, 0.75  # lobes are chosen in proportion to kd and ks, which sum to 1 here
    bsdf = load(mi, diffuse, glossy, alpha)
    domain = LobeDomain(mi, direction(theta, 180))
    n_phi, n_t = 720, 2000  # midpoint rule; cells at the horizon, where the pdf jumps, limit it to 1e-4
    phi, t = np.meshgrid(2 * np.pi * (np.arange(n_phi) + 0.5) / n_phi - np.pi, (np.arange(n_t) + 0.5) / n_t)
    wo = domain.map_forward(mi.Vector2f(phi.ravel(), t.ravel()))
    pdf = bsdf.pdf(mi.BSDFContext(), interaction(mi, direction(theta)), wo) * domain.jacobian(wo)
    integral = np.array(pdf, dtype=np.float64).mean() * 2 * np.pi
    assert integral == pytest.approx(diffuse + glossy * fraction_above(alpha, theta), abs=5e-4)


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_values_are_the_formula(mi: Any, alpha: int) -> None:
    """`eval` is f·cos over random pairs of directions, both sides of the surface, and `eval_pdf` repeats it."""
    kd, ks = np.array([0.4, 0.1, 0.0]), np.array([0.3, 0.0, 0.6])
    bsdf = load(mi, kd, ks, alpha)
    wi, wo = random_pairs(alpha)
    si, out = interaction(mi, wi.T), mi.Vector3f(wo.T)
    value = np.array(bsdf.eval(mi.BSDFContext(), si, out)).T
    expected = formula(wi, wo, kd, ks, alpha)
    # float32: the exponent multiplies the rounding of log2(r·wo).
    np.testing.assert_allclose(value, expected, rtol=1e-5 + 1e-6 * alpha, atol=1e-6)
    both, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, out)
    np.testing.assert_array_equal(np.array(both).T, value)
    np.testing.assert_array_equal(np.array(pdf), np.array(bsdf.pdf(mi.BSDFContext(), si, out)))


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_values_are_reciprocal(mi: Any, alpha: int) -> None:
    """f(wi, wo) = f(wo, wi), the cosines divided out."""
    bsdf = load(mi, [0.4, 0.1, 0.0], [0.3, 0.0, 0.6], alpha)
    wi, wo = random_pairs(alpha)
    above = (wi[:, 2] > 0.01) & (wo[:, 2] > 0.01)
    wi, wo = wi[above], wo[above]
    forth = np.array(bsdf.eval(mi.BSDFContext(), interaction(mi, wi.T), mi.Vector3f(wo.T))) / wo[:, 2]
    back = np.array(bsdf.eval(mi.BSDFContext(), interaction(mi, wo.T), mi.Vector3f(wi.T))) / wi[:, 2]
    np.testing.assert_allclose(forth, back, rtol=1e-5 + 1e-6 * alpha, atol=1e-6)


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_lobe_albedo_at_normal_incidence(mi: Any, alpha: int) -> None:
    """A white lobe seen head on reflects (α+1)/(α+2), the price of the course's normalisation."""
    bsdf = load(mi, 0, 1, alpha)
    xi = (np.arange(1 << 16) + 0.5) / (1 << 16)
    _, weight = bsdf.sample(mi.BSDFContext(), interaction(mi, [0, 0, 1]), 0.5, mi.Point2f(0.3, mi.Float(xi)))
    assert np.array(weight, dtype=np.float64).mean() == pytest.approx((alpha + 1) / (alpha + 2), rel=1e-4)


def random_pairs(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of unit directions all over the sphere, a third of them near the mirror, where sharp lobes are."""
    rng = np.random.default_rng(seed)
    wi, wo = rng.normal(size=(30_000, 3)), rng.normal(size=(30_000, 3))
    wi /= np.linalg.norm(wi, axis=1, keepdims=True)
    wo[::3] = wi[::3] * [-1, -1, 1] + 0.05 * wo[::3]
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    return wi.astype(np.float32).astype(np.float64), wo.astype(np.float32).astype(np.float64)


def test_extremes_are_finite(mi: Any) -> None:
    """No NaN where drjit's power makes one: r·wo = 0 or negative with α = 0, ξ at its ends, black lobes."""
    for alpha in (0, 1e6):
        for kd, ks in ((0.5, 0.5), (0.0, 0.0)):
            bsdf = load(mi, kd, ks, alpha)
            si = interaction(mi, direction(45))
            wo = mi.Vector3f(*np.array([direction(45), direction(45, 180), [0, 0, 1], [1, 0, 0], [0, 0, -1]]).T)
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, wo)
            ends = np.array([0, np.float32(1) - np.finfo(np.float32).epsneg])
            x, y, lobe = (g.ravel() for g in np.meshgrid(ends, ends, ends))
            sample, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(lobe), mi.Point2f(x, y))
            for array in (value, pdf, weight, sample.wo, sample.pdf):
                assert np.isfinite(np.array(array)).all()


def test_back_is_black_unless_two_sided(mi: Any) -> None:
    """Seen from behind, the plugin neither reflects nor samples; `twosided` mirrors the front."""
    plain = {"type": "phong", "kd": 0.4, "ks": 0.5, "alpha": 10.0}
    front, back = direction(30), (-np.array(direction(30))).tolist()
    out, behind = mi.Vector3f(direction(20, 180)), -mi.Vector3f(direction(20, 180))
    ctx, xi = mi.BSDFContext(), mi.Point2f(0.3, 0.8)
    one, two = mi.load_dict(plain), mi.load_dict({"type": "twosided", "bsdf": plain})
    for seen_from, towards in ((back, behind), (back, out), (front, behind)):
        value, pdf = one.eval_pdf(ctx, interaction(mi, seen_from), towards)
        assert np.all(np.array(value) == 0) and np.all(np.array(pdf) == 0)
    assert np.all(np.array(one.sample(ctx, interaction(mi, back), 0.9, xi)[1]) == 0)
    expected = np.array(one.eval(ctx, interaction(mi, front), out))
    assert expected.min() > 0
    np.testing.assert_allclose(np.array(two.eval(ctx, interaction(mi, back), behind)), expected, rtol=1e-6)


def test_a_context_selects_lobes(mi: Any) -> None:
    """With one component switched off, values, pdf and samples are those of the other lobe alone."""
    bsdf = load(mi, 0.4, 0.5, 10)
    si, out = interaction(mi, direction(30)), mi.Vector3f(direction(20, 180))
    for component, alone in ((0, load(mi, 0.4, 0, 10)), (1, load(mi, 0, 0.5, 10))):
        ctx = mi.BSDFContext()
        ctx.component = component
        found, expected = bsdf.eval_pdf(ctx, si, out), alone.eval_pdf(mi.BSDFContext(), si, out)
        np.testing.assert_array_equal(np.array(found[0]), np.array(expected[0]))
        np.testing.assert_array_equal(np.array(found[1]), np.array(expected[1]))
        assert np.array(bsdf.sample(ctx, si, 0.5, mi.Point2f(0.1, 0.9))[0].sampled_component) == component


def test_flags_describe_two_front_side_lobes(mi: Any) -> None:
    """Mitsuba's integrators learn from the flags that both lobes are smooth and one-sided."""
    bsdf = load(mi, 0.4, 0.5, 10)
    assert bsdf.component_count() == 2
    assert bsdf.flags(0) == mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
    assert bsdf.flags(1) == mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
    assert set(mi.traverse(bsdf).keys()) == {"kd.value", "ks.value", "alpha.value"}


def test_parameters_may_be_textures(mi: Any) -> None:
    """A texture's value at the hit takes the place of the number: here a checkerboard drives kd and alpha."""
    board = {"type": "checkerboard", "color0": 0.2, "color1": 0.8}
    bsdf = mi.load_dict({"type": "phong", "kd": board, "ks": 0.5, "alpha": board})
    si, out = interaction(mi, direction(30)), mi.Vector3f(direction(20, 180))
    seen = set()
    for uv in ([0.25, 0.25], [0.25, 0.75]):
        si.uv = mi.Point2f(uv)
        value = float(mi.load_dict(board).eval(si)[0][0])
        seen.add(round(value, 3))
        expected = load(mi, value, 0.5, value).eval(mi.BSDFContext(), si, out)
        np.testing.assert_allclose(np.array(bsdf.eval(mi.BSDFContext(), si, out)), np.array(expected), rtol=1e-6)
    assert seen == {0.2, 0.8}


@pytest.mark.parametrize(("name", "value", "allowed"), [
    ("kd", -0.1, r"within \[0, 1\]"), ("kd", 1.5, r"within \[0, 1\]"), ("kd", float("nan"), r"within \[0, 1\]"),
    ("ks", -0.1, "finite and at least 0"), ("alpha", -1.0, "finite and at least 0"),
    ("alpha", float("inf"), "finite and at least 0"),
])
def test_bad_parameters_are_refused(mi: Any, name: str, value: float, allowed: str) -> None:
    """The message names the parameter, the value and what is allowed."""
    parameters = {"kd": 0.5, "ks": 0.5, "alpha": 10.0, name: value}
    with pytest.raises(RuntimeError, match=rf"phong: {name} is .*; it must be {allowed}"):
        mi.load_dict({"type": "phong", **parameters})


def test_defaults_are_the_loaders(mi: Any, tmp_path: Path) -> None:
    """A `phong` without parameters means the same to both renderers."""
    path = tmp_path / "scene.xml"
    path.write_text("""<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"/><shape type="sphere"><bsdf type="phong"/></shape></scene>""")
    material = load_scene(path).shapes[0].material
    found = mi.traverse(mi.load_dict({"type": "phong"}))
    assert material.kd == (float(found["kd.value"][0]),) * 3
    assert material.ks == (float(found["ks.value"][0]),) * 3
    assert material.alpha == float(found["alpha.value"][0])


def test_registration_survives_a_change_of_variant(mi: Any) -> None:
    """`phong` loads in every variant that is set later, and again in the first one."""
    parameters = {"type": "phong", "kd": 0.3, "ks": 0.6, "alpha": 10.0}
    values = []
    for variant in ("scalar_rgb", "llvm_ad_spectral", "llvm_ad_rgb"):
        mi.set_variant(variant)
        register_plugins()
        value = mi.load_dict(parameters).eval(
            mi.BSDFContext(), interaction(mi, direction(30)), mi.Vector3f(direction(20, 180)))
        values.append(np.ravel(np.array(value))[0])
    np.testing.assert_allclose(values, values[0], rtol=1e-5)
