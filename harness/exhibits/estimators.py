"""Exhibits that make the estimator wrong: the lobe's pdf, the mirror direction, the frame, samples below the surface."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from harness.errors import ShaderError
from harness.estimate import Estimate, luminance, merge
from harness.exhibits import checks
from harness.exhibits.variants import BELOW, LOBE_PDF, OURS, REFLECT, REFLECT_REPAIRED, TANGENT, Variant
from harness.files import data_dir
from harness.metrics import signed_relative_difference
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.runs import judge, render_reference
from harness.scene import Scene, load_scene
from harness.stats.bias import CHANNELS, MeanErrorVerdict
from harness.store import Store

SPP, REFERENCE_SPP = 256, 512
WIDTH, HEIGHT = 192, 144
LUMINANCE = CHANNELS.index("luminance")

ALPHA = 10.0  # of the lobe that probes look at: the exponent of FACTS' examples, and a common one
GRAZING, SLANTED = np.radians(80.0), np.radians(60.0)


@cache
def _scene(name: str) -> Scene:
    return load_scene(data_dir("mitsuba_scenes") / f"{name}.xml", width=WIDTH, height=HEIGHT)


def image_finding(handout: MeanErrorVerdict, ours: MeanErrorVerdict, measures: str) -> Finding:
    """The equivalence verdict on the image's mean, of the channel in which the handout's is farthest off."""
    return Finding("mean error", measures, float(handout.error[LUMINANCE]), float(ours.error[LUMINANCE]), "error",
                   handout.outcome == "fail", ours.outcome == "pass")


def lobe_pdf(store: Store | None) -> Exhibit:
    """π² where 2π belongs."""
    integrals = checks.pdf_integral(LOBE_PDF, ALPHA), checks.pdf_integral(OURS, ALPHA)
    fits = []
    for variant in (LOBE_PDF, OURS):
        directions, _ = checks.lobe_directions(variant, ALPHA, SLANTED)
        fits.append(checks.direction_chi2(directions, checks.probed_lobe_pdf(variant, ALPHA, SLANTED)))
    plates = [_plates(variant, store) for variant in (LOBE_PDF, OURS)]
    scene = _scene("spheres")
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    wrong, right = (variant.render(scene, "mixture", SPP, store) for variant in (LOBE_PDF, OURS))
    cancelled = judge(LOBE_PDF.render(scene, "lobes", SPP, store), reference)
    return Exhibit(
        "lobe-pdf", "The Phong lobe's pdf over π²", "course/lobe_pdf.glsl",
        "(alpha + 1) * pow(dot(r, l), alpha) / (PI * PI)", "(alpha + 1) * pow(dot(r, l), alpha) / (2 * PI)",
        "A pdf must integrate to 1; this one integrates to 2/π. Every sample of the lobe is divided by too little, and its "
        "light comes out π/2 = 1.571 times too bright, whatever the exponent. Strategies that cancel the pdf against "
        f"the BRDF's own term never evaluate it: lobes is off by {100 * abs(cancelled.error[LUMINANCE]):.2f} % "
        "with the same two formulas.",
        "Integrate every pdf that you write, on paper or in a loop over the sphere: 1, or it is no pdf. The constant of the "
        "pdf and that of the BRDF's lobe are then the same, and cancel.",
        (Finding("pdf integral", f"∫ pdf over the sphere, α = {ALPHA:g}", *integrals, "number",
                 abs(integrals[0] - 1) > 1e-3, abs(integrals[1] - 1) < 1e-3),
         Finding("direction χ²", "χ² per degree of freedom of drawn directions against the pdf", fits[0][0], fits[1][0],
                 "number", fits[0][1] < checks.LEVEL, fits[1][1] > checks.LEVEL),
         image_finding(*plates, "plates with a lobe only against their closed form"),
         image_finding(judge(wrong, reference), judge(right, reference), "spheres with mixture against Mitsuba")),
        _compared(scene, wrong, right, reference))


def _plates(variant: Variant, store: Store | None) -> MeanErrorVerdict:
    """furnace_phong's four plates by lobe-only sampling against ks (α+1)/(α+2), their borders left out."""
    scene = load_scene(data_dir("mitsuba_scenes") / "furnace_phong.xml", width=64, height=64)
    half = scene.width // 2
    inside = np.zeros(half, dtype=bool)
    inside[half // 8:-half // 8] = True
    mask = np.tile(np.outer(inside, inside), (2, 2))
    exact = np.zeros((scene.height, scene.width, 3))
    for shape, (row, column) in zip(scene.shapes, ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        material = shape.material
        assert isinstance(material.ks, tuple) and isinstance(material.alpha, float | int)
        albedo = np.array(material.ks) * (material.alpha + 1) / (material.alpha + 2)
        exact[row * half:(row + 1) * half, column * half:(column + 1) * half] = albedo
    renderer = variant.renderer(scene, "phong")
    try:
        batches = [renderer.render_batch(0, start, 32) for start in range(0, 8 * 32, 32)]
    finally:
        renderer.release()
    found = merge(dataclasses.replace(batch, mean=batch.mean[mask][None]) for batch in batches)
    return judge(found, Estimate.exact(exact[mask][None]))


def reflect(store: Store | None) -> Exhibit:
    """max(reflect(l,n),0.0), and what a hasty repair makes of it."""
    scene = _scene("spheres")
    try:
        REFLECT.renderer(scene, "uniform").release()
        message = "it compiles"
    except ShaderError as error:
        message = str(error)
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    wrong, right = (variant.render(scene, "mixture", SPP, store) for variant in (REFLECT_REPAIRED, OURS))
    albedos = [float(checks.lobe_directions(variant, ALPHA, SLANTED, strategy=0)[1].mean())
               for variant in (REFLECT_REPAIRED, OURS)]
    exact = checks.lobe_albedo(ALPHA, SLANTED)
    return Exhibit(
        "reflect", "The maximum of a vector", "course/reflect.glsl",
        "pow(max(reflect(l,n),0.0), alpha)", "pow(max(dot(reflect(-l, n), v), 0.0), alpha)",
        "The cosine to the viewer is missing, so a direction stands where a number must. The compiler says so. Add the dot "
        "product and nothing else, max(dot(reflect(l,n),v),0.0), and it compiles, but GLSL's reflect wants a "
        "direction that travels towards the surface: the mirror direction then points into it, and the highlights are gone.",
        "Read the compiler's message at the line that it names. Then test the BRDF by itself: in the mirror direction "
        "it must be at its brightest.",
        (Finding("compilation", "what the driver says", message, "compiles", "words", message != "it compiles", True),
         Finding("expected weight", f"∫ f cos of a white lobe seen at 60°, α = {ALPHA:g}; exact {exact:.3f}. "
                 "Of the hasty repair", *albedos, "number", abs(albedos[0] / exact - 1) > 0.03,
                 abs(albedos[1] / exact - 1) < 0.03),
         image_finding(judge(wrong, reference), judge(right, reference), "spheres against Mitsuba. Of the hasty repair")),
        _compared(scene, wrong, right, reference))


def tangent(store: Store | None) -> Exhibit:
    """A frame that does not exist about (1,1,1)."""
    rng = np.random.default_rng(1)
    corners = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    axes = np.concatenate([rng.normal(size=(10_000, 3)), corners[np.any(corners != 0, axis=1)]])
    axes = np.float32(axes / np.linalg.norm(axes, axis=1, keepdims=True)).astype(np.float64)
    bad = [int((checks.frame_defects(variant, axes) > 1e-5).sum()) for variant in (TANGENT, OURS)]
    angles = np.geomspace(1e-6, 0.3, 60)
    defects = [Series(name, variant is OURS, angles, _near_diagonal(variant, angles))
               for name, variant in (("handout", TANGENT), ("ours", OURS))]
    scene = _scene("exhibits/tangent")
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    wrong, right = (variant.render(scene, "mixture", SPP, store) for variant in (TANGENT, OURS))
    return Exhibit(
        "tangent", "A tangent that vanishes at (1,1,1)", "course/tangent.glsl",
        "normalize(cross(w.yzx, w))", "Duff et al. 2017: lib/sampling.glsl, to_world",
        "w.yzx is w turned about (1,1,1). Where w points there the cross product is zero, normalising it gives NaN, and one "
        "NaN poisons an accumulating pixel for ever. On a sphere no pixel need ever meet that normal, so the picture of a "
        "sphere tells nothing; a flat surface that faces (1,1,1) is lost whole. Nearby, the frame is not orthonormal.",
        "Use a frame without singularities: Duff et al. 2017, or pick the axis that w is least along. And count the samples "
        "that are not finite: a shader that drops them in silence hides this.",
        (Finding("orthonormal frame", f"axes without an orthonormal frame, of {len(axes):,}", *map(float, bad), "count",
                 bad[0] > 0, bad[1] == 0),
         Finding("finite samples", "samples that were not finite", float(wrong.rejected), float(right.rejected), "count",
                 wrong.rejected > 0, right.rejected == 0),
         image_finding(judge(wrong, reference), judge(right, reference), "panels with mixture against Mitsuba")),
        _compared(scene, wrong, right, reference),
        (Plot("Deviation of the frame from orthonormal", "angle between w and (1,1,1), radians", "xy", tuple(defects)),))


def _near_diagonal(variant: Variant, angles: np.ndarray) -> np.ndarray:
    """The median defect of 64 frames at each angle (N,) from (1,1,1); no less than half a float32 spacing."""
    turn = np.arange(64) / 64 * 2 * np.pi
    x, y, z = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6), np.ones(3) / np.sqrt(3)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    axes = np.cos(angles)[:, None, None] * z + np.sin(angles)[:, None, None] * around
    defects = checks.frame_defects(variant, np.float32(axes.reshape(-1, 3)).astype(np.float64))
    return np.maximum(np.median(defects.reshape(len(angles), -1), axis=1), 2.0**-25)


def below_surface(store: Store | None) -> Exhibit:
    """What becomes of the lobe's samples under the horizon."""
    scene = _scene("exhibits/grazing")
    reference = render_reference(scene, REFERENCE_SPP, store=store)
    right = OURS.render(scene, "phong", SPP, store)
    renders = {name: variant.render(scene, "phong", SPP, store) for name, variant in BELOW.items()}
    exact = checks.lobe_albedo(ALPHA, GRAZING)
    directions, weights = checks.lobe_directions(OURS, ALPHA, GRAZING)
    pdf = checks.probed_lobe_pdf(OURS, ALPHA, GRAZING)
    fit = checks.direction_chi2(directions, pdf)
    findings = []
    for name, variant in BELOW.items():
        drawn, weighed = checks.lobe_directions(variant, ALPHA, GRAZING)
        own = checks.direction_chi2(drawn, pdf)
        findings += [
            image_finding(judge(renders[name], reference), judge(right, reference),
                          f"{name}: floor and spheres with phong against Mitsuba"),
            _albedo_finding(name, weighed, weights, exact),
            Finding("direction χ²", f"{name}: χ² per degree of freedom against the pdf", own[0], fit[0], "number",
                    own[1] < checks.LEVEL, fit[1] > checks.LEVEL)]
    images = [ExhibitImage("Drawn again", renders["drawn again"].mean), ExhibitImage("Ours", right.mean),
              ExhibitImage("Mitsuba", reference.mean)]
    shown = {**renders, "ours": right}
    images += [ExhibitImage(f"{name[:1].upper()}{name[1:]}, relative difference",
                            signed_relative_difference(shown[name].mean, reference.mean))
               for name in ("kept", "folded up", "drawn again", "clamped", "ours")]
    share = float((directions[:, 2] <= 0).mean())
    return Exhibit(
        "below-surface", "Lobe samples below the surface", "course/below_surface.glsl",
        "weight = ks * dot(n, l);   // whatever l",
        "weight = dot(n, l) > 0.0 ? ks * dot(n, l) : vec3(0.0);",
        f"About a mirror direction near the horizon part of the lobe lies below the surface: {100 * share:.0f} % of the "
        f"samples for a viewer at 80° and α = {ALPHA:g}. Kept with their negative cosine they take light away; folded up, or "
        "drawn again until one fits, they add light that is not there, since the pdf still counts the part below. Clamped "
        "to the surface they have n·l = 0 and so weight zero, which is right by accident.",
        "Give such a sample the weight zero, leave the pdf as it is, and count the sample among the N.",
        tuple(findings), tuple(images))


def _albedo_finding(name: str, weights: np.ndarray, ours: np.ndarray, exact: float) -> Finding:
    """The mean weight over the exact albedo, less one; caught beyond 5 standard errors (one in a million)."""
    errors = [float(found.mean() / exact - 1) for found in (weights, ours)]
    limits = [5 * float(found.std() / np.sqrt(len(found)) / exact) for found in (weights, ours)]
    return Finding("expected weight", f"{name}: albedo at 80°, relative to the exact {exact:.3f}", *errors, "error",
                   abs(errors[0]) > limits[0], abs(errors[1]) <= limits[1])


def _compared(scene: Scene, wrong: Estimate, right: Estimate, reference: Estimate) -> tuple[ExhibitImage, ...]:
    assert luminance(reference.mean).min() > 0, f"{scene.name}: relative differences need light in every pixel"
    return (ExhibitImage("With the handout's formula", wrong.mean), ExhibitImage("Ours", right.mean),
            ExhibitImage("Mitsuba", reference.mean),
            ExhibitImage("Handout, relative difference", signed_relative_difference(wrong.mean, reference.mean)))
