"""Lookups of a scene's images in hosts that give no word on filter, wrap, encoding or row order: written out as GLSL.

Our own GL binds images first row first, decoded, with the filter and the wrap of the scene file
(harness/gpu/samplers.py). Other hosts load a file as it is, last row first.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.scene.bitmaps import bitmap_texels, environment_texels
from harness.scene.importance import sampling_table, texel_density
from harness.scene.model import EnvironmentMap, Scene
from harness.shader.exports.readable import Text, item
from harness.shader.scene.bitmaps import FILTERS, images
from harness.shader.scene.environment import COMPENSATED_TABLE, SAMPLER, drawn_by
from harness.shader.scene.literals import in_comment, vector

# Image formats of floating-point numbers, which are linear; all others are encoded as sRGB.
LINEAR = (".exr", ".hdr", ".pfm", ".rgbe")
_DECODE = """// IEC 61966-2-1
vec3 decode_srgb(vec3 encoded)
{
    vec3 high = pow((encoded + 0.055) / 1.055, vec3(2.4));
    return mix(encoded / 12.92, high, greaterThan(encoded, vec3(0.04045)));
}
"""


@dataclass(frozen=True)
class Image:
    """An image of a scene: `sampler`, its uniform; `file`: its name; `encoded`: its file holds sRGB that is to be
    decoded; `repeats`: in u and in v, else the edge goes on; `nearest`: no filter; `texels`: (H, W, 3) float32, linear,
    first row first, when it is called; (H, W, 4) where the alpha is read too."""

    sampler: str
    file: str
    encoded: bool
    repeats: tuple[bool, bool]
    nearest: bool
    texels: Callable[[], np.ndarray]


@dataclass(frozen=True)
class Stored:
    """How a host has an image, in GLSL: expressions for its `size` (an ivec2), and for the linear colour of the `texel`
    at `at` (an ivec2 within `size`, row 0 the first of the file). `declared`: what must stand before."""

    size: str
    texel: str
    declared: str = ""


def images_of(scene: Scene, shader: str = "") -> list[Image]:
    """The images that a scene's shader reads, by sampler; an environment map comes last, and where the text `shader`
    draws directions from it, the table by which it does."""
    found = [Image(f"bitmap{index}", bitmap.path.name, not bitmap.raw and bitmap.path.suffix.lower() not in LINEAR,
                   (bitmap.wrap_mode == "repeat",) * 2, FILTERS[bitmap.filter_type] == "nearest",
                   lambda bitmap=bitmap: bitmap_texels(bitmap))  # type: ignore[misc]
             for index, bitmap in enumerate(images(scene.shapes))]
    environment = scene.environment
    if isinstance(environment, EnvironmentMap):
        encoded = environment.path.suffix.lower() not in LINEAR
        table = drawn_by(shader)
        if table is None:
            return [*found, Image(SAMPLER, environment.path.name, encoded, (True, False), False,
                                  lambda: environment_texels(environment))]
        density, bins = (functools.partial(made, environment, compensated=table == COMPENSATED_TABLE)
                         for made in (texel_density, sampling_table))
        found += [Image(SAMPLER, environment.path.name, encoded, (True, False), False,
                        lambda: np.dstack([environment_texels(environment), density()])),
                  Image(table, "", False, (False, False), True, bins)]
    return found


def require_files(shader: str) -> None:
    """HarnessError where a shader reads what no image file holds, for hosts that load files."""
    if drawn_by(shader):
        raise HarnessError("directions are drawn from the environment map by a table of numbers, which is no image "
                           "that this host could load; export to webgl, or take a strategy that gathers the "
                           "environment where paths escape")


def with_lookups(tracer: Text, found: Sequence[Image], stored: Callable[[int, Image], Stored]) -> tuple[str, Text]:
    """GLSL that looks images up without a sampler's filter and wrap, and the tracer that calls it.

    `stored`: how the host has an image, by its index. HarnessError as `require_files`.
    """
    require_files(tracer.written())
    if not found:
        return "", tracer
    held = [stored(index, image) for index, image in enumerate(found)]
    lookups = [_DECODE] if any("decode_srgb" in one.texel for one in held) else []
    lookups += [_lookup(image, one) for image, one in zip(found, held, strict=True)]
    samplers = {image.sampler for image in found}
    changed = [item(one.file, _calling(one.code), _calling(one.comment)) for one in tracer.items
               if not one.names & samplers and "bitmap" not in one.names]
    return "\n".join(lookups), Text(tracer.about, tuple(changed))


def loaded(image: Image, sampler: str) -> Stored:
    """The image in a host that has loaded the file as it is, last row first, into a sampler that it has declared."""
    read = f"texelFetch({sampler}, ivec2(at.x, size.y - 1 - at.y), 0).rgb"
    return Stored(f"textureSize({sampler}, 0)", f"decode_srgb({read})" if image.encoded else read)


def written(image: Image) -> Stored:
    """The image's colours in the shader's own text, a row of it a line."""
    texels = image.texels()
    height, width = texels.shape[:2]
    name = f"COLORS_OF_{image.sampler.upper()}"
    rows = ",\n".join("    " + ", ".join(vector(color) for color in row) for row in texels)
    return Stored(f"ivec2({width}, {height})", f"{name}[at.x + size.x * at.y]",
                  f"const vec3 {name}[{width * height}] = vec3[{width * height}](\n{rows});\n\n")


def _calling(code: str) -> str:
    """Code that calls the lookups by the samplers' names."""
    code = re.sub(r"\bbitmap\((bitmap\d+), ", r"look_up_\1(", code)
    code = code.replace(f"environment_texel({SAMPLER}, ", "environment_texel(").replace(
        "environment_texel(sampler2D image, ", "environment_texel(")
    return re.sub(r"textureLod\(image, (.+), 0\.0\)", rf"vec4(look_up_{SAMPLER}(\1), 1.0)", code)


def _lookup(image: Image, stored: Stored) -> str:
    name = image.sampler
    wraps = "".join(f"    at.{axis} = {_wrapped(axis, repeats)};\n"
                    for axis, repeats in zip("xy", image.repeats, strict=True))
    start = f"""// {in_comment(image.file)}: texel `at`, columns from the left, rows from the top.
{stored.declared}vec3 texel_of_{name}(ivec2 at, ivec2 size)
{{
{wraps}    return {stored.texel};
}}

vec3 look_up_{name}(vec2 at)
{{
    ivec2 size = {stored.size};
"""
    if image.nearest:
        return f"{start}    return texel_of_{name}(ivec2(floor(at * vec2(size))), size);\n}}\n"
    return f"""{start}    vec2 place = at * vec2(size) - 0.5;
    ivec2 first = ivec2(floor(place));
    vec2 part = place - floor(place);
    vec3 upper = mix(texel_of_{name}(first, size), texel_of_{name}(first + ivec2(1, 0), size), part.x);
    vec3 lower = mix(texel_of_{name}(first + ivec2(0, 1), size), texel_of_{name}(first + ivec2(1, 1), size), part.x);
    return mix(upper, lower, part.y);
}}
"""


def _wrapped(axis: str, repeats: bool) -> str:
    """A texel's index within an axis."""
    if repeats:
        return f"at.{axis} - size.{axis} * int(floor(float(at.{axis}) / float(size.{axis})))"
    return f"clamp(at.{axis}, 0, size.{axis} - 1)"
