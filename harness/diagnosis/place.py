"""From a stage that differs to the functions that compute it, likeliest first, with their file and line."""

from __future__ import annotations

import re
from collections.abc import Callable

from harness.diagnosis.case import Case
from harness.diagnosis.light_parts import BEHIND, wrong_light_parts
from harness.diagnosis.parts import wrong_texture_parts
from harness.diagnosis.questions import QUESTIONS
from harness.diagnosis.record import Place
from harness.diagnosis.tally import Answers
from harness.scene.model import Bitmap, Checkerboard, EnvironmentMap, Procedural
from harness.scene.motion import screw
from harness.shader.functions import functions
from harness.shader.library import GENERATED

# Of a shape's kind, what computes its normal, before the scene's own surface_normal.
_NORMALS = {"sphere": "sphere_normal", "cube": "cube_face", "cylinder": "cylinder_normal",
            "displacedsphere": "step_march"}
_ANGLES = ("turns", "whole_turns")
_NOISE = ("lattice_values", "cell_values", "value_noise")
_DISPLACING = (*_NOISE, "cell_noise_gradient", "wave", "marble", "wood")


def places(case: Case, name: str, answers: Answers) -> tuple[Place, ...]:
    """The functions behind a question, those first that what differs points to."""
    pointed = _BY_QUESTION.get(name)
    found = pointed(case, answers) if pointed else []
    names = dict.fromkeys([*found, *QUESTIONS[name].functions])
    return tuple(place for each in names if (place := _place(case, each, name)) is not None)


def _place(case: Case, function: str, question: str) -> Place | None:
    """Where a function stands; the line that computes the question's stage, where that is told."""
    whole = case.library.assembled("display.frag") if question == "display" else case.source
    known = functions(whole)
    if function not in known:
        return None
    at = known[function]
    content = dict(whole.files)[at.file].splitlines()
    wanted = QUESTIONS[question].line
    computes = next((name for name in QUESTIONS[question].functions if name in known), "")
    lines = [number for number in range(at.line, at.last + 1)
             if wanted and function == computes and wanted in content[number - 1]]
    number = lines[-1] if lines else at.line
    return Place(function, at.file, number, content[number - 1].strip())


def _shapes(answers: Answers) -> list[int]:
    """The shapes that answers differ on, the commonest first."""
    return [shape for shape, _ in answers.shapes.most_common()]


def _kind(case: Case, answers: Answers) -> str:
    """The kind of shape that answers differ on most."""
    kinds: dict[str, int] = {}
    for shape, count in answers.shapes.items():
        if shape >= 0:
            kind = case.scene.shapes[shape].kind
            kinds[kind] = kinds.get(kind, 0) + count
    return max(kinds, key=lambda kind: kinds[kind]) if kinds else ""


def _met(case: Case, answers: Answers) -> list[str]:
    kind = _kind(case, answers)
    if kind != "displacedsphere":
        return [*(_meets(case, shape) for shape in _shapes(answers) if shape >= 0), "intersect_shapes"]
    # The march asks the texture how high the surface is, and how steep.
    wrong = wrong_texture_parts(case.library, _DISPLACING)
    first = answers.notes["entered wrongly"] > 0.9 * answers.first
    return [*wrong, *(("approach", "step_march") if first else ("step_march", "approach"))]


def _meets(case: Case, shape: int) -> str:
    """The function by which the scene meets a shape, as its text has it."""
    scene = dict(case.source.files).get(GENERATED, "")
    found = re.search(rf"\b(hit_\w+)\([^\n]*\n[^\n]*\bid = {shape};", scene)
    return found[1] if found else f"hit_{case.scene.shapes[shape].kind}"


def _projection(case: Case, answers: Answers) -> list[str]:
    kind = _kind(case, answers)
    if "project_hit" not in case.functions:
        return []
    height = {"cube": "cube_height", "cylinder": "cylinder_height", "sphere": "large_sphere_height"}.get(kind)
    large = kind != "sphere" or any("large" in _meets(case, shape) for shape in _shapes(answers) if shape >= 0)
    return [height, "project_hit"] if height and large else ["project_hit"]


def _normal(case: Case, answers: Answers) -> list[str]:
    kind = _kind(case, answers)
    wrong: list[str] = []
    if kind == "displacedsphere":
        wrong = wrong_texture_parts(case.library, _DISPLACING)
    return [*wrong, *([_NORMALS[kind]] if kind in _NORMALS else []), "surface_normal"]


def _coordinate(case: Case, answers: Answers) -> list[str]:
    kind = _kind(case, answers)
    return [*wrong_texture_parts(case.library, _ANGLES), f"uv_{kind}", "surface_uv"]


def _textured(case: Case, answers: Answers, slots: tuple[str, ...]) -> list[str]:
    """The functions of the textures that the shapes have in the slots that differ."""
    found: list[str] = []
    for index in _shapes(answers):
        if index < 0:
            continue
        shape = case.scene.shapes[index]
        values = {"kd": shape.material.kd, "ks": shape.material.ks, "alpha": shape.material.alpha,
                  "emission": shape.emission}
        for slot in slots:
            match values[slot]:
                case Bitmap() as bitmap:
                    mirrors = ("mirrored",) if bitmap.wrap_mode == "mirror" else ()
                    found += [*wrong_texture_parts(case.library, mirrors), "bitmap"]
                case Checkerboard():
                    found.append("is_first_color")
                case Procedural() as texture:
                    parts = (*_NOISE, "wood_radius", "wave", "ramp_step", texture.kind)
                    found += wrong_texture_parts(case.library, parts)
                    found += [name for name in case.functions if name.startswith("procedural_")]
        if found:
            break
    return found


def _material(case: Case, answers: Answers) -> list[str]:
    slots = tuple(slot for slot in ("kd", "ks", "alpha") if answers.notes[slot])
    if not slots:
        return ["glossy_probability", "material"]
    return [*_textured(case, answers, slots), "material"]


def _light(case: Case, answers: Answers) -> list[str]:
    if answers.shapes[-1] < 0.5 * sum(answers.shapes.values()):
        return [*_textured(case, answers, ("emission",)), "emission"]
    if not isinstance(case.scene.environment, EnvironmentMap):
        return ["environment"]
    return [*wrong_texture_parts(case.library, _ANGLES[:1]), "environment_texel", "environment"]


def _pose(case: Case, answers: Answers) -> list[str]:
    turning = any((motion := case.scene.shapes[shape].motion) is not None and screw(motion).angle
                  for shape in _shapes(answers))
    return ["screw_pose"] if turning else ["to_rest" if answers.notes["to_rest"] else "from_rest"]


def _camera(case: Case, answers: Answers) -> list[str]:
    return ["lens_ray", "sample_disk", "cos_sin"] if case.has_lens else ["camera_ray"]


def _noted(case: Case, answers: Answers) -> list[str]:
    """The function that the question noted most."""
    return [name for name, count in answers.notes.most_common() if count]


def _draws(case: Case, answers: Answers) -> list[str]:
    return ["sample_phong"] if answers.notes["in sample_phong"] > 0.5 * answers.first else []


def _aimed(case: Case, answers: Answers) -> list[str]:
    """Of the functions behind a light's directions and densities those that are wrong by themselves, then the rest."""
    found: list[str] = []
    for index in _shapes(answers)[:1]:
        kind = case.scene.shapes[index].kind if index >= 0 else "environment"
        found += wrong_light_parts(case.library, BEHIND[kind])
    return found


def _sky(case: Case, answers: Answers) -> list[str]:
    """The same of the density of light that is met."""
    sky = [] if _kind(case, answers) else ["environment_light_pdf", "pdf_environment"]
    return [*_aimed(case, answers), *sky]


def _aimed_at(case: Case, answers: Answers) -> list[str]:
    """The same of the direction: what draws from the map is what is left there."""
    found = _aimed(case, answers)
    return found or ([] if _kind(case, answers) else ["sample_environment_texel"])


_BY_QUESTION: dict[str, Callable[[Case, Answers], list[str]]] = {
    "hit": _met, "distance": _met, "normal": _normal, "coordinate": _coordinate, "material": _material,
    "light": _light, "place": _projection, "pose": _pose, "camera": _camera,
    "direction": _noted, "pdf": _noted, "draws": _draws,
    "display": _noted, "aimed": _aimed_at, "light pdf": _aimed, "least": _aimed, "met pdf": _sky, "reflected": _noted,
    "bsdf pdf": _noted, "sent": _light,
}
