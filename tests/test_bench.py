"""The benchmark: rows that follow from what was measured, kept and read back; speed itself is never tested."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness import bench, rivals
from harness.bench import Case
from harness.cli import main
from harness.errors import StoreError
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.gpu.device import ENTRY
from harness.results import Benchmark, BenchRow, EntrantRow
from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.scene import SceneFile, load_scene
from harness.scene.without import FEATURES
from tests.support.fakes import NoiseRenderer

CASE = Case("diffuse", "cosine", "path", needed=5.0)
ROW = BenchRow("diffuse", "cosine", "path", "compute", needed=5.0, tracer_rate=12.5, opponent_rate=2.5, ratio=5.1,
               low=4.75, high=5.5, wall_ratio=5.0, efficiency_ratio=3.25)
ENTRANT = EntrantRow("cornell", "tracer", "mis", "sobol", 64, best=True, ratio=4.12, low=3.75, high=4.5)


class Paced(NoiseRenderer):
    """Noise at a known price: `price` CPU seconds for one sample of each pixel, `growth` times more in each round."""

    price: float
    sigma_per_sample: float
    growth = 1.1
    device = "cpu: test"

    def __init__(self, scene: SceneFile, variant: str) -> None:
        super().__init__(sigma=self.sigma_per_sample, size=(4, 4))
        self.pixels = scene.film.width * scene.film.height
        self.variant = variant
        self.released = False

    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[float], None] | None = None) -> Batch:
        batch = super().render_batch(replica, start, count, advance)
        rounds = sum(replica == 1 for replica, _, _ in self.calls)
        seconds = count * self.price * self.growth**max(rounds - 1, 0)
        return dataclasses.replace(batch, cost=Cost(seconds, seconds, None, self.device, "cpu"))


class OurPace(Paced):
    price, sigma_per_sample = 0.01, 0.6


class MitsubasPace(Paced):
    price, sigma_per_sample = 0.06, 0.3


@pytest.fixture
def paced(monkeypatch: pytest.MonkeyPatch) -> list[Paced]:
    """Renderers of known price in the benchmark's place of the real ones; all that were made."""
    made: list[Paced] = []

    def opener(kind: type[Paced], variant: Callable[[Any], str]) -> Callable[..., AbstractContextManager[Paced]]:
        @contextmanager
        def opened(estimator: Any, scene: SceneFile) -> Iterator[Paced]:
            made.append(renderer := kind(scene, variant(estimator)))
            yield renderer
            renderer.released = True
        return opened

    monkeypatch.setattr(Tracer, "open", opener(OurPace, lambda tracer: " without ".join(
        [tracer.strategy, *tracer.without])))
    monkeypatch.setattr(Mitsuba, "open", opener(MitsubasPace, lambda mitsuba: mitsuba.name.removeprefix("mitsuba ")))
    monkeypatch.setattr(bench, "MAX_SPP", 8)
    return made


class TestRun:
    """One row a case."""

    def test_ratios_are_those_of_the_rates(self, paced: list[Paced]) -> None:
        """Each round costs both sides 10 % more than the one before, so every round's ratio is 6."""
        row, = bench.run([CASE], rounds=3)
        assert (row.scene, row.strategy, row.opponent, row.needed) == ("diffuse", "cosine", "path", 5.0)
        assert row.ratio == pytest.approx(6.0)
        assert (row.low, row.high) == pytest.approx((6.0, 6.0))
        assert row.tracer_rate == pytest.approx(paced[0].pixels / OurPace.price / OurPace.growth / 1e6), "a median"
        assert row.tracer_rate / row.opponent_rate == pytest.approx(6.0)

    def test_the_spread_is_of_the_rounds_ratios(self, paced: list[Paced], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(MitsubasPace, "growth", 1.0)
        row, = bench.run([CASE], rounds=3)
        assert (row.high, row.ratio, row.low) == pytest.approx((6.0, 6.0 / 1.1, 6.0 / 1.1**2))

    def test_efficiency_counts_variance_as_well(self, paced: list[Paced]) -> None:
        """Four times the variance at a sixth of the price: 1.5 times as efficient."""
        row, = bench.run([CASE], rounds=200)
        price = row.tracer_rate / row.opponent_rate
        assert row.efficiency_ratio == pytest.approx(price / 4, rel=0.1)

    def test_the_renderers_take_turns_on_the_cases_scene_and_are_released(self, paced: list[Paced]) -> None:
        ticks: list[float | None] = []

        def counting(total: float | None, description: str) -> AbstractContextManager[Callable[[float], None]]:
            ticks.append(total)
            return nullcontext(ticks.append)

        cases = [CASE, Case("furnace_convex", "mixture", "bsdf_path", 4.0)]
        rows = bench.run(cases, rounds=2, progress=counting)
        assert [row.scene for row in rows] == ["diffuse", "furnace_convex"]
        assert [renderer.variant for renderer in paced] == ["cosine", "path", "mixture", "bsdf_path"]
        assert all(renderer.released for renderer in paced)
        assert ticks == [4, 1, 1, 1, 1], "the total first, then a step a round"

    def test_a_feature_is_measured_against_the_scene_without_it(self, paced: list[Paced]) -> None:
        """The opponent is the tracer itself, with the case's own strategy, and is released too."""
        row, = bench.run([Case("diffuse", "mixture", "no lens", 0.8)], rounds=2)
        assert [(type(renderer), renderer.variant, renderer.released) for renderer in paced] == [
            (OurPace, "mixture", True), (OurPace, "mixture without lens", True)]
        assert row.ratio == pytest.approx(1.0)

    def test_no_sample_is_measured_twice(self, paced: list[Paced]) -> None:
        bench.run([CASE], rounds=3)
        for renderer in paced:
            assert len(set(renderer.calls)) == len(renderer.calls)
            measured = [call for call in renderer.calls if call[0] == 1]
            assert [start for _, start, _ in measured] == [sum(c for *_, c in measured[:k]) for k in range(3)]

    @pytest.mark.parametrize(("device", "needed"), [("llvmpipe (LLVM 19, 256 bits)", 5.0),
                                                    ("llvmpipe (LLVM 19, 512 bits)", 8.0)])
    def test_more_is_asked_of_wide_vectors(self, paced: list[Paced], monkeypatch: pytest.MonkeyPatch, device: str,
                                           needed: float) -> None:
        monkeypatch.setattr(OurPace, "device", device)
        row, = bench.run([dataclasses.replace(CASE, wide=8.0)], rounds=2)
        assert row.needed == needed

    @pytest.mark.parametrize("entry", ["", "fragment", "compute"])
    def test_the_real_renderers_fit_in(self, monkeypatch: pytest.MonkeyPatch, entry: str) -> None:
        """By each of the tracer's shaders, too, whose process leaves this one's environment alone."""
        monkeypatch.setattr(bench, "PILOT_SPP", 1)
        monkeypatch.setattr(bench, "MAX_SPP", 1)
        row, = bench.run([Case("diffuse", "cosine", "bsdf_path", 4.0, entry=entry)], rounds=2)
        assert row.entry == entry and ENTRY not in os.environ
        values = dataclasses.asdict(row)
        assert all(math.isfinite(value) and value > 0 for value in values.values() if isinstance(value, float))
        assert row.low <= row.ratio <= row.high


def stratified(paced: Paced, replica: int, start: int, count: int,
               advance: Callable[[float], None] | None = None) -> Batch:
    """With `multijitter` the samples of a replica cancel: its mean varies a tenth as much as of independent ones."""
    batch = Paced.render_batch(paced, replica, start, count, advance)
    if not paced.variant.endswith("multijitter"):
        return batch
    return dataclasses.replace(batch, mean=1 + (batch.mean - 1) * np.float32(math.sqrt(0.1)))


class TestEntrants:
    """Strategies and samplers at equal error, one row each."""

    @pytest.fixture
    def rows(self, paced: list[Paced], monkeypatch: pytest.MonkeyPatch) -> dict[tuple[str, str], EntrantRow]:
        monkeypatch.setattr(Paced, "samples_per_call", 256, raising=False)
        monkeypatch.setattr(MitsubasPace, "render_batch", stratified)
        found = rivals.run(["cornell"], replicas=60)
        return {(row.strategy, row.sampler): row for row in found}

    def test_the_best_of_each_renderer_is_named(self, rows: dict[tuple[str, str], EntrantRow]) -> None:
        assert [key for key, row in rows.items() if row.best and row.renderer == "path"] == [("", "multijitter")]
        assert sum(row.best for row in rows.values()) == 2
        assert rows["", "multijitter"].ratio == 1.0
        assert rows["", "independent"].ratio == pytest.approx(0.1, rel=0.2)

    def test_variance_is_that_of_replicas(self, rows: dict[tuple[str, str], EntrantRow]) -> None:
        """Four times the variance at a sixth of the price: 1.5 times as soon; against the better a tenth of that."""
        plain = rows["mixture", "independent"]
        assert plain.low < 0.15 < plain.high and plain.high < 0.5

    def test_lights_are_sampled_where_a_scene_has_some(self, rows: dict[tuple[str, str], EntrantRow]) -> None:
        assert {strategy for strategy, _ in rows} == {"", "mixture", "nee", "mis"}
        assert {row.strategy for row in rivals.run(["diffuse"], replicas=4)} == {"", "mixture"}

    def test_an_answer_without_noise_has_no_rival(self, paced: list[Paced], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(Paced, "samples_per_call", 256, raising=False)
        monkeypatch.setattr(OurPace, "sigma_per_sample", 0.0)
        assert rivals.run(["diffuse"], replicas=4) == []

    def test_no_replica_counts_twice_and_none_while_kernels_compile(
        self, rows: dict[tuple[str, str], EntrantRow], paced: list[Paced],
    ) -> None:
        assert len(paced) == len(rows) and all(renderer.released for renderer in paced)
        for renderer in paced:
            assert renderer.calls == [(replica, 0, rivals.SPP) for replica in range(61)]

    def test_mitsubas_own_samplers_differ(self) -> None:
        """Of a scene's pixels, in whole replicas, `multijitter` scatters less than half as much."""
        scene = SceneFile.bundled("diffuse", (16, 12))
        variance = {}
        for sampler in ("independent", "multijitter"):
            with Mitsuba("path", sampler=sampler).open(scene) as renderer:
                images = np.array([renderer.render_batch(replica, 0, 64).mean for replica in range(4)])
            variance[sampler] = images.var(axis=0, ddof=1).mean()
        assert variance["multijitter"] < 0.5 * variance["independent"]


def test_without_a_feature_all_else_stays() -> None:
    """The lens closes to a pinhole and moving shapes rest, and nothing else about the scene changes."""
    scene = load_scene(data_dir("mitsuba_scenes") / "diffuse.xml")
    lens = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, aperture_radius=0.25))
    assert FEATURES[bench.WITHOUT["no lens"]](lens) == scene
    moving = dataclasses.replace(scene, shapes=tuple(
        dataclasses.replace(shape, motion=shape.to_world) for shape in scene.shapes))
    assert FEATURES[bench.WITHOUT["no motion"]](moving) == scene


class TestFile:
    """Rows on disk."""

    def test_read_back_what_was_saved(self, tmp_path: Path) -> None:
        rows = (ROW, dataclasses.replace(ROW, scene="größer", ratio=float(np.nextafter(5, 6))))
        found = Benchmark(rows, (ENTRANT,))
        bench.save(found, tmp_path / "new" / "bench.json")
        assert bench.load(tmp_path / "new" / "bench.json") == found

    def test_say_what_they_were_measured_with(self, tmp_path: Path) -> None:
        bench.save(Benchmark((ROW,)), tmp_path / "bench.json")
        held = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
        assert {"mitsuba", "drjit", "gl_renderer", "python"} <= held["versions"].keys()

    @pytest.mark.parametrize("content", [
        b"", b"{", b"\xff\xfe", b"[]", b"{}", b'{"rows": 3}', b'{"rows": [3]}', b'{"rows": [{"scene": "x"}]}',
        b'{"rows": []}',
        json.dumps({"rows": [{**dataclasses.asdict(ROW), "ratio": "fast"}], "entrants": []}).encode(),
        json.dumps({"rows": [{**dataclasses.asdict(ROW), "ratio": None}], "entrants": []}).encode(),
        json.dumps({"rows": [], "entrants": [{**dataclasses.asdict(ENTRANT), "best": "yes"}]}).encode(),
    ])
    def test_that_is_malformed_is_refused_in_one_line(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "bench.json"
        path.write_bytes(content)
        with pytest.raises(StoreError) as caught:
            bench.load(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: not a benchmark result (")
        assert message.endswith("); run `harness bench` again")
        assert "\n" not in message

    def test_that_is_missing_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match="No such file"):
            bench.load(tmp_path / "bench.json")


class TestCommand:
    """`harness bench`."""

    @pytest.fixture(autouse=True)
    def measured(self, monkeypatch: pytest.MonkeyPatch) -> list[BenchRow]:
        rows = [ROW]
        monkeypatch.setattr(bench, "run", lambda rounds, progress: rows)
        monkeypatch.setattr(rivals, "run", lambda replicas, progress: [ENTRANT])
        return rows

    @pytest.mark.parametrize(("ratio", "status"), [(5.0, 0), (4.99, 1)])
    def test_status_is_1_when_a_ratio_misses_what_is_needed(
        self, measured: list[BenchRow], tmp_path: Path, ratio: float, status: int,
    ) -> None:
        measured.append(dataclasses.replace(ROW, ratio=ratio))
        assert main(["bench", "-o", str(tmp_path / "bench.json")]) == status

    def test_keeps_the_result_and_prints_a_row_a_case(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        assert main(["bench", "-o", str(tmp_path / "bench.json")]) == 0
        output = capsys.readouterr()
        assert output.out.splitlines()[1].split() == [
            "diffuse", "cosine", "compute", "path", "12.5", "2.50", "5.10x", "4.75-5.50", "5x", "5.00x", "3.25x"]
        assert output.err == ""
        assert output.out.splitlines()[-1].split() == [
            "cornell", "tracer", "mis", "sobol", "4.12x", "3.75-4.50", "best"]
        assert bench.load(tmp_path / "bench.json") == Benchmark((ROW,), (ENTRANT,))

    def test_json_is_one_object(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["bench", "-o", str(tmp_path / "bench.json"), "--json"]) == 0
        answer = json.loads(capsys.readouterr().out)
        assert answer == {"rows": [dataclasses.asdict(ROW)], "entrants": [dataclasses.asdict(ENTRANT)],
                          "output": str(tmp_path / "bench.json")}
