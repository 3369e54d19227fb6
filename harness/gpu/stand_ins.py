"""What a shader's samplers read where the picture that its author bound is not there: stand-ins, always the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from PIL import Image

from harness.errors import HarnessError
from harness.samples.readers import read_image
from harness.shader.hosts.webgl import embedded_image

# Of the random numbers in the noise picture and the volume.
SEED = 7
NOISE_SIDE, VOLUME_SIDE = 256, 32
# Files of radiance, which has no bound; others are pictures of 8 bits.
RADIANCE = (".exr", ".pfm", ".hdr", ".pic")
# Radiance of the cube map, from everywhere.
CUBE_LEVEL = 0.5


class StandIns:
    """Textures by what is read (see `shader.contract.Channel`), each made when it is first asked for."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._made: dict[tuple[str, str], Any] = {}

    def of(self, reads: str, kind: str = "sampler2D") -> Any:
        """The texture for a sampler of this `kind`. HarnessError for a file that is no picture."""
        if (reads, kind) not in self._made:
            self._made[reads, kind] = self._make(reads, kind)
        return self._made[reads, kind]

    def release(self) -> None:
        """Free the GL objects."""
        for texture in self._made.values():
            texture.release()
        self._made.clear()

    def _make(self, reads: str, kind: str) -> Any:
        rng = np.random.default_rng(SEED)
        if kind == "samplerCube":
            level = 0.0 if reads == "black" else 1.0 if reads == "white" else CUBE_LEVEL
            return self._gl.texture_cube((4, 4), 4, np.full((6, 4, 4, 4), level, np.float32).tobytes(), dtype="f4")
        if kind == "sampler3D":
            side = VOLUME_SIDE if reads == "volume" else 1
            volume = rng.integers(0, 256, (side, side, side, 4), dtype=np.uint8)
            if reads != "volume":
                volume[:] = 255 if reads == "white" else 0
            return self._gl.texture3d((side, side, side), 4, volume.tobytes())
        if reads == "keyboard":  # no key is pressed, and none was
            return self._gl.texture((256, 3), 1, bytes(768))
        if reads == "noise":
            picture = rng.integers(0, 256, (NOISE_SIDE, NOISE_SIDE, 4), dtype=np.uint8)
            return self._gl.texture((NOISE_SIDE, NOISE_SIDE), 4, picture.tobytes())
        if reads.startswith("file:"):
            return self._picture(Path(reads.removeprefix("file:")))
        return self._gl.texture((1, 1), 4, b"\xff" * 4 if reads == "white" else b"\0\0\0\xff")

    def _picture(self, path: Path) -> Any:
        """First row on top, so t grows upwards. Of 8 bits as hosts read them; radiance as it is. Of an exported page's
        images, which are named behind it, nothing is changed."""
        if path.suffix.lower().startswith((".html#", ".htm#")):
            page, _, name = str(path).rpartition("#")
            texels = embedded_image(Path(page), name)
            return self._gl.texture(texels.shape[1::-1], 4, texels.tobytes(), dtype="f4")
        if path.suffix.lower() in RADIANCE:
            texels = read_image(path).pixels[::-1]
            rgba = np.concatenate([texels, np.ones_like(texels[..., :1])], axis=2).astype(np.float32)
            return self._gl.texture(rgba.shape[1::-1], 4, rgba.tobytes(), dtype="f4")
        try:
            with Image.open(path) as image:
                pixels = image.convert("RGBA").transpose(Image.Transpose.FLIP_TOP_BOTTOM)
        except (OSError, ValueError, Image.DecompressionBombError) as error:
            raise HarnessError(f"{path}: not a picture that can be read ({' '.join(str(error).split())}); give a "
                               "PNG, JPEG, EXR, PFM or Radiance HDR file") from None
        return self._gl.texture(pixels.size, 4, pixels.tobytes())
