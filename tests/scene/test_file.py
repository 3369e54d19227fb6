"""Scene files as values: the film, parameters, and the hash over all that is read for an image."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.errors import HarnessError, SceneError
from harness.reference.prepare import prepare
from harness.scene import Film, SceneFile, file_of, load

FILM = '<integer name="width" value="8"/><integer name="height" value="6"/><float name="exposure" value="1.5"/>'
INTEGRATOR = '<integrator type="path"><integer name="max_depth" value="2"/></integrator>'


def write(path: Path, body: str = "", film: str = FILM) -> SceneFile:
    """A scene file around a body."""
    path.write_text(f'''<scene version="3.0.0">{INTEGRATOR}
        <sensor type="perspective"><film type="hdrfilm">{film}<rfilter type="box"/></film></sensor>
        {body}</scene>''', encoding="utf-8")
    return SceneFile(path)


class TestFilm:
    """Its size and exposure."""

    def test_is_the_files(self, tmp_path: Path) -> None:
        assert write(tmp_path / "a.xml").film == Film(8, 6, 1.5)

    def test_is_mitsubas_where_the_file_does_not_say(self, tmp_path: Path) -> None:
        """As Mitsuba itself makes it of the same file."""
        file = write(tmp_path / "a.xml", film="")
        assert file.film == Film(768, 576, 0.0)
        assert tuple(prepare(file).scene.sensors()[0].film().size()) == (768, 576)

    def test_has_the_size_that_is_asked_for(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml").sized(20, 10)
        reading = load(file)
        assert file.film == Film(20, 10, 1.5)
        assert (reading.width, reading.height) == (20, 10)
        assert reading.file == SceneFile(file.path.resolve(), size=(20, 10))

    def test_is_missing_without_a_sensor(self, tmp_path: Path) -> None:
        (tmp_path / "a.xml").write_text('<scene version="3.0.0">\n</scene>')
        with pytest.raises(HarnessError, match="the scene has no <sensor>; add one") as caught:
            _ = SceneFile(tmp_path / "a.xml").film
        assert "\n" not in str(caught.value)


SKY = '<default name="grey" value="0.5"/><emitter type="constant"><rgb name="radiance" value="$grey"/></emitter>'


class TestParameters:
    """Values for the `<default>`s of a file."""

    def test_reach_both_readings(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml", SKY)
        for given, radiance in ((file, 0.5), (SceneFile(file.path, (("grey", "0.25"),)), 0.25)):
            assert load(given).environment == (radiance,) * 3
            emitter, = prepare(given).scene.emitters()
            assert f"value = [[{radiance}, {radiance}, {radiance}]]" in str(emitter)

    def test_are_part_of_name_and_hash(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml", SKY)
        other = SceneFile(file.path, (("grey", "0.25"),))
        assert (file.name, other.name) == ("a", "a grey=0.25")
        assert file.hash != other.hash

    def test_are_a_value_in_any_order(self, tmp_path: Path) -> None:
        one, other = (SceneFile(tmp_path / "a.xml", given) for given in (
            (("a", "1"), ("b", "2")), (("b", "2"), ("a", "1"))))
        assert one == other and hash(one) == hash(other)
        assert pickle.loads(pickle.dumps(one)) == one


class TestHash:
    """What images of a scene know each other by."""

    def test_is_the_same_of_the_same(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml")
        before = file.hash
        write(tmp_path / "a.xml")
        assert SceneFile(tmp_path / "a.xml").hash == before
        assert len(before) == 16 and int(before, 16) >= 0

    def test_changes_with_the_file_and_the_size(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml")
        hashes = {file.hash, file.sized(9, 6).hash}
        hashes.add(write(tmp_path / "a.xml", SKY).hash)
        assert len(hashes) == 3

    def test_changes_with_the_bytes_of_a_texture(self, tmp_path: Path) -> None:
        def picture(grey: int) -> None:
            Image.fromarray(np.full((2, 2, 3), grey, dtype=np.uint8)).save(tmp_path / "t.png")

        picture(100)
        file = write(tmp_path / "a.xml", """<shape type="sphere"><bsdf type="diffuse">
            <texture type="bitmap" name="reflectance"><string name="filename" value="t.png"/></texture></bsdf>
            </shape>""")
        before = file.hash
        picture(101)
        assert file.hash != before
        picture(100)
        assert file.hash == before

    def test_changes_with_the_bytes_of_an_include(self, tmp_path: Path) -> None:
        part = tmp_path / "part.xml"
        part.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
        file = write(tmp_path / "a.xml", '<include filename="part.xml"/>')
        before = file.hash
        part.write_text('<scene version="3.0.0"><shape type="cube"/></scene>')
        assert file.hash != before


def test_a_bundled_scene_has_a_name_and_an_unknown_one_the_known() -> None:
    assert SceneFile.bundled("spheres", (4, 3)).film.width == 4
    with pytest.raises(HarnessError, match=r"unknown scene 'sphere'; name an \.xml file, or one of .*spheres"):
        SceneFile.bundled("sphere")


def test_a_scene_that_was_changed_in_memory_is_not_taken_for_its_file() -> None:
    """Whoever opens the file would render something else, and nobody would notice."""
    read = load(SceneFile.bundled("spheres", (8, 6)))
    assert file_of(read) == read.file
    with pytest.raises(SceneError, match=r"spheres\.xml: the scene differs from its file in more than film size"):
        file_of(dataclasses.replace(read, max_depth=read.max_depth + 1))


class TestDepth:
    """Vertices of a path at most, the file's or another."""

    LIGHT = '<emitter type="constant"/>'

    def test_is_the_files_unless_set(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml", self.LIGHT)
        assert (file.depth, load(file).max_depth, prepare(file).max_depth) == (2, 2, 2)
        other = file.at_depth(5)
        assert (other.depth, load(other).max_depth, prepare(other).max_depth) == (5, 5, 5)
        assert other.name == "a max_depth=5" and other.hash != file.hash
        assert load(other).content_hash == load(write(tmp_path / "b.xml", self.LIGHT).at_depth(5)).content_hash
        assert file_of(load(other)) == replace_path(other)

    def test_without_a_bound_is_none(self, tmp_path: Path) -> None:
        file = write(tmp_path / "a.xml", self.LIGHT)
        file.path.write_text(file.path.read_text().replace(INTEGRATOR, '<integrator type="volpath"/>'))
        assert (file.depth, file.at_depth(3).depth, prepare(file.at_depth(3)).max_depth) == (None, 3, 3)

    @pytest.mark.parametrize(("integrator", "message"), [
        ('<integrator type="direct"/>', r"a\.xml:\d+: integrator 'direct' has no max_depth to set; those that have"),
        ("", r"a\.xml:\d+: the scene has no <integrator>; add one of type 'path'")])
    def test_that_cannot_be_set_is_refused(self, tmp_path: Path, integrator: str, message: str) -> None:
        file = write(tmp_path / "a.xml", self.LIGHT)
        file.path.write_text(file.path.read_text().replace(INTEGRATOR, integrator))
        with pytest.raises(SceneError, match=message):
            file.at_depth(2).parsed()

    @pytest.mark.parametrize("depth", [0, -1, 1025])
    def test_out_of_range_is_refused(self, depth: int) -> None:
        with pytest.raises(HarnessError, match=rf"max_depth is {depth}; allowed: 1 \(light seen directly\) to 1024"):
            SceneFile(Path("a.xml"), max_depth=depth)


def replace_path(file: SceneFile) -> SceneFile:
    """What a reading knows of its file: the absolute path, and the size."""
    return dataclasses.replace(file, path=file.path.resolve(), size=(8, 6))
