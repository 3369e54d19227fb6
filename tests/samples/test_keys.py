"""Keys follow the code: what a number depends on changes them, and what only people read does not."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.samples import keys
from harness.samples.estimate import Batch
from harness.samples.keys import PACKAGE, code_digest, digest, folder_digest

REFERENCE, TRACER, MESH = "harness.reference.renderer", "harness.gpu.renderer", "harness.reference.displaced"
STUDIES = "harness.studies.memo"


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the package that may be edited."""
    folder = tmp_path / "harness"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__", "_data"))
    return folder


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """own(**files): the digest of `harness.main` in a package of these files, the content of each by its path."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))

    def made(files: dict[str, str], module: str = "harness.main") -> str:
        root = tmp_path / "made"
        shutil.rmtree(root, ignore_errors=True)
        for name, content in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(content, encoding="utf-8")
        return afresh(module, root)
    return made


def afresh(module: str, root: Path) -> str:
    """The digest as another process would compute it."""
    code_digest.cache_clear()
    return code_digest(module, root=root)


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize("module", [REFERENCE, TRACER, MESH, STUDIES])
@pytest.mark.parametrize(("file", "old", "new"), [
    pytest.param("scene/displaced.py", "return Displacement(texture, amplitude / radius)",
                 "return Displacement(texture, amplitude)", id="the displaced surface"),
    pytest.param("scene/bitmaps.py", "False, True).shape[0]", "False, True).shape[1]", id="bitmaps"),
])
def test_an_edited_file_is_another_identity(copied: Path, module: str, file: str, old: str, new: str) -> None:
    before = afresh(module, copied)
    edit(copied / file, old, new)
    assert afresh(module, copied) != before


@pytest.mark.parametrize(("module", "file", "old", "new"), [
    pytest.param(TRACER, "gpu/samplers.py", "\nclass ", "\nEDITED = 1\n\n\nclass ", id="the tracer's wrap modes"),
    pytest.param(TRACER, "gpu/pingpong.py", "FLUSH_SAMPLES = 512", "FLUSH_SAMPLES = 513", id="the tracer's counting"),
    pytest.param(STUDIES, "samples/exr.py", "_INT32 = 2**31", "_INT32 = 2**30", id="what a study reads from disk"),
    pytest.param(STUDIES, "machine/mitsuba_runtime.py", "\ndef ", "\nEDITED = 1\n\n\ndef ", id="Mitsuba's runtime"),
])
def test_the_host_counts(copied: Path, module: str, file: str, old: str, new: str) -> None:
    before = afresh(module, copied)
    edit(copied / file, old, new)
    assert afresh(module, copied) != before


@pytest.mark.parametrize("module", [REFERENCE, TRACER, MESH, STUDIES])
def test_comments_and_docstrings_invalidate_nothing(copied: Path, module: str) -> None:
    before = afresh(module, copied)
    path = copied / "scene" / "displaced.py"
    edit(path, "# Why the other textures are refused.", "# Another reason,\n# in two lines.")
    edit(path, '"""Displaced spheres: ', '"""Other words: ')
    edit(path, '    """What the radius r(d) of a displaced sphere', '    """Other words: what the radius')
    edit(path, '    """The properties `amplitude`', '    """Other words: the properties `amplitude`')
    assert afresh(module, copied) == before


def test_who_is_not_imported_counts_not(copied: Path) -> None:
    before = afresh(REFERENCE, copied)
    edit(copied / "gpu" / "pingpong.py", "FLUSH_SAMPLES = 512", "FLUSH_SAMPLES = 513")
    assert afresh(REFERENCE, copied) == before


@pytest.mark.parametrize("line", [
    "import harness.room.part", "import harness.room.part as other", "from harness.room import part",
    "from harness.room.part import VALUE", "from .room import part", "from .room.part import VALUE",
    "def late():\n    from harness.room.part import VALUE",
    "from . import room\nfrom .room import *\nfrom .room import part",
])
def test_every_way_to_import_is_followed(own: Callable[..., str], line: str) -> None:
    """Also on the way: through the package's `__init__`, and from there to what that one imports."""
    files = {"main.py": line, "room/__init__.py": "from .far import FAR", "room/part.py": "VALUE = 1",
             "room/far.py": "FAR = 1"}
    before = own(files)
    assert own(files | {"room/part.py": "VALUE = 2"}) != before
    assert own(files | {"room/__init__.py": "from .far import FAR\nMORE = 1"}) != before
    assert own(files | {"room/far.py": "FAR = 2"}) != before
    assert own(files | {"room/other.py": "OTHER = 1"}) == before


def test_relative_imports_climb(own: Callable[..., str]) -> None:
    files = {"a/__init__.py": "", "a/b/__init__.py": "",
             "a/b/main.py": "from ..part import VALUE\nfrom ...top import T", "a/part.py": "VALUE = 1",
             "top.py": "T = 1"}
    before = own(files, "harness.a.b.main")
    assert own(files | {"a/part.py": "VALUE = 2"}, "harness.a.b.main") != before
    assert own(files | {"top.py": "T = 2"}, "harness.a.b.main") != before


def test_circles_end_and_a_missing_module_is_named(own: Callable[..., str]) -> None:
    assert own({"main.py": "import harness.other", "other.py": "import harness.main"})
    with pytest.raises(ValueError, match=r"no module 'harness\.absent'"):
        own({"main.py": ""}, "harness.absent")


def test_what_was_parsed_is_remembered(
    own: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second process parses nothing; a memory that is damaged only costs time."""
    before = own({"main.py": "A = 1"})
    memory, = (tmp_path / "cache" / "code").iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(keys, "_parsed", lambda source: pytest.fail("parsed again"))
        assert own({"main.py": "A = 1"}) == before
    for damage in ("", "[]", '{"a": 1}', json.dumps({"a": ["b"]})):
        memory.write_text(damage, encoding="utf-8")
        assert own({"main.py": "A = 1"}) == before


def test_a_cache_that_cannot_be_written_costs_only_time(
    own: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = own({"main.py": "A = 1"})
    (tmp_path / "file").touch()
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "file"))
    assert own({"main.py": "A = 1"}) == before


def test_an_installed_copy_has_the_same_keys(copied: Path) -> None:
    """As from a wheel: without the checkout around it, and with bytecode beside it."""
    program = f"import sys; sys.path.insert(0, {str(copied.parent)!r}); from harness.samples import keys\n" \
              f"assert keys.PACKAGE == keys.Path({str(copied)!r}); print(keys.code_digest({TRACER!r}))"
    told = [subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True,
                           cwd=copied.parent).stdout.strip() for _ in range(2)]
    assert told == [afresh(TRACER, PACKAGE)] * 2


def test_plain_values_have_a_digest() -> None:
    """The order of a mapping's entries does not count, everything else does; SHA-256 of the JSON, as anybody can."""
    assert digest({"a": 1, "b": [2.5]}) == digest({"b": (2.5,), "a": 1}) != digest({"a": 1, "b": [2.50001]})
    assert digest("x", 8) == "ba2df490"  # printf '"x"' | sha256sum
    with pytest.raises(TypeError, match="Path has no digest"):
        digest({"a": Path("x")})


def test_arrays_count_by_every_bit() -> None:
    image = np.arange(6.0).reshape(2, 3)
    others = [image.reshape(3, 2), image.astype(np.float32), image + np.eye(2, 3) * 1e-15]
    digests = {digest([each]) for each in (image, image.T.copy().T, *others)}
    assert len(digests) == 4
    assert digest(Batch(image, 4)) == digest(Batch(image.copy(), 4)) != digest(Batch(image, 5))


def test_glsl_counts_as_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    shader, note = tmp_path / "lib" / "a.glsl", tmp_path / "note.txt"
    shader.write_text("// one", encoding="utf-8")
    before = folder_digest(tmp_path, ".glsl", ".frag")
    note.write_text("aside", encoding="utf-8")
    assert folder_digest(tmp_path, ".glsl", ".frag") == before
    shader.write_text("// two", encoding="utf-8")
    assert folder_digest(tmp_path, ".glsl", ".frag") != before
