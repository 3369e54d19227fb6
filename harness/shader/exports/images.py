"""Lookups of a scene's images in hosts that give no word on filter, wrap, encoding or row order: written out as GLSL.

Our own GL binds images first row first, decoded, with the filter and the wrap of the scene file
(harness/gpu/samplers.py). Other hosts load a file as it is, last row first.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.scene.bitmaps import bitmap_texels, environment_texels
from harness.scene.model import EnvironmentMap, Scene
from harness.shader.exports.readable import Text, item
from harness.shader.scene.bitmaps import FILTERS, images
from harness.shader.scene.environment import SAMPLER
from harness.shader.scene.literals import in_comment

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
    first row first, when it is called."""

    sampler: str
    file: str
    encoded: bool
    repeats: tuple[bool, bool]
    nearest: bool
    texels: Callable[[], np.ndarray]


def images_of(scene: Scene) -> list[Image]:
    """The images that a scene's shader reads, by sampler; an environment map comes last."""
    found = [Image(f"bitmap{index}", bitmap.path.name, not bitmap.raw and bitmap.path.suffix.lower() not in LINEAR,
                   (bitmap.wrap_mode == "repeat",) * 2, FILTERS[bitmap.filter_type] == "nearest",
                   lambda bitmap=bitmap: bitmap_texels(bitmap))  # type: ignore[misc]
             for index, bitmap in enumerate(images(scene.shapes))]
    environment = scene.environment
    if isinstance(environment, EnvironmentMap):
        found.append(Image(SAMPLER, environment.path.name, environment.path.suffix.lower() not in LINEAR,
                           (True, False), False, lambda: environment_texels(environment)))
    return found


def with_lookups(tracer: Text, found: Sequence[Image], texel: Callable[[Image], Sequence[str]]) -> tuple[str, Text]:
    """GLSL that looks images up without their sampler's filter and wrap, and the tracer that calls it.

    `texel`: statements that return the linear colour of texel `at` (an ivec2 within the image of `size`; row 0 is the
    first of the file).
    """
    if not found:
        return "", tracer
    lookups = [_DECODE] if any(image.encoded for image in found) else []
    for image in found:
        lookups += [_lookup(image, texel(image))]
    samplers = {image.sampler for image in found}
    changed = [item(one.file, _calling(one.code), _calling(one.comment)) for one in tracer.items
               if not one.names & samplers and "bitmap" not in one.names]
    return "\n".join(lookups), Text(tracer.about, tuple(changed))


def fetch(image: Image) -> list[str]:
    """Statements for `with_lookups` in a host that has loaded the file as it is, last row first."""
    read = f"texelFetch({image.sampler}, ivec2(at.x, size.y - 1 - at.y), 0).rgb"
    return [f"return {f'decode_srgb({read})' if image.encoded else read};"]


def _calling(code: str) -> str:
    """Code that calls the lookups by the samplers' names."""
    code = re.sub(r"\bbitmap\((bitmap\d+), ", r"look_up_\1(", code)
    code = code.replace(f"environment_texel({SAMPLER}, ", "environment_texel(").replace(
        "environment_texel(sampler2D image, ", "environment_texel(")
    return re.sub(r"textureLod\(image, (.+), 0\.0\)\.rgb", rf"look_up_{SAMPLER}(\1)", code)


def _lookup(image: Image, texel: Sequence[str]) -> str:
    wraps = "".join(
        f"    at.{axis} = {f'at.{axis} - size.{axis} * int(floor(float(at.{axis}) / float(size.{axis})))' if repeats else f'clamp(at.{axis}, 0, size.{axis} - 1)'};\n"
        for axis, repeats in zip("xy", image.repeats, strict=True))
    body = "".join(f"    {line}\n" for line in texel)
    name = image.sampler
    start = f"""// {in_comment(image.file)}: texel `at`, columns from the left, rows from the top.
vec3 texel_of_{name}(ivec2 at, ivec2 size)
{{
{wraps}{body}}}

vec3 look_up_{name}(vec2 at)
{{
    ivec2 size = textureSize({name}, 0);
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
