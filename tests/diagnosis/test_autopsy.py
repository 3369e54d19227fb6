"""Autopsies: the right shader is accused of nothing, a wrong one by its function, a stranger of what is wrong alone."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.diagnosis.autopsy import FIRST, autopsy, diagnose, examine, looks, opened
from harness.diagnosis.case import own_parts
from harness.diagnosis.record import AutopsyRecord
from harness.diagnosis.tally import Tally
from harness.errors import ShaderError
from harness.files import data_dir
from harness.gpu.tap import Look, Observed, Tap
from harness.mutants.autopsy import as_own_files, wrong_functions
from harness.mutants.catalogue import choose, load_catalogue, mutated
from harness.mutants.variants import load_variants
from harness.reference.coupled_steps import CoupledSteps
from harness.scene import SceneFile
from harness.shader.library import OURS, Library, OwnFile
from harness.shader.own_files import own_library
from tests.diagnosis.conftest import SIZE

CATALOGUE = load_catalogue()


@functools.cache
def variant(name: str) -> Library:
    """A correct variant, as its author would bring it."""
    return as_own_files(next(each for each in load_variants() if each.id == name))


def examined(steps: CoupledSteps, strategy: str, library: Library, *, strict: bool = False) -> AutopsyRecord:
    with opened(steps, strategy, library, strict=strict) as case:
        return diagnose(case)


def exchanged(library: Library, file: str, old: str, new: str) -> Library:
    """The library with a text of one of its own files exchanged."""
    text = next(own.text for own in library.files if own.name == file)
    assert text.count(old) == 1
    return library.with_files(OwnFile(file, text.replace(old, new), file))


@pytest.mark.parametrize(("scene", "strategy"), [
    ("transforms", "mixture"),       # every shape, two-sided and mirrored ones, emitters
    ("textures", "lobes"),           # bitmaps and checkerboards
    ("motion_blur", "cosine"),       # shapes that move and turn
    ("depth_of_field", "uniform"),   # a lens
    ("traps/ground", "mixture"),     # a sphere whose radius is a thousand
    ("traps/far_camera", "cosine"),  # a camera seven hundred units away
])
def test_the_right_shader_is_accused_of_nothing(scene: str, strategy: str) -> None:
    """And every question that the scene gives reason for was asked."""
    found = examined(CoupledSteps(SceneFile.bundled(scene, SIZE)), strategy, OURS)
    assert found.stage is None and not found.places and found.where is None
    asked = {stage.stage for stage in found.stages}
    assert {"numbers", "camera", "hit", "normal", "light", "direction", "weight", "offset", "radiance"} <= asked
    assert {"textures": "coordinate", "motion_blur": "pose"}.get(scene, "hit") in asked


@pytest.mark.parametrize(("mutant", "stage"), [
    ("seed-ignores-sample", "seed"), ("passes-overlap", "pass"), ("jitter-half-wide", "film"),
    ("camera-fov-half-percent", "camera"), ("viewer-direction-sign", "arguments"), ("sphere-far-root", "distance"),
    ("deep-paths-see-through", "branch"), ("diffuse-drawn-as-lobe", "lobe"), ("azimuth-not-closed", "azimuth"),
    ("selection-reuses-number", "lobe"), ("lobe-pdf-half-percent", "pdf"), ("mixture-weights-swapped", "weight"),
    ("epsilon-inwards", "offset"),
    ("radiance-not-reset", "radiance"), ("sample-lost", "counted"), ("display-gamma", "display"),
])
def test_mutants_are_named_with_their_function(spheres: CoupledSteps, mutant: str, stage: str) -> None:
    """One of each stage: the first function named is the one that the line is in."""
    [seeded] = choose(CATALOGUE, [mutant])
    found = examined(spheres, "mixture", mutated(seeded))
    assert found.stage == stage
    assert found.places[0].function in wrong_functions(seeded)
    assert found.places[0].file == seeded.file
    text = dict(mutated(seeded).tracer(spheres.scene, "mixture").files).get(seeded.file, "")
    assert not text or text.splitlines()[found.places[0].line - 1].strip() == found.places[0].text


def test_a_mutant_that_moves_is_seen_where_it_moves() -> None:
    """Poses are looked at themselves."""
    [seeded] = choose(CATALOGUE, ["motion-turns-back"])
    found = examined(CoupledSteps(SceneFile.bundled("motion_blur", SIZE)), "mixture", mutated(seeded))
    assert (found.stage, found.places[0].function) == ("pose", "screw_pose")


@pytest.mark.parametrize(("scene", "mutant", "stage", "function"), [
    ("traps/seam", "environment-not-wrapped", "light", "environment_texel"),
    ("traps/grazing", "below-horizon-flipped", "direction", "sample_phong"),
])
def test_traps_show_what_other_scenes_hide(scene: str, mutant: str, stage: str, function: str) -> None:
    """What happens to few paths is named where it happens to many; whoever changes a direction after it was drawn is
    told from who draws it."""
    [seeded] = choose(CATALOGUE, [mutant])
    found = examined(CoupledSteps(SceneFile.bundled(scene, SIZE)), "mixture", mutated(seeded))
    assert (found.stage, found.places[0].function) == (stage, function)


def test_one_hit_that_no_rounding_explains_is_enough() -> None:
    """A disk half a percent too small: as few paths as edges part, but no ray beside theirs meets what they met."""
    [seeded] = choose(CATALOGUE, ["disk-edge-left-out"])
    with opened(CoupledSteps(SceneFile.bundled("area_lights", (48, 36))), "mixture", mutated(seeded)) as case:
        answers = examine(case, 2).answers["hit"]
        found = diagnose(case)
    assert 0 < answers.certain <= answers.first <= 8
    assert found.stage == "hit" and found.places[0].function == "hit_disk"


def test_a_shift_too_small_for_one_vertex_shows_over_all(spheres: CoupledSteps) -> None:
    """An albedo off by 1e-5 of itself: every answer is within its tolerance, their median is not."""
    library = OURS.with_line("lib/phong.glsl", "f += m.kd * INV_PI;", "f += m.kd * (INV_PI * 1.00001);")
    found = examined(spheres, "cosine", library)
    assert found.shift is not None and found.stage in ("brdf", "weight")
    assert found.shift.median == pytest.approx(1e-5, rel=0.1)
    assert found.places[0].function == "eval_phong"


def test_where_paths_differ_is_told_by_pixel(spheres: CoupledSteps) -> None:
    """A defect of the cubes alone is on the cubes, and its witness is one of its paths."""
    [seeded] = choose(CATALOGUE, ["cube-face-inwards"])
    found = examined(spheres, "mixture", mutated(seeded))
    assert found.where is not None
    left, top, right, bottom = found.where.box
    assert 0 <= left <= right < SIZE[0] and 0 <= top <= bottom < SIZE[1]
    assert found.where.pixels < 0.5 * SIZE[0] * SIZE[1]
    column, row = found.where.pixel
    assert left <= column <= right and top <= row <= bottom
    wrong = [each for each in found.path if each.stage == "normal" and each.differs]
    assert wrong and np.allclose(wrong[0].shader, np.negative(wrong[0].expected), atol=1e-3)


class TestStranger:
    """A library with a generator or a sampler of its own keeps every other question."""

    @pytest.mark.parametrize("name", ["other-hash", "lobe-by-the-other-end"])
    def test_that_is_right_is_accused_of_nothing(self, spheres: CoupledSteps, name: str) -> None:
        found = examined(spheres, "mixture", variant(name))
        assert found.stage is None
        assert len(found.notes) == 1
        assert (found.scatter is not None) == (name == "lobe-by-the-other-end")

    def test_is_accused_of_what_is_wrong_besides(self, spheres: CoupledSteps) -> None:
        """Its own numbers, and a sphere half a percent too large."""
        [seeded] = choose(CATALOGUE, ["sphere-half-percent-larger"])
        found = examined(spheres, "mixture", mutated(seeded, variant("other-hash")))
        assert found.stage in ("hit", "distance") and found.places[0].function == "hit_sphere"

    def test_draws_its_terms_by_the_numbers_that_it_took(self, spheres: CoupledSteps) -> None:
        """Whichever they are: a lobe that is chosen a tenth too seldom is named, with no statistics."""
        library = variant("other-hash").with_line("lib/phong.glsl", "bool glossy = rand() < m.p_glossy;",
                                                   "bool glossy = rand() < 0.9 * m.p_glossy;")
        found = examined(spheres, "mixture", library)
        assert (found.stage, found.places[0].function, found.scatter) == ("lobe", "sample_phong", None)

    @pytest.mark.parametrize("name", ["other-hash", "numbers-in-another-order", "term-by-the-other-end"])
    def test_may_draw_a_lobe_that_is_as_wide_as_the_diffuse_term(self, ladder: CoupledSteps, name: str) -> None:
        """Of an exponent of 1 the direction does not tell the term, and the terms' weights differ."""
        assert examined(ladder, "lobes", variant(name)).stage is None

    @pytest.mark.parametrize(("grows", "stage"), [("4e-7", None), ("4e-6", "offset")])
    def test_may_lift_a_long_ray_by_what_its_end_is_known_to(self, plates: CoupledSteps, grows: str,
                                                             stage: str | None) -> None:
        """Plates that are seen from 400 units: a hundred-thousandth of that is more."""
        library = exchanged(variant("offset-grows-with-t"), "lib/path.glsl", "(4e-7 * t)", f"({grows} * t)")
        assert examined(plates, "lobes", library).stage == stage

    def test_sampler_is_tested_by_how_often_it_draws_which_direction(self, spheres: CoupledSteps) -> None:
        """A sampler of one's own whose lobe has the exponent 8 α: its weights are right, its directions are not."""
        library = exchanged(variant("lobe-by-the-other-end"), "lib/sampling.glsl", "1.0 / (alpha + 1.0)",
                            "1.0 / (8.0 * alpha + 1.0)")
        found = examined(spheres, "mixture", library)
        assert found.scatter is not None and found.scatter.fails
        assert (found.stage, found.places[0].function) == ("direction", "sample_lobe")

    @pytest.mark.parametrize(("weight", "stage"), [("PI", None), ("1.5", "weight")])
    def test_density_is_its_own_affair_but_not_the_light_that_it_scatters(self, spheres: CoupledSteps, weight: str,
                                                                          stage: str | None) -> None:
        """Drawn by the cosine where the strategy is uniform: right with the weight that belongs to that."""
        text = (data_dir("glsl") / "lib" / "phong.glsl").read_text(encoding="utf-8")
        for old, new in (("l = sample_uniform(n,", "l = sample_cosine(n,"),
                         ("(max(cos_l, 0.0) / INV_TWO_PI)", f"(cos_l > 0.0 ? {weight} : 0.0)")):
            assert text.count(old) == 1
            text = text.replace(old, new)
        library = OURS.with_files(OwnFile("lib/phong.glsl", text, "lib/phong.glsl"))
        found = examined(spheres, "uniform", library)
        assert found.stage == stage and len(found.notes) == 2
        assert found.scatter is not None and found.scatter.fails == (stage is not None)

    def test_is_observed_once_for_all_that_is_asked_of_it(self, spheres: CoupledSteps,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:
        """Also where it is settled first what of it is its own."""
        observed: list[int] = []
        observe = Tap.observe

        def counted(tap: Tap, look: Look, *rest: Any) -> Observed:
            observed.append(look.first)
            return observe(tap, look, *rest)

        monkeypatch.setattr(Tap, "observe", counted)
        assert examined(spheres, "mixture", variant("other-hash")).stage is None
        assert observed.count(FIRST) == 1

    def test_held_to_ours_is_accused_at_once(self, spheres: CoupledSteps) -> None:
        found = examined(spheres, "mixture", variant("other-hash"), strict=True)
        assert found.stage == "seed" and not found.notes

    def test_is_none_who_exchanges_a_line(self, spheres: CoupledSteps) -> None:
        """Whoever changes a line means the rest to stay."""
        [seeded] = choose(CATALOGUE, ["lcg-output"])
        assert not own_parts(mutated(seeded), "mixture", spheres.scene)
        assert own_parts(variant("other-hash"), "mixture", spheres.scene) == {"generator"}


def test_a_library_that_does_not_compile_says_so_itself(spheres: CoupledSteps) -> None:
    """And not of the taps' own lines."""
    library = OURS.with_line("lib/phong.glsl", "f += m.kd * INV_PI;", "f += m.kq;")
    with pytest.raises(ShaderError, match=r"^lib/phong\.glsl:\d+: .*kq"):
        examined(spheres, "mixture", library)


def test_a_library_of_other_parameters_is_refused(spheres: CoupledSteps) -> None:
    """It compiles, but the taps cannot stand between."""
    text = dict(OURS.assembled("lib/camera.glsl", {"scene.glsl": ""}).files)["lib/camera.glsl"]
    camera = text.replace("void camera_ray(vec2 film, out", "void camera_ray(in vec2 film, const int unused, out")
    path = dict(OURS.assembled("lib/path.glsl", {"scene.glsl": ""}).files)["lib/path.glsl"]
    path = path.replace("* pixel_size, o, d, reach);", "* pixel_size, 1, o, d, reach);")
    library = OURS.with_files(OwnFile("lib/camera.glsl", camera, "mine/camera.glsl"),
                              OwnFile("lib/path.glsl", path, "mine/path.glsl"))
    with pytest.raises(ShaderError, match="the taps do not fit this library"):
        examined(spheres, "mixture", library)


def test_looks_cover_first_and_second_passes(spheres: CoupledSteps) -> None:
    """What nobody may read lies in the first; the second observes the second of two samples."""
    with opened(spheres, "mixture", OURS) as case:
        first, second = looks(case, 2)
    assert (first.number, first.samples, first.tapped) == (0, 1, 0) and first.previous.any()
    assert (second.number, second.samples, second.tapped) == (1, 2, 1)
    assert first.first < second.first and first.replica > 0


def test_a_few_answers_accuse_nobody() -> None:
    """Silhouettes part a handful of paths; more of them do not."""
    for wrong, accused in ((4, None), (40, "hit")):
        tally = Tally(10_000)
        tally.begin(0)
        lanes = np.arange(10_000)
        tally.ask("hit", (lanes < wrong).astype(float), np.zeros(10_000), lanes)
        assert tally.accused() == accused
        assert tally.answers["hit"].first == wrong


def test_each_path_counts_where_it_differs_first(spheres: CoupledSteps) -> None:
    """Counts of first differences add up to no more than there are paths."""
    [seeded] = choose(CATALOGUE, ["mirror-about-the-viewer"])
    with opened(spheres, "mixture", mutated(seeded)) as case:
        tally = examine(case, 1)
    assert 0 < sum(answers.first for answers in tally.answers.values()) <= tally.paths


def test_a_file_of_ones_own_with_a_line_changed_is_asked_every_question(tmp_path: Path) -> None:
    """Whose directions are ours is no other sampler: the line is found that a statistical test would miss."""
    text = (data_dir("glsl") / "lib" / "phong.glsl").read_text(encoding="utf-8")
    (tmp_path / "lib").mkdir()
    line = "return eval_phong(m, cos_to_mirror) * (cos_l / pdf);"
    assert line in text
    (tmp_path / "lib" / "phong.glsl").write_text(text.replace(line, line.replace("cos_l", "1.0005 * cos_l")),
                                                 encoding="utf-8")
    found = autopsy(SceneFile.bundled("spheres", (48, 36)), "mixture", own_library(None, tmp_path))
    assert (found.stage, found.notes) == ("weight", ())
    assert found.places[0].function == "sample_phong" and "1.0005" in found.places[0].text
