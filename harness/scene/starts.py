"""Starts: a scene file for somebody to go on from, with the images that it reads and a gates file that judges it."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from harness.errors import HarnessError
from harness.scene.file import SceneFile

# The bundled scene that a start is a copy of, unless another is named: commented throughout.
SKELETON = "starts/ball"
# What names an image in the bundled scenes.
_FILE = re.compile(r'(<string name="filename" value=")(?P<file>[^"]+)(")')
GATES = '''# A tolerance gate of {scene}: run it by `harness gate {gates}`, or by pytest.
[[gate]]
name = "{name}"
scene = "{scene}"                # relative to this file
strategy = "mixture"             # how directions are drawn: uniform, cosine, phong, lobes or mixture
size = [48, 36]                  # small images are decided soon
spp = 256                        # of each of up to 64 replicas: it draws no more than it needs
reference = {{ spp = 64 }}         # Mitsuba's, of each replica too
tolerance = {{ mean = 0.01, coarse = 0.2, fine = 1.0 }}  # bias of the image, of its larger and its smaller tiles
reason = "A first gate: say here what it guards, and why these tolerances."
# shader = "my_tracer.frag"      # puts a shader of yours in the place of the harness's, see `harness new-shader`
'''


def gates_file(path: Path) -> Path:
    """Where the gates of a new scene are put."""
    return path.with_name(f"{path.stem}_gates.toml")


def start(path: Path, source: str = SKELETON) -> dict[Path, bytes]:
    """The files of a new scene at `path`: the bundled scene `source` as it stands, its images in `textures/` beside it,
    and a gates file.

    HarnessError for a scene that is not bundled, or a path that is no .xml file's.
    """
    if path.suffix != ".xml" or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", path.name):
        raise HarnessError(f"'{path}': a scene is an .xml file whose name has letters, digits, '.', '_' and '-'; give "
                           "one such as my_scene")
    origin = SceneFile.bundled(source).path
    files: dict[Path, bytes] = {}

    def beside(found: re.Match[str]) -> str:
        image = origin.parent / found["file"]
        files[path.parent / "textures" / image.name] = image.read_bytes()
        return f"{found[1]}{PurePosixPath('textures') / image.name}{found[3]}"

    text = _FILE.sub(beside, origin.read_text(encoding="utf-8"))
    gates = GATES.format(name=path.stem, scene=path.name, gates=gates_file(path).name)
    return {path: text.encode(), gates_file(path): gates.encode(), **files}
