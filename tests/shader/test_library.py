"""The shader library as a value: what is exchanged in it, what is refused, and what it is known by."""

from __future__ import annotations

import pickle

import pytest

from harness.errors import HarnessError
from harness.files import data_dir
from harness.scene import SceneFile, load
from harness.shader.library import GENERATED, MAIN, OURS, Library, OwnFile
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import assemble

LINE = ("lib/phong.glsl", "return m.kd;", "return m.ks;")
FILE = OwnFile("lib/path.glsl", "// mine\n", "own/lib/path.glsl")
OTHERS = [OURS.with_line(*LINE), OURS.with_line(LINE[0], LINE[1], "return vec3(1.0);"), OURS.with_files(FILE),
          OURS.with_functions("course/tangent.glsl"), OURS.with_functions(defines={"A": 1}),
          OURS.with_functions(defines={"A": 2}), OURS.with_files(OwnFile("own.frag", "", "own.frag"), main="own.frag")]
SCENE = load(SceneFile.bundled("spheres", (8, 6)))


@pytest.mark.parametrize("library", [OURS, *OTHERS], ids=repr)
def test_is_a_value(library: Library) -> None:
    """It travels to other processes, and comes to the same there."""
    copy = pickle.loads(pickle.dumps(library))
    assert copy == library and hash(copy) == hash(library)
    assert copy.digest == library.digest
    assert sum(other == copy for other in (OURS, *OTHERS)) == 1


def test_is_known_by_all_of_its_text() -> None:
    assert Library().digest == OURS.digest
    assert len({library.digest for library in (OURS, *OTHERS)}) == 1 + len(OTHERS)


def test_without_changes_is_what_is_assembled_from_our_files() -> None:
    expected = assemble(MAIN, data_dir("glsl"), {GENERATED: scene_chunk(SCENE, "mixture")})
    assert OURS.tracer(SCENE, "mixture") == expected


def test_a_line_is_exchanged_where_it_stood() -> None:
    """Its indentation stays, and so do the numbers of all other lines."""
    ours, changed = (dict(library.tracer(SCENE, "mixture").files)["lib/phong.glsl"].splitlines()
                     for library in (OURS, OURS.with_line(*LINE)))
    differing = [(a, b) for a, b in zip(ours, changed, strict=True) if a != b]
    (before, after), = differing
    assert (before.strip(), after.strip()) == LINE[1:]
    assert len(before) - len(before.lstrip()) == len(after) - len(after.lstrip()) > 0


def test_lines_add_up() -> None:
    twice = OURS.with_line(*LINE).with_line(LINE[0], LINE[2], "return vec3(1.0);")
    assert twice.tracer(SCENE, "mixture").text == OTHERS[1].tracer(SCENE, "mixture").text


@pytest.mark.parametrize(("file", "line", "message"), [
    ("lib/phong.glsl", "return m.kq;", r"its line is not in lib/phong\.glsl: `return m\.kq;`; copy the line"),
    ("lib/phong.glsl", "{", r"its line occurs \d+ times in lib/phong\.glsl"),
    ("lib/fong.glsl", "{", r"no shader file 'lib/fong\.glsl'"),
])
def test_a_line_that_is_not_there_once_is_refused(file: str, line: str, message: str) -> None:
    with pytest.raises(HarnessError, match=message) as caught:
        OURS.with_line(file, line, "x")
    assert "\n" not in str(caught.value)


def test_a_file_stands_in_for_ours_and_is_called_by_its_own_name() -> None:
    files = dict(OURS.with_files(FILE).tracer(SCENE, "mixture").files)
    assert files["own/lib/path.glsl"] == "// mine\n"
    assert "lib/path.glsl" not in files


@pytest.mark.parametrize(("name", "message"), [
    ("lib/stray.glsl", "'own/lib/stray.glsl' stands in for nothing and nothing includes it; give it the name of"),
    ("path.glsl", "stands in for nothing .* the harness's lib/path.glsl it must be 'own/lib/path.glsl'"),
])
def test_a_stray_file_is_refused(name: str, message: str) -> None:
    """What is judged must be in the shader."""
    with pytest.raises(HarnessError, match=message):
        OURS.with_files(OwnFile(name, "// mine\n", f"own/{name}")).tracer(SCENE, "mixture")


def test_the_file_that_is_written_from_the_scene_is_not_to_be_had() -> None:
    with pytest.raises(HarnessError, match=r"cannot stand in for scene\.glsl"):
        OURS.with_files(OwnFile(GENERATED, "", GENERATED))


def test_functions_and_defines_are_in_the_tracer_and_in_probes() -> None:
    library = OURS.with_functions("course/tangent.glsl", defines={"MINE": 7})
    for source in (library.tracer(SCENE, "mixture"), library.probe("phong.frag")):
        assert "course/tangent.glsl" in dict(source.files)
        assert "#define MINE 7\n" in source.text
