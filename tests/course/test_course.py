"""The handout's formulas in glsl/course/: verbatim, apart from the library, in its place where asked, and found."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from harness import checks
from harness.checks.frame import ORTHONORMAL, axes
from harness.checks.shader import frames
from harness.course import numbers, pictures
from harness.course.texts import TEXTS
from harness.course.variants import (
    BELOW,
    LOBE_PDF,
    NOISE,
    OURS,
    RANDOM,
    REFLECT,
    REFLECT_REPAIRED,
    TANGENT,
    Variant,
)
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.gpu.context import Program
from harness.scene import load_scene
from harness.shader import library

ROOT = data_dir("glsl")
FILES = sorted((ROOT / "course").glob("*.glsl"))
VARIANTS = {"lobe pdf": LOBE_PDF, "repaired reflect": REFLECT_REPAIRED, "tangent": TANGENT, "random": RANDOM,
            **{f"below, {name}": variant for name, variant in BELOW.items()}}
# What the handout says, letter by letter.
VERBATIM = {
    "lobe_pdf.glsl": ("/ (PI * PI)",),
    "reflect.glsl": ("max(reflect(l,n),0.0)",),
    "tangent.glsl": ("normalize(cross(w.yzx, w))",),
    "random.glsl": ("seed = (numpass*0.9610356 + 1024*texcoord.x + texcoord.y)*1.51269341231;",
                    "return fract(sin(seed++)*43758.5453123);"),
    "noise.glsl": ("return fract(sin(n)*43758.5453123);",),
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_file_says_what_it_is_and_what_is_right(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    head = re.match(r"(//.*\n)+", text)
    assert head and head[0].startswith("// EXHIBIT")
    assert "right" in head[0]
    code = text[head.end():]
    assert all(formula in code for formula in VERBATIM.get(path.name, ()))


def test_the_library_never_includes_an_exhibit() -> None:
    shaders = [*ROOT.glob("*.frag"), *(ROOT / "lib").glob("*.glsl"), *(ROOT / "probes").glob("*.frag")]
    assert len(shaders) > 10
    assert not [path for path in shaders if "course/" in path.read_text(encoding="utf-8")]


def test_every_text_names_a_file_that_is_there() -> None:
    for text in TEXTS.values():
        assert not text.file or (ROOT / text.file).is_file()
        for path in re.findall(r"lib/\w+\.glsl", text.right):
            assert (ROOT / path).is_file()


@pytest.mark.parametrize("name", VARIANTS)
def test_the_tracer_compiles_with_the_handouts_functions(name: str) -> None:
    """It is another shader than ours, holds the handout's text, and our driver takes it."""
    scene, variant = load_scene(data_dir("mitsuba_scenes") / "furnace_phong.xml", width=16, height=16), VARIANTS[name]
    source = variant.library.tracer(scene, "phong")
    assert source.text != library.OURS.tracer(scene, "phong").text
    assert all(chunk in dict(source.files) for chunk in variant.library.chunks)
    assert variant.library.chunks
    Program(source).release()


def test_without_chunks_the_shader_is_ours() -> None:
    scene = load_scene(data_dir("mitsuba_scenes") / "furnace_phong.xml", width=16, height=16)
    assert OURS.library.tracer(scene, "mixture") == library.OURS.tracer(scene, "mixture")


def test_the_maximum_of_a_vector_does_not_compile() -> None:
    """The driver's message, in the line of the handout's expression."""
    line = 1 + (ROOT / "course/reflect.glsl").read_text(encoding="utf-8").split("max(reflect(l,n),0.0);")[0].count("\n")
    message = pictures.compiler_message(REFLECT)
    assert message.startswith(f"course/reflect.glsl:{line}: ")
    assert "`float cosine = max(reflect(l,n),0.0);`" in message
    assert pictures.compiler_message(OURS) == ""


@pytest.mark.parametrize("alpha", [0.0, 1.0, 10.0, 200.0])
def test_the_pdf_integral_finds_the_square_of_pi(alpha: float) -> None:
    wrong, right = pictures.pdf_integral(LOBE_PDF, alpha), pictures.pdf_integral(OURS, alpha)
    assert wrong.value == pytest.approx(2 / np.pi, rel=2e-5) and not wrong.passed
    assert right.value == pytest.approx(1, rel=2e-5) and right.passed


def test_directions_do_not_follow_the_handouts_pdf() -> None:
    for variant, follows in ((LOBE_PDF, False), (OURS, True)):
        found = pictures.direction_chi2(variant, variant, pictures.SLANTED)
        assert found.passed == follows, found.sentence


def test_the_plates_are_half_of_pi_too_bright() -> None:
    """The closed form (α+1)/(α+2), at every exponent."""
    wrong, right = pictures._plates(LOBE_PDF), pictures._plates(OURS)
    assert (wrong.outcome, right.outcome) == ("fail", "pass")
    np.testing.assert_allclose(wrong.error, np.pi / 2 - 1, atol=1e-3)


@pytest.mark.parametrize(("name", "size"), [("kept", -0.236), ("folded up", 0.239), ("drawn again", 0.401)])
def test_samples_below_the_surface_change_the_albedo(name: str, size: float) -> None:
    """Caught in the mean weight; where the directions change, by their χ² as well."""
    found = pictures.expected_weight("", BELOW[name], pictures.GRAZING)
    assert found.caught and found.cleared
    assert found.handout == pytest.approx(size, abs=0.005)
    assert pictures.direction_chi2(BELOW[name], OURS, pictures.GRAZING).passed == (name == "kept")


def test_samples_clamped_to_the_surface_do_no_harm() -> None:
    """n·l = 0: said in the report, so it had better be so."""
    found = pictures.expected_weight("", BELOW["clamped"], pictures.GRAZING)
    assert not found.caught and found.cleared


def test_a_hasty_repair_loses_the_lobe() -> None:
    found = pictures.expected_weight("", REFLECT_REPAIRED, pictures.SLANTED)
    assert found.caught and found.cleared and found.handout == pytest.approx(-0.99, abs=0.01)


def test_frames_are_missing_along_the_diagonal_only() -> None:
    """±(1,1,1) and no other of the axes tried."""
    bad = checks.defects(frames(TANGENT.probe)(axes())) > ORTHONORMAL
    np.testing.assert_allclose(np.abs(axes()[bad]), 1 / np.sqrt(3), rtol=1e-6)
    assert bad.sum() == 2
    assert checks.frame(frames(OURS.probe)).passed


@pytest.mark.parametrize(("variant", "lost"), [(TANGENT, True), (OURS, False)])
def test_samples_of_the_panel_are_not_finite(variant: Variant, lost: bool) -> None:
    scene = load_scene(data_dir("mitsuba_scenes") / "exhibits" / "tangent.xml", width=32, height=24)
    with Tracer("mixture", variant.library).open(scene.file) as renderer:
        batch = renderer.render_batch(0, 0, 16)
    assert (batch.rejected > 0.05 * 16 * 32 * 24) == lost
    assert bool((batch.mean == 0).any()) == lost and np.isfinite(batch.mean).all()


def test_random_numbers_of_a_sine_are_few_coarse_and_shared_by_rows() -> None:
    """Every finding on the numbers themselves catches the handout's and clears ours."""
    few, coarse, soon, rows = numbers._number_findings()
    assert all(finding.caught and finding.cleared for finding in (few, coarse, soon, rows))
    assert isinstance(few.handout, float) and few.handout < 0.05
    assert isinstance(coarse.handout, float) and coarse.handout > 0.5
    assert isinstance(rows.handout, float) and rows.handout > 0.8


def test_correlations_are_found_and_noise_is_not() -> None:
    """The statistic itself: white noise, and noise smoothed along one axis."""
    white = np.random.default_rng(5).normal(size=(2, 64, 64))
    smooth = white + np.roll(white, 1, axis=1)
    found = numbers._correlated("", [smooth[0], white[0]], 0)
    assert found.caught and found.cleared and found.handout == pytest.approx(0.5, abs=0.05)
    across = numbers._correlated("", [smooth[0], white[0]], 1)
    assert not across.caught and across.cleared


def test_a_lattice_of_sines_is_another_one_in_mitsuba() -> None:
    """Alike near the origin, unlike far from it; the integer hash is the same to the bit."""
    near, far = (numbers._lattice_distance(NOISE, numbers.sine_hash, n) for n in (10.0, 1e6))
    assert near < 2e-3 and far > 0.2
    assert numbers._lattice_distance(OURS, numbers._integer_hash, 1e6) == 0


def test_marble_differs_between_renderers_on_a_sine_only() -> None:
    exhibit = numbers.sine_noise(None)
    first = exhibit.findings[0]
    assert first.caught and first.cleared and isinstance(first.handout, float) and first.handout > 0.3
    assert isinstance(first.ours, float) and first.ours < 1e-5
