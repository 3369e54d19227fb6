"""Images of any program: each format comes back as the radiance that was written, and damage is one line."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from harness.errors import StoreError
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.exr import write_estimate
from harness.samples.readers import pfm, read_image
from harness.samples.tone import encode_srgb

SHAPE = (5, 9)


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(3).random((*SHAPE, 3)).astype(np.float32).astype(np.float64)


def exr(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels) as file:
        file.write(str(path))
    return path


def png16(path: Path, codes: np.ndarray, kind: int) -> Path:
    """A PNG of 16 bits, which Pillow does not write in colour. `kind`: 2 RGB, 4 grey and alpha, 6 RGBA."""
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = codes.shape[:2]
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in codes)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
    return path


def rgbe(image: np.ndarray) -> np.ndarray:
    """As Radiance writes it: the bits beyond eight cut off."""
    largest = image.max(axis=-1, keepdims=True)
    mantissa, exponent = np.frexp(largest)
    return np.concatenate([np.floor(image * mantissa * 256 / largest), exponent + 128], -1).astype(np.uint8)


def hdr(path: Path, image: np.ndarray, *, encoded: bool = False, header: bytes = b"", sign: bytes = b"-") -> Path:
    height, width = image.shape[:2]
    pixels = rgbe(image)
    body = pixels.tobytes()
    if encoded:  # a run of three of the first value, then the rest as they are
        body = b"".join(bytes((2, 2, 0, width)) + b"".join(
            bytes((131, row[0, channel], width - 3)) + row[3:, channel].tobytes() for channel in range(4))
            for row in pixels)
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + header + b"\n" + sign
                     + b"Y %d +X %d\n" % (height, width) + body)
    return path


class TestExr:
    """Parts, alpha, and what is known of the samples."""

    def test_image_with_its_variance_keeps_it(self, tmp_path: Path, image: np.ndarray) -> None:
        write_estimate(tmp_path / "a.exr", merge([Batch(image, 4), Batch(image + 0.1, 4)]))
        found = read_image(tmp_path / "a.exr")
        assert found.estimate is not None
        assert (found.estimate.batches, found.spp, found.notes) == (2, 8, ())

    def test_exact_image_is_an_estimate_too(self, tmp_path: Path, image: np.ndarray) -> None:
        write_estimate(tmp_path / "a.exr", Estimate.exact(image))
        found = read_image(tmp_path / "a.exr")
        assert found.estimate is not None and found.estimate.batches == 0

    @pytest.mark.parametrize(("name", "value"), [
        ("spp", 64), ("samplesPerPixel", 64), ("cycles.ViewLayer.samples", "64")])
    def test_samples_are_known_by_what_renderers_call_them(
        self, tmp_path: Path, image: np.ndarray, name: str, value: object,
    ) -> None:
        found = read_image(exr(tmp_path / "a.exr", {"RGB": image.astype("f4")}, **{name: value}))
        assert (found.spp, found.estimate) == (64, None)

    def test_first_part_with_colours_is_taken_and_said(self, tmp_path: Path, image: np.ndarray) -> None:
        parts = [OpenEXR.Part({"name": "depth"}, {"Z": np.ones(SHAPE, "f4")}),
                 OpenEXR.Part({"name": "beauty"}, {"RGB": image.astype("f4")})]
        with OpenEXR.File(parts) as file:
            file.write(str(tmp_path / "a.exr"))
        found = read_image(tmp_path / "a.exr")
        np.testing.assert_array_equal(found.pixels, image)
        assert found.notes == ("of its 2 parts, 'beauty' is read, the first with R, G and B",)

    def test_alpha_is_said_where_it_matters(self, tmp_path: Path, image: np.ndarray) -> None:
        alpha = np.ones((*SHAPE, 1), "f4")
        opaque = exr(tmp_path / "a.exr", {"RGBA": np.concatenate([image.astype("f4"), alpha], -1)})
        assert read_image(opaque).notes == ()
        alpha[0, 0] = 0.5
        note, = read_image(exr(tmp_path / "b.exr", {"RGBA": np.concatenate([image.astype("f4"), alpha], -1)})).notes
        assert note.startswith("alpha is below 1 in 2.22% of the pixels")


class TestPfm:
    """Both byte orders, grey, a scale."""

    @pytest.mark.parametrize(("kind", "scale"), [("<f4", b"-1.0"), (">f4", b"1.000000")])
    def test_reads_both_byte_orders(self, tmp_path: Path, image: np.ndarray, kind: str, scale: bytes) -> None:
        (tmp_path / "a.pfm").write_bytes(b"PF\n9 5\n" + scale + b"\n" + image[::-1].astype(kind).tobytes())
        found = read_image(tmp_path / "a.pfm")
        np.testing.assert_array_equal(found.pixels, image)
        assert found.notes == ()

    def test_writes_what_it_reads(self, tmp_path: Path, image: np.ndarray) -> None:
        pfm.write(tmp_path / "a.pfm", image)
        np.testing.assert_array_equal(read_image(tmp_path / "a.pfm").pixels, image)

    def test_multiplies_by_the_scale_and_says_so(self, tmp_path: Path, image: np.ndarray) -> None:
        (tmp_path / "a.pfm").write_bytes(b"Pf 9 5 -2\n" + image[::-1, :, 0].astype("<f4").tobytes())
        found = read_image(tmp_path / "a.pfm")
        np.testing.assert_array_equal(found.pixels, np.repeat(2 * image[..., :1], 3, -1))
        assert found.notes == ("its pixels are multiplied by the header's scale, 2",)


class TestHdr:
    """Plain and run-length encoded, either way up."""

    @pytest.mark.parametrize("encoded", [False, True])
    def test_reads_within_its_rounding(self, tmp_path: Path, image: np.ndarray, encoded: bool) -> None:
        image[:, :3] = image[:, :1]  # runs
        found = read_image(hdr(tmp_path / "a.hdr", image, encoded=encoded)).pixels
        assert (np.abs(found - image) <= 0.5 / 128 * image.max(-1, keepdims=True)).all()

    def test_has_no_bias(self, tmp_path: Path) -> None:
        """Without the half step every value would be too dark, by 0.3 % of the largest channel in the mean."""
        image = np.random.default_rng(1).random((200, 200, 3)) + 0.1
        found = read_image(hdr(tmp_path / "a.hdr", image)).pixels
        assert found.mean() == pytest.approx(image.mean(), rel=1e-4)

    def test_rows_from_the_bottom_and_the_exposure(self, tmp_path: Path, image: np.ndarray) -> None:
        plain = read_image(hdr(tmp_path / "a.hdr", image)).pixels
        found = read_image(hdr(tmp_path / "b.hdr", image, sign=b"+", header=b"EXPOSURE=2\nEXPOSURE=4\n"))
        np.testing.assert_array_equal(found.pixels, plain[::-1] / 8)
        assert "EXPOSURE of 8" in found.notes[1]

    def test_black_is_black(self, tmp_path: Path) -> None:
        (tmp_path / "a.hdr").write_bytes(b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes(8))
        assert not read_image(tmp_path / "a.hdr").pixels.any()


class TestRaster:
    """sRGB, and what it hides."""

    def test_png_of_8_bits(self, tmp_path: Path, image: np.ndarray) -> None:
        image[0, 0] = 1.0
        Image.fromarray(np.round(255 * encode_srgb(image)).astype(np.uint8)).save(tmp_path / "a.png")
        found = read_image(tmp_path / "a.png")
        np.testing.assert_allclose(found.pixels, image, atol=0.005)
        assert found.notes[0].startswith("PNG is taken as sRGB of 8 bits: 2.22% of the pixels are clipped at white")

    @pytest.mark.parametrize(("kind", "channels"), [(2, 3), (6, 4)])
    def test_png_of_16_bits_keeps_them(self, tmp_path: Path, image: np.ndarray, kind: int, channels: int) -> None:
        codes = np.full((*SHAPE, channels), 65535.0)
        codes[..., :3] = np.round(65535 * encode_srgb(image))
        found = read_image(png16(tmp_path / "a.png", codes, kind))
        np.testing.assert_allclose(found.pixels, image, atol=2e-5)
        assert found.notes[0].startswith("PNG is taken as sRGB of 16 bits: ")

    def test_grey_of_16_bits(self, tmp_path: Path, image: np.ndarray) -> None:
        Image.fromarray(np.round(65535 * encode_srgb(image[..., 0])).astype(np.uint16)).save(tmp_path / "a.png")
        np.testing.assert_allclose(read_image(tmp_path / "a.png").pixels, np.repeat(image[..., :1], 3, -1), atol=2e-5)

    def test_transparent_pixels_are_over_black(self, tmp_path: Path) -> None:
        Image.new("RGBA", (4, 4), (255, 255, 255, 51)).save(tmp_path / "a.png")
        found = read_image(tmp_path / "a.png")
        np.testing.assert_allclose(found.pixels, 0.2)
        assert found.notes[-1] == "alpha is below 1 in 100.00% of the pixels, which are shown over black"

    def test_jpeg(self, tmp_path: Path) -> None:
        Image.new("RGB", (8, 8), (128, 128, 128)).save(tmp_path / "a.jpg", quality=95)
        found = read_image(tmp_path / "a.jpg")
        np.testing.assert_allclose(found.pixels, 0.2159, atol=0.005)
        assert "its noise is not the render's" in found.notes[1]


@pytest.mark.parametrize(("name", "content", "complaint"), [
    ("a.exr", None, "no such file; check the name, or render it first"),
    ("a.exr", b"", "an empty file; render it again"),
    ("a.exr", b"a letter", "not an image that is understood; write EXR, PFM, Radiance HDR, PNG or JPEG"),
    ("a.exr", struct.pack("<I", 20000630), "truncated or damaged EXR file"),
    ("a.pfm", b"PF\n4 4\n0\n" + bytes(192), "not a PFM file: expected 'PF', width, height, and a scale"),
    ("a.pfm", b"PF\n4 4\n-.\n" + bytes(192), "not a PFM file"),
    ("a.pfm", b"PF\n4 4\n-1\n" + bytes(191), "truncated PFM file: 192 bytes of pixels expected, 191 found"),
    ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + bytes(4), "found FORMAT=32-bit_rle_xyze"),
    ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n" + bytes(15), "truncated or damaged Radiance"),
    ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0\n\n-Y 1 +X 1\n" + bytes(4), "its EXPOSURE must be"),
    ("a.png", b"\x89PNG\r\n\x1a\nrest", "truncated or damaged image"),
    ("a.jpg", b"\xff\xd8\xff\xe0rest", "truncated or damaged image"),
])
def test_what_is_no_image_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, complaint: str,
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(StoreError) as caught:
        read_image(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("write", [
    pytest.param(lambda path, image: hdr(path, image, encoded=True), id="hdr"),
    pytest.param(lambda path, image: Image.fromarray((255 * image).astype(np.uint8)).save(path, "PNG"), id="png"),
    pytest.param(lambda path, image: png16(path, 65535 * image, 2), id="png of 16 bits"),
])
def test_a_file_cut_short_is_refused(
    tmp_path: Path, image: np.ndarray, write: Callable[[Path, np.ndarray], object],
) -> None:
    write(tmp_path / "whole", image)
    (tmp_path / "cut").write_bytes((tmp_path / "whole").read_bytes()[:-24])
    with pytest.raises(StoreError, match="truncated or damaged"):
        read_image(tmp_path / "cut")


def test_grey_with_alpha_of_16_bits_and_cmyk_are_refused(tmp_path: Path) -> None:
    png16(tmp_path / "a.png", np.zeros((4, 4, 2)), 4)
    Image.new("CMYK", (4, 4)).save(tmp_path / "a.jpg")
    for name in ("a.png", "a.jpg"):
        with pytest.raises(StoreError, match="write it as RGB"):
            read_image(tmp_path / name)
