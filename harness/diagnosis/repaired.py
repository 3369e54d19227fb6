"""The proof of a cause: the author's own text with one line mended, judged again."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.diagnosis.causes import Diagnosis, repairs
from harness.diagnosis.pixels import USUAL, View
from harness.diagnosis.stranger import Judged, judge_stranger
from harness.errors import HarnessError, MachineError, StoreError
from harness.estimators.shader import Shader
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.shader.hosts.shadertoy import exported
from harness.strangers.process import Process

# Files whose lines are the author's lines; in a JSON export they are escaped, and taken out of it; of a pipeline, no.
TEXTS = (".glsl", ".frag", ".fs", ".fsh", ".html", ".htm", ".js", ".vue")
EXPORTS = (".json",)
# So many repairs are tried at most, each with the seconds that the shader itself had: what fails does so at the first
# look, and what passes needs more of them than a verdict against it did.
TRIED = 8


@dataclass(frozen=True, eq=False)
class Repaired:
    """A line with which the shader passes: `where` it stands, 'file:line', as it was and as it is, what was done, and
    the verdict."""

    where: str
    before: str
    after: str
    says: str
    judged: Judged

    @property
    def sentence(self) -> str:
        """The proof in a sentence."""
        return (f"{self.where}: with this line changed it passes: `{self.after}` in place of `{self.before}` "
                f"({self.says})")


def repaired(shader: Shader, diagnosis: Diagnosis, scene: SceneFile, *, store: Store | None = None,
             budget: float = 60.0, tolerance: float | None = None, spp: int | None = None,
             view: View = USUAL, process: Process | None = None) -> Repaired | None:
    """The first known repair of a likely cause with which the shader passes; None where none does. `view`: which
    way up it is and how its rays are spread about their pixels, which the repair leaves as it is.

    Nothing of the author's is changed: copies are judged. Further arguments as `judge_stranger` has them.
    """
    causes = dict.fromkeys(name for cause in diagnosis.causes for name in (cause.id, *cause.alike) if name)
    tried: set[str] = set()
    for name in causes:
        for one in _texts(shader.files):
            for repair in repairs(name, one.text):
                if repair.text in tried:
                    continue
                if len(tried) == TRIED:
                    return None
                tried.add(repair.text)
                judged = _judged(shader, one.root, one.file, one.whole(repair.text), scene, store=store, budget=budget,
                                 tolerance=tolerance, spp=spp, view=view, process=process)
                if judged is not None and judged.outcome == "pass":
                    return Repaired(f"{one.name}:{repair.line}", repair.before, repair.after, repair.says, judged)
    return None


@dataclass(frozen=True)
class _Text:
    """A text whose lines can be mended: what messages call it, the file that holds it, the file or folder that was
    named, and what the file is with another text in its place."""

    name: str
    root: Path
    file: Path
    text: str
    whole: Callable[[str], str]


def _texts(files: Sequence[Path]) -> Iterator[_Text]:
    """Of all files, in order."""
    for root in files:
        for file in sorted(root.rglob("*")) if root.is_dir() else [root]:
            if not file.is_file() or file.suffix.lower() not in (*TEXTS, *EXPORTS):
                continue
            text = file.read_text(encoding="utf-8", errors="replace")
            if file.suffix.lower() in TEXTS:
                yield _Text(str(file), root, file, text, lambda mended: mended)
            else:
                yield from (_Text(f"{file} ({name})", root, file, code, whole) for name, code, whole in exported(text))


def _judged(shader: Shader, root: Path, file: Path, text: str, scene: SceneFile, **options: Any) -> Judged | None:
    """The verdict on a copy with one text exchanged; None where it does not run."""
    with tempfile.TemporaryDirectory(prefix="harness-repair-") as folder:
        copies = []
        for number, each in enumerate(shader.files):
            copy = Path(folder) / str(number) / each.name
            if each.is_dir():
                shutil.copytree(each, copy)
            else:  # with what stands beside it, which it may include
                copy.parent.mkdir()
                for beside in each.parent.iterdir():
                    if beside.suffix.lower() in TEXTS and beside.is_file():
                        shutil.copy(beside, copy.parent / beside.name)
                shutil.copy(each, copy)
            if each == root:
                (copy / file.relative_to(each) if each.is_dir() else copy).write_text(text, encoding="utf-8")
            copies.append(copy)
        try:
            return judge_stranger(replace(shader, files=tuple(copies), contract=None), scene, transforms=False,
                                  **options)
        except (MachineError, StoreError):
            raise
        except HarnessError:
            return None
