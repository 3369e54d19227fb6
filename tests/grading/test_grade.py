"""Submissions judged: right, wrong, broken, and none disturbs the next."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.diagnosis import stranger
from harness.diagnosis.checked import Checked
from harness.grading.grade import Task, _graded, grade, graded_alone
from harness.grading.records import HINTS, Graded, told
from harness.grading.submissions import submissions
from harness.scene import SceneFile
from harness.shader.contract import Contract
from harness.strangers.findings import Accumulation, Finding, Findings

HEAD = """uniform sampler2D pingpong0;
uniform int numpass;
in vec2 texcoord;
layout(location = 0) out vec4 color;
uint state;
float random() { state = state * 747796405u + 2891336453u; uint w = state ^ (state >> 16u);
    w *= 277803737u; return float((w ^ (w >> 22u)) >> 8u) / 16777216.0; }
"""
# A white sky that fills the view, seen through noise; what a frame adds, and how frames are joined, is exchanged.
SKY = HEAD + """void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
    state = pixel.x + 64u * pixel.y;
    random();
    state = (state ^ (state >> 15u)) * 2246822519u + uint(numpass) * 3266489917u;
    random(); state ^= state >> 13u; random(); state *= 668265263u; random();
    vec3 sample_ = vec3(2.0 * random());
    color = (numpass > 0 ? texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0) : vec4(0.0)) + vec4(sample_, 1.0);
}
"""
SCENE = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/>
    <integer name="height" value="12"/></film></sensor>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter></scene>"""
FILES = {"right": SKY, "dark": SKY.replace("2.0 * random()", "1.8 * random()"),
         "broken": SKY.replace("vec3 sample_ =", "vec3 sample_ = undeclared +"),
         "lost": SKY.replace("numpass > 0 ? texelFetch", "numpass < 0 ? texelFetch")}


@pytest.fixture(scope="module")
def grades(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Graded]:
    """Four of them, in this process; each shader has its own all the same."""
    folder = tmp_path_factory.mktemp("submissions")
    (folder / "sky.xml").write_text(SCENE, encoding="utf-8")
    for name, text in FILES.items():
        (folder / f"{name}.frag").write_text(text, encoding="utf-8")
    task = Task(SceneFile(folder / "sky.xml"), size=(16, 12), tolerance=0.02, causes=False)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stranger, "REFERENCE_SPP", 16)
        patched.setattr(stranger, "_frames_of_a_batch", lambda *arguments: 64)  # a busy machine decides nothing
        return {each.name: graded_alone(task, each) for each in submissions(folder)}


def test_a_right_one_has_all_points(grades: dict[str, Graded]) -> None:
    right = grades["right"]
    assert (right.outcome, right.points, right.place, right.formula) == ("pass", 1.0, "", ""), right.sentence
    assert right.error is not None and abs(right.error[1]) < 0.01
    assert [title.partition(",")[0] for title, _ in right.pictures] == ["submission", "reference", "difference"]


def test_a_dark_one_fails_by_its_picture(grades: dict[str, Graded]) -> None:
    dark = grades["dark"]
    assert dark.outcome == "fail"
    assert dark.error is not None and dark.error[0] < -0.1 < dark.error[2] + 0.005
    assert [part.earned for part in dark.parts][:2] == [1.0, 1.0]
    assert dark.parts[2].earned < 1.0


def test_one_that_does_not_compile_is_refused_with_its_line(grades: dict[str, Graded]) -> None:
    broken = grades["broken"]
    assert (broken.outcome, broken.points) == ("refused", 0.0)
    assert "broken.frag:14: " in broken.sentence and "undeclared" in broken.sentence


def test_one_that_loses_its_past_is_wrong_in_that_part_alone(grades: dict[str, Graded]) -> None:
    """The picture of its single frames is right."""
    lost = grades["lost"]
    assert lost.outcome == "fail"
    assert [part.earned for part in lost.parts] == [1.0, 0.0, 1.0]


def test_a_line_of_the_authors_is_told_with_the_formula_alone() -> None:
    """Neither the sentence nor the parts quote it."""
    fault = Finding("encodes_samples", "fault", "estimator", "each frame is encoded (`s = sqrt(s)`)", "ada.frag:7")
    note = Finding("samples_agree", "note", "estimator", "1 and 4 samples a frame give one mean")
    found = Findings(Contract("body", (), "ada"), "a sum", Accumulation("pass", "the mean", 24, exact=True),
                     (fault, note))
    graded = _graded("ada", ("ada.frag",), Checked(found), SceneFile.bundled("diffuse"))
    assert "sqrt" in graded.findings[0][1] and len(graded.findings) == 1  # what is well is no finding
    for hints in HINTS:
        assert ("sqrt" in repr(told(graded, hints))) == (hints == "formula")


def test_one_that_cannot_be_judged_is_not_called_right() -> None:
    """Though no fault was found in it."""
    found = Findings(Contract("body", (), "ada"), "none", Accumulation("none", "stands alone", 24, exact=False), ())
    checked = Checked(found, hopeless="what a frame adds cannot be told from its past")
    graded = _graded("ada", ("ada.frag",), checked, SceneFile.bundled("diffuse"))
    assert not checked.is_right and graded.outcome == "fail"
    assert "right" not in graded.sentence and "cannot be told from its past" in graded.sentence
    assert graded.parts[2].earned == 0.0 and "cannot be told" in graded.parts[2].sentence


def test_a_scene_that_is_none_ends_the_run(tmp_path: Path) -> None:
    """It is the teacher's to mend, not a student's."""
    from harness.errors import SceneError

    (tmp_path / "a.frag").write_text(SKY, encoding="utf-8")
    (tmp_path / "scene.xml").write_text("<scene", encoding="utf-8")
    with pytest.raises(SceneError, match=r"scene\.xml"):
        grade(submissions(tmp_path), Task(SceneFile(tmp_path / "scene.xml")))
