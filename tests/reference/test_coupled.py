"""The coupled oracle: it follows the tracer's paths in every scene, and sees what the tracer gets wrong."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from harness.errors import SceneError
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.scene import SceneFile
from harness.shader.library import OURS, Library

SPP = 16
REPLICA, FIRST = 3, 5
# Float32 sums of two renderers that are both right: the mean in units of itself, without a parting.
ROUNDING = 5e-7
# A sample has parted from its twin where it is off by more than this of the image's mean.
PARTED = 1e-2


class Pair(NamedTuple):
    """Means (H, W, 3) of the tracer and the oracle, of the same samples; `singles`, (N, H, W, 3) both, one by one."""

    tracer: np.ndarray
    oracle: np.ndarray
    singles: tuple[np.ndarray, np.ndarray]

    @property
    def error(self) -> float:
        """Of the image's mean, relative."""
        return float(self.tracer.mean() / self.oracle.mean() - 1)

    def share(self, off_by: float) -> float:
        """Of single samples, those that are off by more of the image's mean."""
        ours, theirs = self.singles
        return float((np.abs(ours - theirs).max(-1) > off_by * self.oracle.mean()).mean())


def pair(name: str, strategy: str, size: tuple[int, int] = (48, 36), library: Library = OURS, singles: int = 2,
         sampler: str = "independent") -> Pair:
    scene = SceneFile.bundled(name, size)
    with Tracer(strategy, library, sampler=sampler).open(scene) as tracer, \
            Coupled(strategy, sampler).open(scene) as oracle:
        both = [renderer.render_batch(REPLICA, FIRST, SPP).mean.astype(np.float64) for renderer in (tracer, oracle)]
        one = [np.stack([renderer.render_batch(REPLICA, FIRST + k, 1).mean for k in range(singles)])
               for renderer in (tracer, oracle)]
    return Pair(both[0], both[1], (one[0], one[1]))


@pytest.mark.parametrize("strategy", ["uniform", "cosine", "phong", "lobes", "mixture"])
def test_follows_every_strategy(strategy: str) -> None:
    """Balls with lobes on a floor: the mean to rounding, and no sample parts (one in a million does)."""
    found = pair("spheres", strategy)
    assert abs(found.error) < 1e-5
    assert found.share(PARTED) <= 1 / (2 * 48 * 36)


@pytest.mark.parametrize(("name", "strategy"), [("depth_of_field", "mixture"), ("motion_blur", "mis")])
def test_follows_the_other_sampler(name: str, strategy: str) -> None:
    """Lens, time, lobes, and lights that are chosen: every call of the sampler's, in its order."""
    found = pair(name, strategy, (24, 18), sampler="sobol")
    assert abs(found.error) < 2e-5
    assert found.share(PARTED) <= 3 / (2 * 24 * 18)


# What each scene has that no other has, and the share of single samples that part: of 3456, so 3e-4 is one.
@pytest.mark.parametrize(("name", "strategy", "parted", "mean"), [
    ("diffuse", "mixture", 0, ROUNDING),
    ("cornell", "mixture", 3e-4, 2e-5),
    ("environment", "mixture", 3e-4, 5e-6),
    ("depth_of_field", "mixture", 3e-4, 1e-5),
    ("textures", "lobes", 1e-3, 1e-5),
    ("procedural", "mixture", 3e-4, 5e-6),
    ("motion_blur", "mixture", 3e-4, 5e-6),
    ("course_scene", "mixture", 1e-3, 2e-5),
    ("transforms", "mixture", 3e-4, 5e-6),
    ("cylinders", "mixture", 1e-3, 5e-5),  # Mitsuba's are off by up to 5e-4 in distance
    ("area_lights", "cosine", 3e-3, 5e-5),  # cylinders again
    ("glossy_ladder", "phong", 3e-4, 1e-5),
    ("displaced", "mixture", 2e-2, 1e-3),  # a mesh in Mitsuba: normals are off by 4e-3
])
def test_follows_every_feature_of_a_scene(name: str, strategy: str, parted: float, mean: float) -> None:
    found = pair(name, strategy)
    assert found.share(PARTED) <= parted
    assert abs(found.error) < mean


@pytest.mark.parametrize("name", ["furnace_cube", "furnace_convex"])
def test_furnaces_have_no_noise_left(name: str) -> None:
    """Nothing but rounding, in every pixel: closed forms at one sample as at many."""
    found = pair(name, "cosine", (16, 16))
    np.testing.assert_allclose(found.tracer, found.oracle, rtol=2e-6)


def test_sees_an_albedo_that_is_one_ten_thousandth_too_high() -> None:
    """Of which a plain comparison at 16 samples, or at 16,000, knows nothing."""
    line = ("lib/phong.glsl", "return m.kd;", "return m.kd * 1.0001;")
    assert abs(pair("diffuse", "cosine").error) < ROUNDING
    assert pair("diffuse", "cosine", library=OURS.with_line(*line)).error == pytest.approx(6.6e-5, rel=0.2)


def test_one_kernel_follows_all_paths_of_a_scene() -> None:
    """Whatever replica, range and rows: to compile one takes as long as to follow a million paths."""
    import drjit

    with Coupled("cosine").open(SceneFile.bundled("diffuse", (25, 19))) as oracle, \
            drjit.scoped_set_flag(drjit.JitFlag.KernelHistory, True):
        drjit.kernel_history_clear()
        for replica, (first, samples) in enumerate([(0, 1), (1, 1), (0, 3), (5, 16), (0, 16), (7, 33), (2, 80)]):
            oracle.render_batch(replica, first, samples)
        kernels = {kernel["hash"] for kernel in drjit.kernel_history() if kernel.get("operation_count", 0) > 200}
        drjit.kernel_history_clear()
    assert len(kernels) == 1


def test_a_batch_is_the_mean_of_its_samples_however_they_are_divided(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replica and number of a sample fix it: not the batch, nor how many paths a kernel follows."""
    scene = SceneFile.bundled("spheres", (24, 18))
    with Coupled("mixture").open(scene) as oracle:
        whole = oracle.render_batch(2, 0, 80).mean
        halves = [oracle.render_batch(2, start, 40).mean for start in (0, 40)]
        other = oracle.render_batch(1, 0, 80).mean
        monkeypatch.setattr("harness.reference.coupled.LANES", 24 * 5 * 64)
        rows = oracle.render_batch(2, 0, 80).mean
    np.testing.assert_allclose(np.mean(halves, axis=0), whole, rtol=1e-6)
    np.testing.assert_allclose(rows, whole, rtol=1e-6)
    assert np.abs(other / whole - 1).mean() > 1e-2


def test_a_batch_knows_the_largest_of_its_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every pixel and channel, over blocks of samples too."""
    monkeypatch.setattr("harness.reference.coupled.BLOCK", 4)
    with Coupled("mixture").open(SceneFile.bundled("spheres", (12, 9))) as oracle:
        found = oracle.render_batch(2, 3, 6).largest
        singles = [oracle.render_batch(2, 3 + k, 1).mean for k in range(6)]
    assert found is not None and found.dtype == np.float32
    np.testing.assert_allclose(found, np.max(singles, axis=0), rtol=1e-6)
    assert (found > np.mean(singles, axis=0)).any()


def test_depth_is_counted_as_in_the_file() -> None:
    """`max_depth` 1 is emission seen directly, and the file's own stands where none is given."""
    scene = SceneFile.bundled("furnace_cube", (8, 8))
    with Coupled("cosine").open(scene.at_depth(1)) as oracle:
        np.testing.assert_allclose(oracle.render_batch(0, 0, 1).mean, np.broadcast_to([0.2, 0.4, 0.6], (8, 8, 3)),
                                   rtol=1e-6)
        assert oracle.identity["max_depth"] == "1"
    with Coupled("cosine").open(scene) as oracle:
        assert oracle.identity["max_depth"] == "8"


def test_leaves_out_what_is_not_finite_and_counts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from harness.reference.coupled import CoupledRenderer

    honest: Callable[..., Any] = CoupledRenderer._trace

    def broken(self: Any, begun: Any) -> Any:
        import drjit as dr

        return dr.select(begun.seed % 2 == 0, honest(self, begun), dr.nan)

    scene = SceneFile.bundled("furnace_cube", (8, 8))
    with Coupled("cosine").open(scene) as oracle:
        truth = oracle.render_batch(0, 0, 32).mean
        monkeypatch.setattr(CoupledRenderer, "_trace", broken)
        batch = oracle.render_batch(0, 0, 32)
    assert 800 < batch.rejected < 1250
    np.testing.assert_allclose(batch.mean, truth, rtol=1e-6)


def test_advances_as_samples_come() -> None:
    told: list[int] = []
    with Coupled("cosine").open(SceneFile.bundled("furnace_cube", (8, 8))) as oracle:
        oracle.render_batch(0, 0, 100, told.append)
    assert told == [64, 36]


def test_refuses_a_scene_outside_the_tracers_subset(tmp_path: Path) -> None:
    """With file and line, as the tracer does: it has no paths there that could be followed."""
    text = SceneFile.bundled("furnace_convex").path.read_text(encoding="utf-8")
    file = tmp_path / "glass.xml"
    file.write_text(text.replace('<bsdf type="diffuse">', '<bsdf type="dielectric">'), encoding="utf-8")
    with pytest.raises(SceneError, match=r"glass\.xml:\d+: .*dielectric"), Coupled().open(SceneFile(file)):
        pass


def test_is_told_apart_by_what_it_depends_on() -> None:
    scene = SceneFile.bundled("furnace_cube", (8, 8))
    identities = set()
    for estimator, file in ((Coupled("cosine"), scene), (Coupled("uniform"), scene),
                            (Coupled("cosine"), scene.at_depth(3)),
                            (Coupled("cosine"), dataclasses.replace(scene, size=(9, 8)))):
        with estimator.open(file) as oracle:
            identities.add(tuple(sorted(oracle.identity.items())))
    assert len(identities) == 4
