"""Exhibits that make the estimator wrong: the lobe's pdf, the mirror direction, the frame, samples below ground."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from harness.api import render_reference
from harness.course import checks
from harness.course.texts import exhibit
from harness.course.variants import BELOW, LOBE_PDF, OURS, REFLECT, REFLECT_REPAIRED, TANGENT, Variant
from harness.errors import ShaderError
from harness.files import data_dir
from harness.metrics import signed_relative_difference
from harness.policy import judge
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.samples.estimate import Estimate, merge
from harness.samples.store import Store
from harness.scene import Scene, load_scene
from harness.stats.bias import MeanErrorVerdict

# Samples per pixel that decide ±0.2 % on every scene here, and the size at which the report prints them.
SPP, REFERENCE_SPP = 256, 512
WIDTH, HEIGHT = 192, 144

ALPHA = 10.0  # exponent of the lobe that probes look at
GRAZING, SLANTED = np.radians(80.0).item(), np.radians(60.0).item()  # angles of their viewers
INTEGRAL_TOLERANCE = 1e-3  # of a pdf's integral; the quadrature is good to 1e-6
ORTHONORMAL = 1e-5  # largest entry of |FᵀF - 1| of a frame in float32

Comparison = tuple[Scene, Estimate, Estimate, Estimate]  # handout's render, ours, the reference


@cache
def scene_of(name: str) -> Scene:
    """A bundled scene at the size of the exhibits."""
    return load_scene(data_dir("mitsuba_scenes") / f"{name}.xml", width=WIDTH, height=HEIGHT)


def mean_error(measures: str, handout: MeanErrorVerdict, ours: MeanErrorVerdict) -> Finding:
    """The equivalence verdict on the image's mean, told by the error of luminance."""
    errors = [verdict.luminance[0] for verdict in (handout, ours)]
    return Finding("mean error", measures, errors[0], errors[1], "error", handout.outcome == "fail",
                   ours.outcome == "pass")


def percentage(finding: Finding) -> float:
    """The handout's number of a finding, in percent."""
    assert isinstance(finding.handout, float)
    return 100 * finding.handout


def lobe_pdf(store: Store | None) -> Exhibit:
    """π² where 2π belongs."""
    wrong, right = (checks.pdf_integral(variant, ALPHA) for variant in (LOBE_PDF, OURS))
    misfit, fit = (
        checks.direction_chi2(checks.lobe_directions(variant, ALPHA, SLANTED)[0],
                              checks.probed_lobe_pdf(variant, ALPHA, SLANTED)) for variant in (LOBE_PDF, OURS))
    compared = _compared("spheres", "mixture", LOBE_PDF, store)
    scene, *_, reference = compared
    cancelled = judge(LOBE_PDF.render(scene, "lobes", SPP, store), reference)
    findings = (
        Finding("pdf integral", f"∫ pdf over the sphere, α = {ALPHA:g}", wrong, right, "number",
                abs(wrong - 1) > INTEGRAL_TOLERANCE, abs(right - 1) < INTEGRAL_TOLERANCE),
        Finding("direction χ²", "χ² per degree of freedom of drawn directions against the pdf", misfit[0], fit[0],
                "number", misfit[1] < checks.LEVEL, fit[1] > checks.LEVEL),
        mean_error("plates with nothing but a lobe against their closed form", _plates(LOBE_PDF), _plates(OURS)),
        _image_error("spheres with mixture against Mitsuba", compared))
    return exhibit("lobe-pdf", findings, _pictures(compared), lobe=percentage(findings[2]),
                   cancelled=100 * float(np.abs(cancelled.error).max()))


def _plates(variant: Variant) -> MeanErrorVerdict:
    """furnace_phong's four plates by lobe-only sampling against ks (α+1)/(α+2), their borders left out."""
    scene = load_scene(data_dir("mitsuba_scenes") / "furnace_phong.xml", width=64, height=64)
    half = scene.width // 2
    inside = np.zeros(half, dtype=bool)
    inside[half // 8:-half // 8] = True
    mask = np.tile(np.outer(inside, inside), (2, 2))
    exact = np.zeros((scene.height, scene.width, 3))
    for index, shape in enumerate(scene.shapes):  # upper row first, each from the left
        material = shape.material
        assert isinstance(material.ks, tuple) and isinstance(material.alpha, float | int)
        row, column = divmod(index, 2)
        albedo = np.array(material.ks) * (material.alpha + 1) / (material.alpha + 2)
        exact[row * half:(row + 1) * half, column * half:(column + 1) * half] = albedo
    renderer = variant.renderer(scene, "phong")
    try:
        batches = [renderer.render_batch(0, start, 32) for start in range(0, 8 * 32, 32)]
    finally:
        renderer.release()
    found = merge(dataclasses.replace(batch, mean=batch.mean[mask][None]) for batch in batches)
    return judge(found, Estimate.exact(exact[mask][None]))


def compiler_message(variant: Variant) -> str:
    """What the driver says of the variant's path tracer, in our files and lines; nothing where it compiles."""
    try:
        variant.renderer(scene_of("spheres"), "mixture").release()
    except ShaderError as error:
        return str(error)
    return ""


def reflect(store: Store | None) -> Exhibit:
    """max(reflect(l,n),0.0), and what a hasty repair makes of it."""
    wrong, right = compiler_message(REFLECT), compiler_message(OURS)
    exact = checks.lobe_albedo(ALPHA, SLANTED)
    compared = _compared("spheres", "mixture", REFLECT_REPAIRED, store)
    findings = (
        Finding("compilation", "the path tracer with it", "does not compile" if wrong else "compiles",
                "does not compile" if right else "compiles", "words", wrong != "", right == ""),
        expected_weight(f"hasty repair: albedo of a lobe at 60°, relative to the exact {exact:.3f}", REFLECT_REPAIRED,
                        SLANTED),
        _image_error("hasty repair: spheres against Mitsuba", compared))
    return exhibit("reflect", findings, _pictures(compared, "Hasty repair"), message=wrong,
                   error=percentage(findings[-1]))


def tangent(store: Store | None) -> Exhibit:
    """A frame that does not exist about (1,1,1)."""
    axes = frame_axes()
    wrong, right = (int((checks.frame_defects(variant, axes) > ORTHONORMAL).sum()) for variant in (TANGENT, OURS))
    compared = _compared("exhibits/tangent", "mixture", TANGENT, store)
    _, handout, ours, _ = compared
    findings = (
        Finding("orthonormal frame", f"axes without an orthonormal frame, of {len(axes):,}", wrong, right, "count",
                wrong > 0, right == 0),
        Finding("finite samples", "samples that were not finite", handout.rejected, ours.rejected, "count",
                handout.rejected > 0, ours.rejected == 0),
        _image_error("panels with mixture against Mitsuba", compared))
    angles = np.geomspace(1e-6, 0.3, 60)
    lines = [Series(name, variant is OURS, angles, _near_diagonal(variant, angles))
             for name, variant in (("handout", TANGENT), ("ours", OURS))]
    plot = Plot("Deviation of the frame from orthonormal", "angle from (1,1,1), radians", "xy", tuple(lines))
    return exhibit("tangent", findings, _pictures(compared), [plot], lost=handout.rejected)


def frame_axes() -> np.ndarray:
    """Axes about which a frame must exist: 10,000 at random, and the 26 along edges and diagonals of the cube."""
    corners = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    axes = np.concatenate([np.random.default_rng(1).normal(size=(10_000, 3)), corners[np.any(corners != 0, axis=1)]])
    unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return unit.astype(np.float32).astype(np.float64)


def _near_diagonal(variant: Variant, angles: np.ndarray) -> np.ndarray:
    """The median defect of 64 frames at each angle (N,) from (1,1,1); no less than half a float32 spacing."""
    turn = np.arange(64) / 64 * 2 * np.pi
    x, y, z = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6), np.ones(3) / np.sqrt(3)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    axes = np.cos(angles)[:, None, None] * z + np.sin(angles)[:, None, None] * around
    defects = checks.frame_defects(variant, axes.reshape(-1, 3))
    return np.maximum(np.median(defects.reshape(len(angles), -1), axis=1), 2.0**-25)


def below_surface(store: Store | None) -> Exhibit:
    """What becomes of the lobe's samples under the horizon."""
    scene = scene_of("exhibits/grazing")
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    ours = OURS.render(scene, "phong", SPP, store)
    renders = {name: variant.render(scene, "phong", SPP, store) for name, variant in BELOW.items()}
    exact, pdf = checks.lobe_albedo(ALPHA, GRAZING), checks.probed_lobe_pdf(OURS, ALPHA, GRAZING)
    directions = checks.lobe_directions(OURS, ALPHA, GRAZING)[0]
    fit = checks.direction_chi2(directions, pdf)
    findings = []
    for name, variant in BELOW.items():
        misfit = checks.direction_chi2(checks.lobe_directions(variant, ALPHA, GRAZING)[0], pdf)
        findings += [
            mean_error(f"{name}: floor and spheres with phong against Mitsuba", judge(renders[name], reference),
                       judge(ours, reference)),
            expected_weight(f"{name}: albedo of a lobe at 80°, relative to the exact {exact:.3f}", variant, GRAZING),
            Finding("direction χ²", f"{name}: χ² per degree of freedom against the pdf", misfit[0], fit[0], "number",
                    misfit[1] < checks.LEVEL, fit[1] > checks.LEVEL)]
    shown = {**renders, "ours": ours}
    images = [ExhibitImage("Drawn again", renders["drawn again"].mean), ExhibitImage("Ours", ours.mean),
              ExhibitImage("Mitsuba", reference.mean)]
    images += [ExhibitImage(name.capitalize(), signed_relative_difference(shown[name].mean, reference.mean), "relative")
               for name in ("ours", *renders)]
    errors = [percentage(finding) for finding in findings if finding.check == "mean error"]
    return exhibit("below-surface", findings, images, alpha=ALPHA, share=100 * float((directions[:, 2] <= 0).mean()),
                   least=min(errors), most=max(errors))


def expected_weight(measures: str, variant: Variant, angle: float) -> Finding:
    """E[f cos / pdf] of a white lobe by lobe sampling over its albedo, less one, of a variant and of the library.

    The check allows five standard errors, which a right shader exceeds once in two million.
    """
    exact = checks.lobe_albedo(ALPHA, angle)
    errors, within = [], []
    for shader in (variant, OURS):
        weights = checks.lobe_directions(shader, ALPHA, angle)[1]
        errors.append(float(weights.mean() / exact - 1))
        within.append(bool(abs(errors[-1]) <= 5 * weights.std() / np.sqrt(len(weights)) / exact))
    return Finding("expected weight", measures, errors[0], errors[1], "error", not within[0], within[1])


def _compared(name: str, strategy: str, variant: Variant, store: Store | None) -> Comparison:
    scene = scene_of(name)
    return (scene, variant.render(scene, strategy, SPP, store), OURS.render(scene, strategy, SPP, store),
            render_reference(scene, REFERENCE_SPP, store=store))


def _image_error(measures: str, compared: Comparison) -> Finding:
    _, handout, ours, reference = compared
    return mean_error(measures, judge(handout, reference), judge(ours, reference))


def _pictures(compared: Comparison, title: str = "Handout") -> tuple[ExhibitImage, ...]:
    _, handout, ours, reference = compared
    return (ExhibitImage(title, handout.mean), ExhibitImage("Ours", ours.mean),
            ExhibitImage("Mitsuba", reference.mean),
            ExhibitImage("Relative difference", signed_relative_difference(handout.mean, reference.mean), "relative"))
