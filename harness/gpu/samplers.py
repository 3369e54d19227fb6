"""The images that a scene's shader reads: GL textures, and which texture unit each is bound to."""

from __future__ import annotations

import moderngl
import numpy as np

from harness.errors import HarnessError
from harness.gpu.context import context
from harness.scene.bitmaps import bitmap_texels, environment_texels
from harness.scene.importance import sampling_table, texel_density
from harness.scene.model import EnvironmentMap, Scene
from harness.shader.scene.bitmaps import images
from harness.shader.scene.environment import COMPENSATED_TABLE, SAMPLER, drawn_by
from harness.shader.scene.layers import DEFINE, Layers, layers, texels
from harness.shader.scene.layers import SAMPLER as LAYERS
from harness.shader.source import ShaderSource


class Samplers:
    """The textures of one scene, by the name of their uniform; bound anew for each draw, so that many scenes coexist.

    RGBA, since llvmpipe reads it a third faster than RGB, and float32, since it filters 8-bit formats in 8 bits.
    """

    def __init__(self, scene: Scene, source: ShaderSource | None = None) -> None:
        """Read and upload the files. Raises SceneError where they changed, HarnessError where they do not fit GL.

        `source`: the shader that reads them; where it draws directions from the environment map, it gets the table for
        that too, and the map's alpha is the pdf.
        """
        self._textures: dict[str, moderngl.Texture | moderngl.TextureArray] = {}
        gl = context()
        units = int(gl.info["GL_MAX_TEXTURE_IMAGE_UNITS"]) - 1  # one is the renderer's own
        bitmaps = images(scene.shapes)
        environment = scene.environment if isinstance(scene.environment, EnvironmentMap) else None
        table = drawn_by(source.text) if environment is not None and source is not None else None
        if len(bitmaps) + (environment is not None) + (table is not None) > units:
            raise HarnessError(f"scene '{scene.name}' has {len(bitmaps)} bitmaps; this device reads {units} images at "
                               "most in one shader, the environment map and the table by which directions are drawn "
                               "from it among them")
        ahead = source is not None and f"#define {DEFINE} 1\n" in source.text
        try:
            if ahead and (found := layers(scene.shapes)) is not None:
                self._layers(found)
                bitmaps = []
            for index, bitmap in enumerate(bitmaps):
                texture = self._upload(f"bitmap{index}", bitmap.path.name, bitmap_texels(bitmap))
                mode = moderngl.NEAREST if bitmap.filter_type == "nearest" else moderngl.LINEAR
                texture.filter = (mode, mode)
                texture.repeat_x = texture.repeat_y = bitmap.wrap_mode == "repeat"
            if environment is not None:
                compensated = table == COMPENSATED_TABLE
                alpha = texel_density(environment, compensated=compensated) if table else 1.0
                texture = self._upload(SAMPLER, environment.path.name, environment_texels(environment), alpha)
                texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
                texture.repeat_x, texture.repeat_y = True, False
                if table:
                    bins = sampling_table(environment, compensated=compensated)
                    texture = self._upload(table, environment.path.name, bins[..., :3], bins[..., 3])
                    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        except BaseException:
            self.release()
            raise

    def _layers(self, found: Layers) -> None:
        rgba = np.ones((len(found.images), *found.size[::-1], 4), dtype=np.float32)
        rgba[..., :3] = texels(found)
        texture = context().texture_array((*found.size, len(found.images)), 4, rgba.data, dtype="f4")
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = True
        self._textures[LAYERS] = texture

    def bind(self, first_unit: int) -> dict[str, int]:
        """Bind each texture to a unit from `first_unit` on; the uniforms' values."""
        for unit, texture in enumerate(self._textures.values(), start=first_unit):
            texture.use(unit)
        return {name: unit for unit, name in enumerate(self._textures, start=first_unit)}

    def release(self) -> None:
        """Free the GL objects."""
        for texture in self._textures.values():
            texture.release()

    def _upload(self, name: str, file: str, texels: np.ndarray, alpha: np.ndarray | float = 1.0) -> moderngl.Texture:
        gl = context()
        height, width = texels.shape[:2]
        largest = int(gl.info["GL_MAX_TEXTURE_SIZE"])
        if max(width, height) > largest:
            raise HarnessError(f"'{file}' has {width} x {height} texels; this device takes {largest} a side at most, "
                               "scale it down")
        rgba = np.empty((height, width, 4), dtype=np.float32)
        rgba[..., :3], rgba[..., 3] = texels, alpha
        texture = gl.texture((width, height), 4, rgba.data, dtype="f4")
        self._textures[name] = texture
        return texture
