"""How a scene is shown: read from its file, apart from what light depends on."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import SceneError
from harness.scene import Presentation, SceneFile, load, present

FILE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="2"/>{strategies}</integrator>
<sensor type="{sensor}"><film type="hdrfilm">{exposure}<rfilter type="{filter}"/></film></sensor></scene>"""


def write(path: Path, *, exposure: float | None = None, strategies: str | None = None, filter: str = "box",
          sensor: str = "perspective") -> SceneFile:
    """A scene file that says these things of how it is shown."""
    path.write_text(FILE.format(
        exposure="" if exposure is None else f'<float name="exposure" value="{exposure}"/>', filter=filter,
        strategies="" if strategies is None else f'<string name="strategies" value="{strategies}"/>', sensor=sensor))
    return SceneFile(path)


def test_is_what_the_file_says(tmp_path: Path) -> None:
    assert present(write(tmp_path / "a.xml")) == Presentation()
    found = present(write(tmp_path / "a.xml", exposure=1.5, strategies=" mixture,, cosine", filter="gaussian"))
    assert found == Presentation(1.5, ("mixture", "cosine"),
                                 ("reconstruction filter 'gaussian' replaced by box in both renderers",))


def test_leaves_the_hash_alone(tmp_path: Path) -> None:
    """Batches are found again whatever the scene is shown like."""
    plain = load(write(tmp_path / "a.xml")).content_hash
    for change in ({"exposure": -2.0}, {"strategies": "cosine"}, {"filter": "tent"}):
        assert load(write(tmp_path / "a.xml", **change)).content_hash == plain  # type: ignore[arg-type]


def test_of_a_sensor_that_is_not_ours_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"sensor 'orthographic' is not supported"):
        present(write(tmp_path / "a.xml", sensor="orthographic"))
