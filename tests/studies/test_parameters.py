"""Parameters of a study: how they are written, what a scene declares, and every combination once."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import pytest

from harness.errors import HarnessError, SceneError
from harness.estimators.base import Renderer
from harness.scene import SceneFile
from harness.studies.parameters import axes_of, combinations, declared, parse_axes

SCENE = """<scene version="3.0.0">
    <default name="alpha" value="20"/> <default name="kd" value="0.5, 0.4, 0.3"/>
    <integrator type="path"><integer name="max_depth" value="$depth"/></integrator>
    <include filename="lens.xml"/>
</scene>"""
LENS = '<scene version="3.0.0"><default name="aperture" value="0.1"/></scene>'


@pytest.fixture
def scene(tmp_path: Path) -> SceneFile:
    (tmp_path / "lens.xml").write_text(LENS, encoding="utf-8")
    (tmp_path / "plates.xml").write_text(SCENE, encoding="utf-8")
    return SceneFile(tmp_path / "plates.xml")


@pytest.mark.parametrize(("text", "values"), [
    ("alpha=10", ("10",)),
    ("alpha=1,10, 100", ("1", "10", "100")),
    ("alpha=1,10,1", ("1", "10")),
    ("kd=1 0 0,0 1 0", ("1 0 0", "0 1 0")),
    ("file=a\\,b.png,c.png", ("a,b.png", "c.png")),
    ("path=x=1", ("x=1",)),
    ("name=", ("",)),
])
def test_commas_part_values(text: str, values: tuple[str, ...]) -> None:
    assert parse_axes([text]) == ((text.partition("=")[0], values),)


@pytest.mark.parametrize(("texts", "message"), [
    (["alpha"], "expected NAME=VALUE, or several with commas between, such as alpha=1,10,100; found 'alpha'"),
    (["=3"], "expected NAME=VALUE"),
    (["alpha=1,,3"], "'alpha=1,,3' has an empty value between commas"),
    (["alpha=1", "alpha=10"], "'alpha' is given twice; write all its values at once: alpha=1,10"),
])
def test_what_is_no_parameter_is_refused(texts: list[str], message: str) -> None:
    with pytest.raises(HarnessError) as caught:
        parse_axes(texts)
    assert message in str(caught.value)


def test_python_gives_values_as_they_are() -> None:
    assert axes_of({"alpha": [1, 10.5], "kd": [(1, 0, 0)], "file": "a,b.png", "depth": 3}) == (
        ("alpha", ("1", "10.5")), ("kd", ("1 0 0",)), ("file", ("a,b.png",)), ("depth", ("3",)))
    with pytest.raises(HarnessError, match="parameter 'alpha' has no value"):
        axes_of({"alpha": []})


def test_a_scene_declares_what_it_and_its_includes_do_and_what_they_use(scene: SceneFile) -> None:
    assert declared(scene.path) == {"depth": "", "alpha": "20", "kd": "0.5, 0.4, 0.3", "aperture": "0.1"}


def test_every_combination_comes_once_the_last_parameter_first(scene: SceneFile) -> None:
    found = combinations([scene], parse_axes(["alpha=1,10", "aperture=0,0.1"]))
    assert [file.name for file in found] == ["plates alpha=1 aperture=0", "plates alpha=1 aperture=0.1",
                                             "plates alpha=10 aperture=0", "plates alpha=10 aperture=0.1"]
    assert combinations([scene], ()) == (scene,)


def test_a_name_that_a_scene_does_not_declare_is_one_clear_error(scene: SceneFile, tmp_path: Path) -> None:
    (tmp_path / "bare.xml").write_text('<scene version="3.0.0"/>', encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        combinations([scene], parse_axes(["alhpa=1,10"]))
    assert str(caught.value) == (
        f"{scene.path}: no parameter 'alhpa'; it declares depth, alpha, kd, aperture: write <default name=\"alhpa\" "
        "value=\"…\"/> into the scene, and $alhpa where its value belongs")
    with pytest.raises(SceneError, match=r"bare\.xml: no parameter 'alpha'; it declares none"):
        combinations([scene, SceneFile(tmp_path / "bare.xml")], parse_axes(["alpha=1"]))


@dataclass(frozen=True)
class Other:
    """An estimator with values of its own."""

    name: str = "mine"

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        return "alpha", "gain"

    def check(self, scene: SceneFile) -> str:
        return ""

    def open(self, scene: SceneFile) -> AbstractContextManager[Renderer]:
        raise NotImplementedError


def test_a_name_of_an_estimator_alone_is_set_besides_the_scene(scene: SceneFile) -> None:
    found = combinations([scene], parse_axes(["gain=1,2", "alpha=3"]), ["mixture", Other()])
    assert [(each.parameters, each.besides) for each in found] == [
        ((("alpha", "3"),), (("gain", "1"),)), ((("alpha", "3"),), (("gain", "2"),))]
    assert [each.name for each in found] == ["plates alpha=3 gain=1", "plates alpha=3 gain=2"]
    assert found[0].given == (("alpha", "3"), ("gain", "1")) and found[0] != found[1]
    with pytest.raises(SceneError, match=r"plates\.xml: no parameter 'gian'; it declares depth, .*; 'mine' has alpha, "
                                         r"gain: write <default"):
        combinations([scene], parse_axes(["gain=1", "gian=1,2"]), ["mixture", Other()])


def test_a_colour_with_commas_is_not_taken_for_three_greys(scene: SceneFile) -> None:
    with pytest.raises(SceneError, match=r"'kd' is 3 numbers \('0.5, 0.4, 0.3'\), found '1': commas part values, so "
                                         r"write spaces within one: --set 'kd=1 1 1,0 0 0'"):
        combinations([scene], parse_axes(["kd=1,0,0"]))
    assert len(combinations([scene], parse_axes(["kd=1 0 0,0 1 0"]))) == 2
    assert len(combinations([scene], parse_axes(["kd=0.5"]))) == 1  # a grey, as it was


def test_scenes_of_one_name_and_far_too_many_combinations_are_refused(scene: SceneFile) -> None:
    with pytest.raises(HarnessError, match="two of the scenes are called 'plates'"):
        combinations([scene, scene], ())
    many = ",".join(map(str, range(101)))
    with pytest.raises(HarnessError, match="10201 combinations"):
        combinations([scene], parse_axes([f"alpha={many}", f"aperture={many}"]))
