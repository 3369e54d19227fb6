"""contract.toml: what is written is read back, and what is edited counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.shader.contract import Contract, Law
from harness.shader.contract_file import answer, load, save, stale
from harness.shader.hosts import read
from tests.support.strangers import written

SHADER = """#version 330
in vec2 uv;
out vec4 color;
uniform sampler2D past, map;
uniform int frame;
uniform float gain, steps[2];
uniform vec3 eye;
void main() { color = texture(past, uv) + texture(map, uv) + vec4(eye * gain * steps[1], float(frame)); }
"""
LAW = Law("mean", offset=-1, weight=0.5, encoding="gamma", count="alpha", measured=((4, 0.75), (5, 0.8)))


@pytest.fixture
def paths(tmp_path: Path) -> list[Path]:
    return written(tmp_path, shader__frag=SHADER)


@pytest.fixture
def edited(tmp_path: Path, paths: list[Path]) -> Callable[..., Contract]:
    """The contract of the shader once these parts of its file were exchanged: edited(("old", "new"), …)."""
    def edit(*pairs: tuple[str, str]) -> Contract:
        file = tmp_path / "contract.toml"
        save(replace(read(paths), law=LAW), file)
        text = file.read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new, 1)
        file.write_text(text, encoding="utf-8")
        return load(file, paths)
    return edit


@pytest.mark.parametrize("change", [
    {}, {"law": LAW, "first_frame": 1, "samples": 4, "flipped": True, "size": (12, 8)},
    {"law": Law("sum"), "notes": ('a "note" with \\ and é\nin two lines',)},
])
def test_what_is_saved_is_loaded(tmp_path: Path, paths: list[Path], change: dict[str, object]) -> None:
    values = {"gain": 1e-7, "steps": (0.5, 2.0), "eye": (1.0, 2.0, 3.0), "map": "noise", "frame": "count", "uv": "ndc"}
    contract = replace(read(paths, values=values), **change)  # type: ignore[arg-type]
    save(contract, tmp_path / "contract.toml")
    assert load(tmp_path / "contract.toml", paths) == contract


def test_a_shader_that_changed_since_is_told(tmp_path: Path, paths: list[Path]) -> None:
    file = tmp_path / "contract.toml"
    save(read(paths), file)
    assert stale(file, load(file, paths)) == ""
    paths[0].write_bytes(SHADER.replace("\n", "\r\n").encode())  # no change: ends of lines
    assert stale(file, load(file, paths)) == ""
    paths[0].write_text(SHADER.replace("steps[1]", "steps[0]"), encoding="utf-8")
    warning = stale(file, load(file, paths))
    assert "the shader has changed" in warning and "\n" not in warning
    file.write_text(file.read_text(encoding="utf-8").replace("digest =", "# digest ="), encoding="utf-8")
    assert stale(file, load(file, paths)) == ""


def test_what_nobody_knows_stays_unknown_until_it_is_written(edited: Callable[..., Contract]) -> None:
    assert {one.name for one in edited().unknown} == {"gain", "eye", "steps", "map"}
    known = edited(("# eye = …", "eye = [1, 2.5, 3] "), ("# gain = …", "gain = 2.0 "),
                   ("# steps = …", "steps = [1, 2] "),
                   ('name = "map"\nreads = "black"', 'name = "map"\nreads = "white"'))
    assert not known.unknown and dict(known.values) == {"eye": (1.0, 2.5, 3.0), "gain": 2.0, "steps": (1.0, 2.0)}
    assert {channel.name: channel.reads for channel in known.passes[0].channels} == {"past": "self", "map": "white"}


def test_roles_are_taken_as_they_are_written(edited: Callable[..., Contract]) -> None:
    contract = edited(('frame = "frame"', 'gain = "random"'), ("first_frame = 0", "first_frame = 1"))
    assert contract.passes[0].roles == (("gain", "random"),) and contract.first_frame == 1
    assert "gain" not in {one.name for one in contract.unknown}


@pytest.mark.parametrize(("old", "new", "says"), [
    ("first_frame = 0", "first_frame = 'one'", "first_frame: expected a whole number, found 'one'"),
    ("samples = 1", "samples = true", "samples: expected a whole number, found True"),
    ("samples = 1", "sample = 1", "sample: no such key; there are host, radiance"),
    ('radiance = "main"', 'radiance = "other"', "radiance: no pass 'other'; there are main"),
    ('kind = "mean"', 'kind = "median"', "kind: expected one of 'sum', 'mean'"),
    ('kind = "mean"\n', "\n", "law: it has no kind"), ("[[4, 0.75], [5, 0.8]]", "[[4]]", "measured: expected pairs"),
    ("[values]", "[values]\ngain = 'much'", "gain: expected a number, true, false"),
    ("[values]", "[values]\ngains = 1", "--set gains: the shader declares no uniform"),
    ('name = "main"', 'name = "maine"', "name: the shader has no pass 'maine'; it has main"),
    ('frame = "frame"', 'frame = "fame"', "frame: no such role, 'fame'"),
    ('frame = "frame"', 'farm = "frame"', "farm: the pass declares no such uniform"),
    ('name = "map"', 'name = "cap"', "name: the pass has no sampler 'cap'; it has past, map"),
    ("linear = false", "linear = 1", "linear: expected true or false, found 1"),
    ('host = "desktop"', 'host = "metal"', "no host 'metal'"),
    ("said = []", 'said = ["a"]', "said: expected NAME=VALUE"),
    ("said = []", "said = []\nsize = [4]", "size: expected [width, height]"), ("said = []", "said = [", "not TOML"),
])
def test_what_may_not_stand_there_is_named(edited: Callable[..., Contract], old: str, new: str, says: str) -> None:
    with pytest.raises(HarnessError) as refusal:
        edited((old, new))
    message = str(refusal.value)
    assert says in message and "\n" not in message
    if "host" not in says and "--set" not in says:
        assert message.partition("contract.toml:")[2].split(":")[0].isdecimal()


def test_a_key_is_named_by_its_line(edited: Callable[..., Contract]) -> None:
    with pytest.raises(HarnessError, match=r"contract\.toml:5: host: expected a text in quotes, found 3"):
        edited(('host = "desktop"', "host = 3"))


def test_a_key_of_the_second_pass_is_named_by_its_line(tmp_path: Path) -> None:
    """Both passes have the key; the message must not send its reader to the first."""
    image = "void mainImage(out vec4 c, vec2 p) { c = texelFetch(iChannel0, ivec2(p), 0) + float(iFrame); }\n"
    paths = written(tmp_path, bufferA__glsl=image, image__glsl=image)
    file = tmp_path / "contract.toml"
    save(read(paths), file)
    text = file.read_text(encoding="utf-8")
    head, key, tail = text.rpartition('iFrame = "frame"')
    file.write_text(f'{head}iFrame = "fame"{tail}', encoding="utf-8")
    with pytest.raises(HarnessError, match=rf"contract\.toml:{head.count(chr(10)) + 1}: iFrame: no such role"):
        load(file, paths)
    assert key and len(load_text(file, text).passes) == 2


def load_text(file: Path, text: str) -> Contract:
    file.write_text(text, encoding="utf-8")
    return load(file, sorted(file.parent.glob("*.glsl")))


def test_a_file_that_is_not_there_is_named(tmp_path: Path, paths: list[Path]) -> None:
    with pytest.raises(HarnessError, match="cannot be read"):
        load(tmp_path / "none.toml", paths)
    with pytest.raises(HarnessError, match="cannot be written"):
        save(read(paths), tmp_path / "no" / "folder.toml")


@pytest.mark.parametrize(("text", "value"), [
    ("1", 1), ("-2", -2), ("1.5", 1.5), ("1e3", 1000.0), ("true", True), ("false", False),
    ("1, 2,3.5", (1.0, 2.0, 3.5)),
    ("noise", "noise"), (" frame ", "frame"), ("pass:Buffer A", "pass:Buffer A"), ("a,b", "a,b"),
])
def test_what_is_said_on_the_command_line(text: str, value: object) -> None:
    assert answer(text) == value and type(answer(text)) is type(value)
