"""Exhibits that make the estimator wrong: the lobe's pdf, the mirror direction, the frame, samples below ground."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from harness import checks
from harness.api import render_reference
from harness.checks.chi2 import COUNT
from harness.checks.domains import UP
from harness.checks.frame import axes
from harness.checks.shader import Vertex, frames, lobe_albedo, sampler
from harness.course.texts import exhibit
from harness.course.variants import BELOW, LOBE_PDF, OURS, REFLECT, REFLECT_REPAIRED, TANGENT, Variant
from harness.errors import ShaderError
from harness.estimators.tracer import Tracer
from harness.metrics import signed_relative_difference
from harness.policy import judge
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.samples.estimate import Estimate, merge
from harness.samples.store import Store
from harness.scene import Scene, SceneFile, load
from harness.stats.bias import CHANNELS, MeanErrorVerdict

# Samples per pixel that decide ±0.2 % on every scene here, and the size at which the report prints them.
SPP, REFERENCE_SPP = 256, 512
WIDTH, HEIGHT = 192, 144

ALPHA = 10.0  # exponent of the lobe that probes look at
GRAZING, SLANTED = np.radians(80.0).item(), np.radians(60.0).item()  # angles of their viewers

Comparison = tuple[Scene, Estimate, Estimate, Estimate]  # handout's render, ours, the reference


@cache
def scene_of(name: str) -> Scene:
    """A bundled scene at the size of the exhibits."""
    return load(SceneFile.bundled(name, (WIDTH, HEIGHT)))


def mean_error(measures: str, handout: MeanErrorVerdict, ours: MeanErrorVerdict) -> Finding:
    """The equivalence verdict on the image's mean, told by the error of luminance."""
    errors = [float(verdict.error[CHANNELS.index("luminance")]) for verdict in (handout, ours)]
    return Finding("mean error", measures, errors[0], errors[1], "error", handout.outcome == "fail",
                   ours.outcome == "pass")


def percentage(finding: Finding) -> float:
    """The handout's number of a finding, in percent."""
    assert isinstance(finding.handout, float)
    return 100 * finding.handout


def lobe_pdf(store: Store | None) -> Exhibit:
    """π² where 2π belongs."""
    wrong, right = (pdf_integral(variant, ALPHA) for variant in (LOBE_PDF, OURS))
    misfit, fit = (direction_chi2(variant, variant, SLANTED) for variant in (LOBE_PDF, OURS))
    compared = _compared("spheres", "mixture", LOBE_PDF, store)
    scene, *_, reference = compared
    cancelled = judge(LOBE_PDF.render(scene, "lobes", SPP, store), reference)
    findings = (
        _both("pdf integral", f"∫ pdf over the sphere, α = {ALPHA:g}", wrong, right),
        _both("direction χ²", "χ² per degree of freedom of drawn directions against the pdf", misfit, fit),
        mean_error("plates with nothing but a lobe against their closed form", _plates(LOBE_PDF), _plates(OURS)),
        _image_error("spheres with mixture against Mitsuba", compared))
    return exhibit("lobe-pdf", findings, _pictures(compared), lobe=percentage(findings[2]),
                   cancelled=100 * float(np.abs(cancelled.error).max()))


def _plates(variant: Variant) -> MeanErrorVerdict:
    """furnace_phong's four plates by lobe-only sampling against ks (α+1)/(α+2), their borders left out."""
    scene = load(SceneFile.bundled("furnace_phong", (64, 64)))
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
    with Tracer("phong", variant.library).open(scene.file) as renderer:
        batches = [renderer.render_batch(0, start, 32) for start in range(0, 8 * 32, 32)]
    found = merge(dataclasses.replace(batch, mean=batch.mean[mask][None]) for batch in batches)
    return judge(found, Estimate.exact(exact[mask][None]))


def compiler_message(variant: Variant) -> str:
    """What the driver says of the variant's path tracer, in our files and lines; nothing where it compiles."""
    try:
        with Tracer("mixture", variant.library).open(scene_of("spheres").file):
            return ""
    except ShaderError as error:
        return str(error)


def reflect(store: Store | None) -> Exhibit:
    """max(reflect(l,n),0.0), and what a hasty repair makes of it."""
    wrong, right = compiler_message(REFLECT), compiler_message(OURS)
    exact = lobe_albedo(ALPHA, SLANTED)
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
    wrong, right = (checks.frame(frames(variant.probe)) for variant in (TANGENT, OURS))
    compared = _compared("exhibits/tangent", "mixture", TANGENT, store)
    _, handout, ours, _ = compared
    findings = (
        Finding("orthonormal frame", f"axes without an orthonormal frame, of {len(axes()):,}", int(wrong.value),
                int(right.value), "count", not wrong.passed, right.passed),
        Finding("finite samples", "samples that were not finite", handout.rejected, ours.rejected, "count",
                handout.rejected > 0, ours.rejected == 0),
        _image_error("panels with mixture against Mitsuba", compared))
    angles = np.geomspace(1e-6, 0.3, 60)
    lines = [Series(name, variant is OURS, angles, _near_diagonal(variant, angles))
             for name, variant in (("handout", TANGENT), ("ours", OURS))]
    plot = Plot("Deviation of the frame from orthonormal", "angle from (1,1,1), radians", "xy", tuple(lines))
    return exhibit("tangent", findings, _pictures(compared), [plot], lost=handout.rejected)


def _near_diagonal(variant: Variant, angles: np.ndarray) -> np.ndarray:
    """The median defect of 64 frames at each angle (N,) from (1,1,1); no less than half a float32 spacing."""
    turn = np.arange(64) / 64 * 2 * np.pi
    x, y, z = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6), np.ones(3) / np.sqrt(3)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    near = np.cos(angles)[:, None, None] * z + np.sin(angles)[:, None, None] * around
    defects = checks.defects(frames(variant.probe)(near.reshape(-1, 3)))
    return np.maximum(np.median(defects.reshape(len(angles), -1), axis=1), 2.0**-25)


def below_surface(store: Store | None) -> Exhibit:
    """What becomes of the lobe's samples under the horizon."""
    scene = scene_of("exhibits/grazing")
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    ours = OURS.render(scene, "phong", SPP, store)
    renders = {name: variant.render(scene, "phong", SPP, store) for name, variant in BELOW.items()}
    exact, fit = lobe_albedo(ALPHA, GRAZING), direction_chi2(OURS, OURS, GRAZING)
    directions, _ = Vertex(ALPHA, GRAZING).draw(OURS.probe, "phong", COUNT)
    findings = []
    for name, variant in BELOW.items():
        misfit = direction_chi2(variant, OURS, GRAZING)
        findings += [
            mean_error(f"{name}: floor and spheres with phong against Mitsuba", judge(renders[name], reference),
                       judge(ours, reference)),
            expected_weight(f"{name}: albedo of a lobe at 80°, relative to the exact {exact:.3f}", variant, GRAZING),
            _both("direction χ²", f"{name}: χ² per degree of freedom against the pdf", misfit, fit)]
    shown = {**renders, "ours": ours}
    images = [ExhibitImage("Drawn again", renders["drawn again"].mean), ExhibitImage("Ours", ours.mean),
              ExhibitImage("Mitsuba", reference.mean)]
    images += [ExhibitImage(name.capitalize(), signed_relative_difference(shown[name].mean, reference.mean), "relative")
               for name in ("ours", *renders)]
    errors = [percentage(finding) for finding in findings if finding.check == "mean error"]
    return exhibit("below-surface", findings, images, alpha=ALPHA, share=100 * float((directions[:, 2] <= 0).mean()),
                   least=min(errors), most=max(errors))


def pdf_integral(variant: Variant, alpha: float) -> checks.Finding:
    """∫ pdf_lobe of a variant in steps of cos^(α+1), over which the lobe is spread evenly; the same all around."""
    _, pdf = sampler(variant.probe, "lobe", UP, alpha)
    return checks.integral(pdf, checks.Lobe(UP, alpha), points=(20_000, 1))


def direction_chi2(variant: Variant, judge_by: Variant, angle: float) -> checks.Finding:
    """χ² of a variant's directions by lobe sampling for a viewer at `angle` radians, against `judge_by`'s pdf."""
    vertex = Vertex(ALPHA, angle)
    directions, _ = vertex.sampler(variant.probe, "phong")
    _, pdf = vertex.sampler(judge_by.probe, "phong")
    return checks.chi2(directions, pdf, checks.Crowded(vertex.mirror))


def expected_weight(measures: str, variant: Variant, angle: float) -> Finding:
    """E[f cos / pdf] of a white lobe by lobe sampling over its albedo, less one, of a variant and of the library."""
    exact = lobe_albedo(ALPHA, angle)

    def mean_weight(shader: Variant) -> checks.Finding:
        return checks.weight(lambda u: Vertex(ALPHA, angle).draw(shader.probe, "phong", len(u))[1][:, 0], exact)

    wrong, right = mean_weight(variant), mean_weight(OURS)
    return Finding("expected weight", measures, wrong.value / exact - 1, right.value / exact - 1, "error",
                   not wrong.passed, right.passed)


def _both(check: str, measures: str, wrong: checks.Finding, right: checks.Finding) -> Finding:
    """One check of the handout's function and of ours."""
    return Finding(check, measures, wrong.value, right.value, "number", not wrong.passed, right.passed)


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
