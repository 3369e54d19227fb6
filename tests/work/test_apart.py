"""An estimator in a process of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from harness.errors import SceneError
from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.scene import SceneFile
from harness.work.apart import Apart

SCENE = SceneFile.bundled("diffuse", (2, 1))


@dataclass(frozen=True)
class Told:
    """Batches say who drew them: the process, and what a variable of its environment holds. Once released it leaves a
    file."""

    left: Path
    refuses: bool = False
    name = "told"

    def check(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Told]:
        if self.refuses:
            raise SceneError("odd.xml:7: no such shape")
        yield self
        self.left.write_text("released", encoding="utf-8")

    def render_batch(self, replica: int, start: int, count: int) -> Batch:
        mean = np.full((1, 2, 3), float(os.environ["APART"]), np.float32)
        return Batch(mean, count, 0, Cost(1.0, 2.0, None, str(os.getpid()), "cpu"))


def prepare(value: str) -> None:
    os.environ["APART"] = value


def test_draws_in_a_process_that_was_prepared_and_lets_go_of_it(tmp_path: Path) -> None:
    told: list[float] = []
    with Apart(Told(tmp_path / "left"), partial(prepare, "7")).open(SCENE) as renderer:
        batches = [renderer.render_batch(1, start, 3, told.append) for start in (0, 3)]
        assert not (tmp_path / "left").exists()
    assert (tmp_path / "left").read_text(encoding="utf-8") == "released"
    assert "APART" not in os.environ and told == [3, 3]
    assert {batch.mean[0, 0, 0] for batch in batches} == {7.0} and batches[0].samples == 3
    assert len({batch.cost.device for batch in batches} - {str(os.getpid())}) == 1


def test_raises_what_the_estimator_raises(tmp_path: Path) -> None:
    with (pytest.raises(SceneError, match=r"odd\.xml:7: no such shape"),
          Apart(Told(tmp_path / "left", refuses=True), partial(prepare, "7")).open(SCENE)):
        pass
