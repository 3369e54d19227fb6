"""Diagnoses of simulated strangers: our tracer with a defect, drawn with other strategies and numbers."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from harness.diagnosis.causes import Diagnosis, diagnose, load_defects
from harness.diagnosis.causes.candidates import candidates
from harness.diagnosis.causes.catalogue import defective
from harness.diagnosis.causes.match import Seen
from harness.diagnosis.causes.where import places
from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.mutants.catalogue import load_catalogue, mutated
from harness.mutants.variants import Variant, load_variants
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.shader.library import OURS, Library

SCENE = SceneFile.bundled("spheres", (24, 18))
CHOSEN = ("cosine-twice", "cosine-missing", "half-weight", "specular-plus-two", "one-bounce-less", "albedo-squared",
          "gamma-before-average", "sky-over-pi", "lens-twice", "diffuse-choice-not-divided")
DEFECTS = [defect for defect in load_defects() if defect.id in CHOSEN]
MUTANTS = {mutant.id: mutant for mutant in load_catalogue()}


def drawn(library: Library = OURS, strategy: str = "mixture", *, replica: int = 0, spp: int = 32) -> Estimate:
    with Tracer(strategy, library).open(SCENE) as renderer:
        return merge(renderer.render_batch(replica + k, 0, spp) for k in range(16))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def reference() -> Estimate:
    return drawn(replica=500, spp=512)


def ask(found: Estimate, reference: Estimate, store: Store) -> Diagnosis:
    return diagnose(SCENE, found, reference, store=store, defects=DEFECTS, depths=False, where=False)


@pytest.mark.parametrize(("mutant", "strategy", "cause"), [
    ("cosine-pdf-not-cancelled", "cosine", "cosine-twice"),
    ("cosine-missing", "uniform", "cosine-missing"),
    ("uniform-albedo-without-two", "uniform", "half-weight"),
    ("lobes-diffuse-not-divided", "lobes", "diffuse-choice-not-divided"),
    ("gamma-before-average", "lobes", "gamma-before-average"),
])
def test_names_the_cause(mutant: str, strategy: str, cause: str, reference: Estimate, store: Store) -> None:
    found = ask(drawn(mutated(MUTANTS[mutant]), strategy), reference, store)
    assert found.outcome == "cause", found.sentences
    assert found.causes[0].id == cause
    assert found.causes[0].same
    assert not any(other.same for other in found.causes[1:])
    assert "the same picture as ours with" in found.sentence
    assert f"{found.causes[0].chi2:.2f}; the right picture is excluded" in found.sentence


@pytest.mark.parametrize(("rounding", "off", "outcome"), [(True, 0.04, "cause"), (False, 0.04, "near"),
                                                          (True, 0.15, "near")])
def test_names_what_rounding_makes_where_it_is_much_like_ours(
    rounding: bool, off: float, outcome: str, reference: Estimate, store: Store,
) -> None:
    """Rays that start on the surface: how many of them meet it again is another number for another compiler."""
    defect, = (defect for defect in load_defects() if defect.id == "not-offset")
    acne = drawn(defective(defect.pictures[0]), spp=256)
    other = dataclasses.replace(acne, mean=acne.mean + np.float32(off) * (reference.mean - acne.mean))
    found = diagnose(SCENE, other, reference, store=store, depths=False, where=False,
                     defects=[*DEFECTS, dataclasses.replace(defect, rounding=rounding)])
    assert defect.rounding and (found.outcome, found.causes[0].id) == (outcome, "not-offset")


@pytest.mark.parametrize("strategy", ["uniform", "lobes"])
@pytest.mark.parametrize("variant", load_variants()[:3], ids=lambda variant: variant.id)
def test_accuses_no_correct_variant(variant: Variant, strategy: str, reference: Estimate, store: Store) -> None:
    found = ask(drawn(variant.applied(), strategy, replica=90), reference, store)
    assert found.outcome == "right"
    assert found.causes == ()
    assert "nothing to explain" in found.sentence


def test_names_the_cause_of_a_picture_that_is_half_a_pixel_off_besides(store: Store) -> None:
    shift = next(one for one in load_defects() if one.id == "half-pixel-up-right")
    shifted = defective(shift.pictures[0])
    wrong = defective(next(one for one in DEFECTS if one.id == "half-weight").pictures[0], shifted)
    found = diagnose(SCENE, drawn(wrong), drawn(shifted, replica=500, spp=512), store=store, defects=DEFECTS,
                     besides=shift, depths=False, where=False)
    assert found.causes[0].id == "half-weight" and found.outcome == "cause", found.sentences
    assert any("half a pixel off" in note and "besides" in note for note in found.notes)


def test_says_that_it_knows_no_cause(reference: Estimate, store: Store) -> None:
    library = mutated(MUTANTS["lobe-about-the-normal"])
    found = ask(drawn(library), reference, store)
    assert found.outcome in ("unknown", "near")
    assert found.sentence.startswith("none of the known causes")


def test_a_transform_is_told_as_such_though_a_defect_makes_the_same_picture(reference: Estimate, store: Store) -> None:
    right = drawn(replica=40)
    found = ask(merge_scaled(right, 1 / np.pi), reference, store)
    assert found.outcome == "cause"
    assert found.causes[0].kind == "transform"
    assert "sky-over-pi" in found.causes[0].alike
    assert found.sentence.startswith("the picture is right but for a factor of 1/π")


def merge_scaled(estimate: Estimate, factor: float) -> Estimate:
    return Estimate(estimate.mean * factor, estimate.variance * factor**2, estimate.luminance_variance * factor**2,
                    estimate.image_mean * factor, estimate.image_variance * factor**2, estimate.samples,
                    estimate.batches)


def test_tells_factors_of_bounces_and_places(reference: Estimate, store: Store) -> None:
    library = OURS.with_line("lib/path.glsl", "throughput *= drawn.weight;",
                             "throughput *= (id == 3 ? 0.4 : 1.0) * drawn.weight;")
    found = diagnose(SCENE, drawn(library), reference, store=store, defects=DEFECTS, truth=Tracer("mixture"))
    assert found.factors is not None
    assert not found.factors.fit.same
    assert found.places[0].name == "specular gold"
    assert found.places[0].error < -0.3
    assert any("off on specular gold" in line for line in found.sentences)
    told = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert told["outcome"] == found.outcome
    assert told["places"][0]["wrong"] is True


def test_places_without_an_error_are_not_told(reference: Estimate) -> None:
    assert not any(place.wrong for place in places(SCENE, Seen.of(drawn()), Seen.of(reference)))


def test_a_scene_is_paid_for_once(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: Sequence[str] = ("cosine-twice", "lens-twice")
    defects = [defect for defect in DEFECTS if defect.id in chosen]
    first = candidates(SCENE, store=store, defects=defects)
    assert [candidate.name for candidate in first] == ["right", "cosine-twice"]  # the scene has no lens

    def refuse(*_: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr(Tracer, "open", refuse)
    again = candidates(SCENE, store=store, defects=defects)
    assert all(np.array_equal(a.estimate.mean, b.estimate.mean) for a, b in zip(first, again, strict=True))


def test_a_larger_image_is_merged(store: Store) -> None:
    large = SCENE.sized(96, 72)
    with Tracer("mixture").open(large) as renderer:
        right = merge(renderer.render_batch(700 + k, 0, 16) for k in range(8))
    with Tracer("uniform", mutated(MUTANTS["cosine-missing"])).open(large) as renderer:
        wrong = merge(renderer.render_batch(k, 0, 16) for k in range(8))
    found = diagnose(large, wrong, right, store=store, defects=DEFECTS, depths=False, where=False)
    assert found.causes[0].id == "cosine-missing"


def test_images_that_cannot_be_compared_are_refused(reference: Estimate, store: Store) -> None:
    single = merge([Batch(reference.mean, 4)])
    with pytest.raises(HarnessError, match="at least two batches"):
        ask(single, reference, store)
    with pytest.raises(HarnessError, match="24x18 pixels and the reference 18x24"):
        ask(reference, Estimate.exact(reference.mean.swapaxes(0, 1)), store)


SPOT = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="2"/></integrator>
<sensor type="perspective"><film type="hdrfilm">
<integer name="width" value="24"/><integer name="height" value="16"/></film></sensor>
<shape type="sphere" id="ball"><point name="center" x="0" y="0" z="4"/><bsdf type="dielectric"/></shape>
<emitter type="constant"/>
</scene>"""


def test_a_scene_that_our_tracer_cannot_hold_is_judged_by_the_image_alone(tmp_path: Path) -> None:
    path = tmp_path / "glass.xml"
    path.write_text(SPOT, encoding="utf-8")
    rng = np.random.default_rng(1)
    light = rng.uniform(0.5, 1.0, (16, 24, 3))
    found = merge(Batch(2 * light * (1 + 0.02 * rng.normal(size=(16, 24, 1))), 8) for _ in range(8))
    told = diagnose(SceneFile(path), found, Estimate.exact(light), depths=False)
    assert told.sentence.startswith("the picture is right but for a factor of 2")
    assert any("no defects were simulated" in note for note in told.notes)
