"""What gates are held against: Mitsuba's image, rendered once, a file's, a closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.gates import Gate, References, run_gate
from harness.reference.renderer import ReferenceRenderer
from harness.samples.estimate import Estimate, merge, with_luminance
from harness.samples.exr import write_estimate
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.stats.tiles import TileAccumulator
from harness.work.run import Run, tiles_of
from tests.support.fakes import NoiseRenderer
from tests.support.gates import GATES, Noise, judging, one_gate, small, write


@pytest.fixture
def gate(tmp_path: Path) -> Gate:
    return one_gate(tmp_path)


class TestReference:
    """Mitsuba's, a file's, a closed form's."""

    def test_of_mitsuba_is_rendered_once_for_gates_of_one_scene(
        self, gate: Gate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """And not at all in a second run, for it is kept. Looks see as many of its replicas as of the test's."""
        calls: list[tuple[int, int, int]] = []
        made: list[object] = []

        class Fake(NoiseRenderer):
            def __init__(self, scene: SceneFile, integrator: str, **options: object) -> None:
                super().__init__(0.5, 0.01, (40, 40))
                self.calls = calls
                made.append(self)

            def release(self) -> None:
                pass

        monkeypatch.setattr("harness.estimators.mitsuba.ReferenceRenderer", Fake)
        gates_file = write(tmp_path, GATES.replace("{ value = [0.5, 0.5, 0.5] }", "{ spp = 4 }"))
        gate = one_gate(tmp_path, gates_file.read_text())
        references = References(Store(tmp_path / "store"))
        first = run_gate(judging(gate, Noise()), references)
        run_gate(judging(gate, Noise(name="uniform")), references)
        assert calls == [(replica, 0, 4) for replica in range(16)]
        assert len(made) == 1
        assert first.looks[0].reference_samples == 64
        run_gate(judging(gate, Noise(gate.tolerance.mean)), References(Store(tmp_path / "store")))
        assert calls == [(replica, 0, 4) for replica in range(64)]

    def test_of_a_file_counts_with_its_variance(self, tmp_path: Path) -> None:
        truth = merge(NoiseRenderer(0.5, 0.1, (40, 40)).render_batch(99, k, 4) for k in range(32))
        write_estimate(tmp_path / "truth.exr", truth)
        gate = one_gate(tmp_path, GATES.replace("value = [0.5, 0.5, 0.5]", 'file = "truth.exr"'))
        result = run_gate(judging(gate, Noise(sigma=0.001)))
        width = (result.verdict.mean.high - result.verdict.mean.low)[0, 0]
        assert result.looks[0].reference_samples == 128
        # Student's interval from the 32 batches' variance, at the first look's share of the level.
        np.testing.assert_allclose(width / 2, 2.6 * np.sqrt(truth.image_variance) / 0.5, rtol=0.35)

    def test_of_a_file_without_variance_is_refused(self, tmp_path: Path) -> None:
        one = merge([NoiseRenderer(0.5, 0.1, (40, 40)).render_batch(0, 0, 4)])
        write_estimate(tmp_path / "truth.exr", one)
        gate = one_gate(tmp_path, GATES.replace("value = [0.5, 0.5, 0.5]", 'file = "truth.exr"'))
        with pytest.raises(HarnessError, match=r"gate 'sky': the reference truth\.exr carries no variance"):
            run_gate(judging(gate, Noise()))

    def test_of_an_exact_file_is_exact(self, tmp_path: Path) -> None:
        write_estimate(tmp_path / "truth.exr", Estimate.exact(np.full((40, 40, 3), 0.5)))
        gate = one_gate(tmp_path, GATES.replace("value = [0.5, 0.5, 0.5]", 'file = "truth.exr"'))
        assert run_gate(judging(gate, Noise())).looks[0].reference_samples == 0

    def test_of_another_size_is_refused(self, tmp_path: Path) -> None:
        write_estimate(tmp_path / "truth.exr", Estimate.exact(np.full((20, 40, 3), 0.5)))
        gate = one_gate(tmp_path, GATES.replace("value = [0.5, 0.5, 0.5]", 'file = "truth.exr"'))
        with pytest.raises(HarnessError, match="is 40 x 20, expected 40 x 40; render both at the same size"):
            run_gate(judging(gate, Noise()))

    def test_pseudo_batches_have_the_moments_of_the_batches(self) -> None:
        """Tile by tile exactly, and over the whole image as independent pixels have them."""
        renderer = NoiseRenderer(0.5, 0.3, (41, 30))
        batches = [renderer.render_batch(0, k, 4) for k in range(64)]
        accumulator = TileAccumulator(4)
        for batch in batches:
            accumulator.add(with_luminance(batch.mean), batch.samples)
        real, made = accumulator.samples(), tiles_of(merge(batches), 4)
        np.testing.assert_allclose(made.moments().mean, real.moments().mean, rtol=1e-6)
        # Pixels' variances add up; that of the tile by its own batches scatters about it.
        ratio = made.moments().variance / real.moments().variance
        assert np.median(ratio) == pytest.approx(1, abs=0.1)
        whole = made.whole().moments()
        np.testing.assert_allclose(whole.mean, real.whole().moments().mean, rtol=1e-6)
        np.testing.assert_allclose(whole.variance[..., :3], 0.09 / (64 * 4 * 41 * 30), rtol=0.6)


def test_mitsubas_reference_is_what_gates_are_held_against(tmp_path: Path) -> None:
    """End to end once: the tracer's shader and Mitsuba on one scene, which is exact for both."""
    gate = one_gate(tmp_path, GATES.replace("{ value = [0.5, 0.5, 0.5] }", "{ spp = 2 }"))
    with References() as references:
        result = run_gate(gate, references)
        assert result.outcome == "pass"
        run = references.of(gate)
        assert isinstance(run, Run) and run.renderer.identity["renderer"] == "mitsuba"


def test_one_of_mitsubas_scenes_is_held_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was drawn of the others is kept, and more can be."""
    living: list[ReferenceRenderer] = []

    class Watched(ReferenceRenderer):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            living.append(self)

        def release(self) -> None:
            super().release()
            living.remove(self)

    monkeypatch.setattr("harness.estimators.mitsuba.ReferenceRenderer", Watched)
    first = one_gate(tmp_path, GATES.replace("{ value = [0.5, 0.5, 0.5] }", "{ spp = 2 }"))
    second = small(first, 20)
    references, sizes = References(), []
    runs = [references.of(gate) for gate in (first, second)]
    for run in runs:
        run.grow(1)
        sizes.append([renderer.scene.size for renderer in living])
    assert sizes == [[(40, 40)], [(20, 20)]]
    references.close()
    assert living == []
    assert references.of(first) is runs[0]
    runs[0].grow(2)
    assert runs[0].estimate().samples == 4
    references.close()
    assert living == []
