"""EXR files: exact round trips, headers that any viewer understands, and damage that never goes unnoticed."""

from __future__ import annotations

import dataclasses
import io
import os
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from harness.errors import StoreError
from harness.samples.cost import Cost
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.exr import read_batch, read_estimate, write_batch, write_estimate

SHAPE = (5, 7)
COST = Cost(0.2, 0.1, None, "cpu: test", "cpu")
METADATA = {"strategy": "mixture", "spp": 24, "replica": 3, "exposure": -0.5, "scene.hash": "0123456789abcdef"}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240604)


@pytest.fixture
def batch(rng: np.random.Generator) -> Batch:
    return Batch(rng.gamma(2.0, 0.5, (*SHAPE, 3)).astype(np.float32), 8, rejected=2, cost=COST)


@pytest.fixture
def estimate(rng: np.random.Generator) -> Estimate:
    return merge(Batch(rng.gamma(2.0, 0.5, (*SHAPE, 3)), 8, rejected=1, cost=COST) for _ in range(3))


def foreign(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    """An EXR file that this harness did not write."""
    layout = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.NO_COMPRESSION}
    with OpenEXR.File({**layout, **header}, channels) as file:
        file.write(str(path))
    return path


def plane(value: float, kind: str = "f4") -> np.ndarray:
    return np.full(SHAPE, value, dtype=kind)


class TestEstimates:
    """What is written comes back."""

    def test_round_trip(self, tmp_path: Path, estimate: Estimate) -> None:
        """Pixels to float32, everything else exactly."""
        write_estimate(tmp_path / "a.exr", estimate, METADATA)
        found, metadata = read_estimate(tmp_path / "a.exr")
        for name in ("mean", "variance", "luminance_variance"):
            expected = getattr(estimate, name)
            np.testing.assert_array_equal(getattr(found, name), expected.astype(np.float32), name)
            assert getattr(found, name).dtype == np.float64
        assert estimate.image_third is not None
        for name in ("image_mean", "image_variance", "image_third"):
            np.testing.assert_array_equal(getattr(found, name), getattr(estimate, name), name)
        for name in ("samples", "batches", "rejected", "cost"):
            assert getattr(found, name) == getattr(estimate, name)
        assert metadata == METADATA

    def test_unknown_variance_stays_unknown(self, tmp_path: Path, batch: Batch) -> None:
        write_estimate(tmp_path / "a.exr", merge([batch]))
        found, _ = read_estimate(tmp_path / "a.exr")
        assert np.isnan(found.variance).all() and np.isnan(found.luminance_variance).all()
        assert np.isnan(found.image_variance).all()
        assert found.batches == 1
        with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
            assert set(file.channels()) == {"R", "G", "B"}

    def test_exact_answer_stays_exact(self, tmp_path: Path) -> None:
        write_estimate(tmp_path / "a.exr", Estimate.exact(np.full((*SHAPE, 3), 0.5)))
        found, _ = read_estimate(tmp_path / "a.exr")
        assert found.batches == 0 and not found.variance.any() and not found.image_variance.any()

    def test_broken_pixels_are_kept(self, tmp_path: Path, estimate: Estimate) -> None:
        """A NaN in a render is a finding, not a reason to lose the render."""
        estimate.mean[2, 3] = np.nan
        estimate.mean[4, 5] = np.inf
        write_estimate(tmp_path / "a.exr", estimate)
        found, _ = read_estimate(tmp_path / "a.exr")
        np.testing.assert_array_equal(found.mean, estimate.mean.astype(np.float32))

    def test_batch_reads_as_an_estimate_without_variance(self, tmp_path: Path, batch: Batch) -> None:
        write_batch(tmp_path / "a.exr", batch, {"spp": 8})
        found, metadata = read_estimate(tmp_path / "a.exr")
        np.testing.assert_array_equal(found.mean, batch.mean)
        assert np.isnan(found.variance).all()
        assert (found.samples, metadata) == (8, {"spp": 8})


class TestBatches:
    """The store depends on exactness."""

    @pytest.mark.parametrize("compact", [False, True])
    def test_round_trip_is_exact(self, tmp_path: Path, batch: Batch, compact: bool) -> None:
        write_batch(tmp_path / "a.exr", batch, compact=compact)
        found = read_batch(tmp_path / "a.exr")
        np.testing.assert_array_equal(found.mean, batch.mean)
        assert found.mean.dtype == np.float32
        assert (found.samples, found.rejected, found.cost) == (8, 2, COST)
        assert found.largest is None

    def test_the_largest_samples_come_along(self, tmp_path: Path, batch: Batch) -> None:
        largest = (batch.mean * np.float32(3)).astype(np.float32)
        write_batch(tmp_path / "a.exr", dataclasses.replace(batch, largest=largest), compact=True)
        found = read_batch(tmp_path / "a.exr")
        assert found.largest is not None and found.largest.dtype == np.float32
        np.testing.assert_array_equal(found.largest, largest)
        np.testing.assert_array_equal(found.mean, batch.mean)

    @pytest.mark.parametrize("shape", [(1, 1), (1, 7), (33, 2), (192, 256)])
    def test_compact_ones_keep_every_bit(
        self, tmp_path: Path, rng: np.random.Generator, shape: tuple[int, int],
    ) -> None:
        """Whatever the bits say: NaNs, infinities, denormals, both zeros."""
        bits = rng.integers(0, 2**32, (*shape, 3), dtype=np.uint32)
        bits.flat[:3] = 0x80000000, 0x7F800000, 0xFFC00001
        bits[np.isnan(bits.view(np.float32))] |= 0x00400000  # quiet: numpy warns of others wherever they are touched
        write_batch(tmp_path / "a.exr", Batch(bits.view(np.float32), 8), compact=True)
        np.testing.assert_array_equal(read_batch(tmp_path / "a.exr").mean.view(np.uint32), bits)

    def test_compact_ones_take_two_thirds_of_the_room(self, tmp_path: Path, rng: np.random.Generator) -> None:
        grey = rng.gamma(20.0, 0.05, (192, 256, 1)) * [0.5, 0.8, 1.0] * rng.gamma(1e4, 1e-4, (192, 256, 3))
        noise = Batch(grey.astype(np.float32), 32)
        for compact in (False, True):
            write_batch(tmp_path / f"{compact}.exr", noise, compact=compact)
        assert (tmp_path / "True.exr").stat().st_size < 0.75 * (tmp_path / "False.exr").stat().st_size

    def test_other_files_are_not_batches(self, tmp_path: Path, estimate: Estimate) -> None:
        write_estimate(tmp_path / "a.exr", estimate)
        with pytest.raises(StoreError, match=r"a\.exr: not a batch"):
            read_batch(tmp_path / "a.exr")


class TestHeader:
    """What a viewer sees."""

    def test_header_is_what_viewers_expect(self, tmp_path: Path, estimate: Estimate) -> None:
        write_estimate(tmp_path / "a.exr", estimate, METADATA)
        with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
            header = dict(file.header())
            channels = file.channels()
            assert set(channels) == {"R", "G", "B", "variance.R", "variance.G", "variance.B", "variance.Y",
                                     "third.R", "third.G", "third.B"}
            assert all(channel.pixels.dtype == np.float32 for channel in channels.values())
            np.testing.assert_array_equal(channels["B"].pixels, estimate.mean[..., 2].astype(np.float32))
        for window in ("dataWindow", "displayWindow"):
            np.testing.assert_array_equal(header[window], [[0, 0], [SHAPE[1] - 1, SHAPE[0] - 1]])
        assert header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert header["type"] == OpenEXR.scanlineimage
        np.testing.assert_allclose(header["chromaticities"], (.64, .33, .30, .60, .15, .06, .3127, .3290), rtol=1e-6)
        assert (header["strategy"], header["spp"], header["exposure"]) == ("mixture", 24, -0.5)

    def test_numbers_that_the_format_cannot_hold_become_text(self, tmp_path: Path, batch: Batch) -> None:
        """The library would wrap a large integer around without a word, and refuse numpy's scalars and paths."""
        given = {"large": 2**31, "negative": -2**31 - 1, "int": np.int64(5), "float": np.float32(0.25),
                 "path": Path("a")}
        write_batch(tmp_path / "a.exr", batch, given)
        _, metadata = read_estimate(tmp_path / "a.exr")
        assert metadata == {"large": "2147483648", "negative": "-2147483649", "int": 5, "float": 0.25, "path": "a"}

    def test_metadata_cannot_displace_the_format(self, tmp_path: Path, batch: Batch) -> None:
        with pytest.raises(ValueError, match="must not be called type"):
            write_batch(tmp_path / "a.exr", batch, {"type": "bright"})


class TestForeignFiles:
    """References that other programs rendered."""

    @pytest.mark.parametrize("kind", ["f2", "f4"])
    def test_rgb_is_all_that_is_needed(self, tmp_path: Path, kind: str) -> None:
        channels = {"R": plane(0.25, kind), "G": plane(0.5, kind), "B": plane(0.75, kind), "A": plane(1, kind)}
        path = foreign(tmp_path / "a.exr", channels, spp=64, software="another renderer", anchor=(1.0, 2.0))
        found, metadata = read_estimate(path)
        np.testing.assert_array_equal(found.mean, np.broadcast_to([0.25, 0.5, 0.75], (*SHAPE, 3)))
        np.testing.assert_allclose(found.image_mean, [0.25, 0.5, 0.75, 0.25 * 0.2126 + 0.5 * 0.7152 + 0.75 * 0.0722])
        assert np.isnan(found.variance).all() and np.isnan(found.image_variance).all()
        assert (found.samples, found.batches) == (64, 1)
        assert metadata == {"spp": 64, "software": "another renderer"}

    def test_missing_channels_are_named(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match="lacks channel G, B, holds R, Z"):
            read_estimate(foreign(tmp_path / "a.exr", {"R": plane(1), "Z": plane(2)}))

    def test_truncation_anywhere_is_one_clear_line(self, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
        """The library would print to stderr and stdout; nothing may reach either."""
        path = foreign(tmp_path / "a.exr", {c: plane(1) for c in "RGB"})
        check_every_truncation(path, capfd)


def check_every_truncation(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(StoreError, match=r"^[^\n]*a\.exr: (truncated or damaged|not an OpenEXR file)[^\n]*$"):
            read_estimate(path)
    path.write_bytes(whole)
    read_estimate(path)
    assert tuple(capfd.readouterr()) == ("", "")


class TestDamage:
    """Our own files notice any change of any byte."""

    def test_truncation_anywhere_is_one_clear_line(self, tmp_path: Path, batch: Batch,
                                                   capfd: pytest.CaptureFixture[str]) -> None:
        write_batch(tmp_path / "a.exr", batch, METADATA)
        check_every_truncation(tmp_path / "a.exr", capfd)

    def test_any_flipped_bit_is_noticed(self, tmp_path: Path, batch: Batch, capfd: pytest.CaptureFixture[str]) -> None:
        """Even in pixels, which the format itself does not check."""
        path = tmp_path / "a.exr"
        write_batch(path, batch, METADATA)
        whole = path.read_bytes()
        for place in range(len(whole)):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1:])
            with pytest.raises(StoreError, match=r"a\.exr: "):
                read_batch(path)
        assert tuple(capfd.readouterr()) == ("", "")

    def test_standard_error_works_again_afterwards(self, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
        path = foreign(tmp_path / "a.exr", {c: plane(1) for c in "RGB"})
        path.write_bytes(path.read_bytes()[:-50])
        with pytest.raises(StoreError):
            read_estimate(path)
        os.write(2, b"heard\n")
        assert capfd.readouterr().err == "heard\n"

    def test_no_file_descriptor_is_left_open(self, tmp_path: Path) -> None:
        """A store is asked for thousands of files, some of them damaged."""
        path = foreign(tmp_path / "a.exr", {c: plane(1) for c in "RGB"})
        path.write_bytes(path.read_bytes()[:-50])
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(5):
            with pytest.raises(StoreError):
                read_estimate(path)
        assert len(os.listdir("/proc/self/fd")) == before

    def test_facts_of_another_version_are_refused(self, tmp_path: Path, estimate: Estimate) -> None:
        """A sealed file whose own attribute lacks what is read today."""
        write_estimate(tmp_path / "a.exr", estimate, {"harness.batch": "{}"})
        with pytest.raises(StoreError, match="written by another version"):
            read_batch(tmp_path / "a.exr")


class TestOtherFiles:
    """Files that are not EXR, or not files."""

    def test_missing_file(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match=r"nowhere\.exr: no such file"):
            read_estimate(tmp_path / "nowhere.exr")

    def test_folder(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match="cannot be read"):
            read_estimate(tmp_path)

    def test_another_format(self, tmp_path: Path) -> None:
        (tmp_path / "a.exr").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
        with pytest.raises(StoreError, match="not an OpenEXR file"):
            read_estimate(tmp_path / "a.exr")

    def test_unwritable_place(self, tmp_path: Path, batch: Batch) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(StoreError, match="cannot be written"):
            write_batch(tmp_path / "file" / "a.exr", batch)

    def test_failure_leaves_the_old_file(self, tmp_path: Path, batch: Batch, monkeypatch: pytest.MonkeyPatch) -> None:
        """Interrupted at the last moment: the old batch is whole and nothing lies beside it."""
        write_batch(tmp_path / "a.exr", batch)

        def interrupted(self: Path, data: bytes) -> int:
            with io.FileIO(self, "w") as file:
                file.write(data[:100])
            raise KeyboardInterrupt

        monkeypatch.setattr(Path, "write_bytes", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_batch(tmp_path / "a.exr", Batch(batch.mean + 1, 8))
        np.testing.assert_array_equal(read_batch(tmp_path / "a.exr").mean, batch.mean)
        assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]
