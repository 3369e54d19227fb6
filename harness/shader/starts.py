"""Starts: a whole, right and commented path tracer for a student to go on from, in each dialect that one may need.

All hold the same text, glsl/starts/tracer.glsl, between the head and the `main` of their host; it traces the scene
mitsuba_scenes/starts/ball.xml. To add a host, put its file into glsl/starts/ and a row into `HOSTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

from harness.errors import HarnessError
from harness.files import data_dir

# The bundled scene that the starts trace.
SCENE = "starts/ball"


@dataclass(frozen=True)
class Start:
    """A host's files: where each is put, with {name} for what the user calls it, and from which of glsl/starts/.

    `checked`: what `harness check` is given; `hint`: where the file goes on from here.
    """

    files: tuple[tuple[str, str], ...]
    checked: str
    hint: str


HOSTS: Mapping[str, Start] = {
    "body": Start((("{name}.glsl", "body.glsl"),), "{name}.glsl",
                  "paste it as the fragment body of a ping-pong node in Gratin"),
    "gratin": Start((("{name}.gra", "gratin.gra"),), "{name}.gra", "open it in Gratin"),
    "shadertoy": Start((("{name}/bufferA.glsl", "shadertoy_buffer.glsl"),
                        ("{name}/image.glsl", "shadertoy_image.glsl")),
                       "{name}/bufferA.glsl {name}/image.glsl",
                       "paste the files into the tabs Buffer A and Image, both with Buffer A as iChannel0"),
    "webgl": Start((("{name}.html", "webgl.html"),), "{name}.html", "open it in a browser"),
    "glslviewer": Start((("{name}.frag", "glslviewer.frag"),), "{name}.frag", "run `glslViewer {name}.frag`"),
    "native": Start((("{name}.frag", "native.frag"),), "{name}.frag",
                    'a gate with shader = "{file}" judges it as well'),
}


def check_command(host: str, name: str) -> str:
    """The command line that checks a start."""
    return f"harness check {HOSTS[host].checked.format(name=name)} --scene {SCENE}"


def hint(host: str, name: str) -> str:
    """What a start of this name is opened with."""
    return HOSTS[host].hint.format(name=name, file=f"{Path(name).name}.frag")


def start(host: str, name: str) -> dict[Path, str]:
    """The files of a start called `name`, a path without a suffix, with their texts. HarnessError for an unknown host,
    and for a name that no file can have."""
    if host not in HOSTS:
        raise HarnessError(f"--host: there is no host '{host}'; choose from {', '.join(HOSTS)}")
    if not Path(name).name or name.endswith(("/", "\\")):
        raise HarnessError(f"'{name}' is no name of a file; give one such as my_tracer")
    files = {}
    for place, template in HOSTS[host].files:
        path = Path(place.format(name=name))
        files[path] = _filled(template, {"check": check_command(host, name), "name": Path(name).name,
                                         "file": path.name})
    return files


def _filled(template: str, words: Mapping[str, str]) -> str:
    """A template with its @words@ and the files that it takes up; in a .gra file texts stand in attributes."""
    text = _read(template)
    if template.endswith(".gra"):
        body, display = _filled("body.glsl", words), _read("gratin_display.glsl")
        return text.replace("@body@", _attribute(body)).replace("@display@", _attribute(display))
    text = text.replace("@tracer@\n", _read("tracer.glsl"))
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text


def _attribute(text: str) -> str:
    """A text as the value of an XML attribute, in which plain line ends would become spaces."""
    return escape(text).replace("\n", "&#xa;").replace("\t", "&#x9;")


def _read(name: str) -> str:
    return (data_dir("glsl") / "starts" / name).read_text(encoding="utf-8")
