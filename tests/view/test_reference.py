"""What an image is held against: the longest series of Mitsuba's samples that is in the store, and nothing rendered."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from harness.samples.store import LEAD_IN, Store
from harness.scene import SceneFile
from harness.view import reference
from harness.view.reference import stored_reference
from harness.work.batches import render_estimate
from harness.work.run import Run
from tests.support.fakes import NoiseRenderer

SCENE = SceneFile(Path("any.xml"))


class Known(NoiseRenderer):
    """Mitsuba's part: it may be asked who it is, and must not be asked to render."""

    allowed = False

    def render_batch(self, *arguments: object, **options: object):  # type: ignore[no-untyped-def, override]
        assert self.allowed
        return super().render_batch(*arguments, **options)  # type: ignore[arg-type]


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch) -> Known:
    """In place of Mitsuba."""
    made = Known()

    class Estimator:
        @contextmanager
        def open(self, scene: SceneFile) -> Iterator[Known]:
            made.allowed = False
            yield made

    monkeypatch.setattr(reference, "Mitsuba", Estimator)
    return made


def test_nothing_is_there(renderer: Known, tmp_path: Path) -> None:
    assert stored_reference(SCENE, Store(tmp_path)) is None
    assert stored_reference(SCENE, None) is None


@pytest.mark.parametrize("samples", [8, 300])
def test_one_run_is_found(renderer: Known, tmp_path: Path, samples: int) -> None:
    """As `harness reference` leaves it: of a long one the first samples are not kept."""
    store = Store(tmp_path)
    renderer.allowed = True
    render_estimate(renderer, samples, store=store)
    found = stored_reference(SCENE, store)
    assert found is not None and found.samples == (8 if samples == 8 else 256 - LEAD_IN)


def test_replicas_are_found_and_the_longest_series_counts(renderer: Known, tmp_path: Path) -> None:
    """As studies and gates leave them."""
    store = Store(tmp_path)
    renderer.allowed = True
    render_estimate(renderer, 8, store=store)
    Run(renderer, 32, store).grow(5)
    Run(renderer, 64, store).grow(2)
    found = stored_reference(SCENE, store)
    assert found is not None and (found.samples, found.batches) == (160, 5)
