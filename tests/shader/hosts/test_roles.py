"""What the names of uniforms tell."""

from __future__ import annotations

import pytest

from harness.shader.hosts.roles import channel_of, role_of, snake


@pytest.mark.parametrize(("name", "words"), [
    ("u_frameCount", "frame_count"), ("uFrameCount", "frame_count"), ("FRAME_COUNT", "frame_count"),
    ("iFrame", "frame"),
    ("camera.frameNo", "frame_no"), ("HDRTexture", "hdr_texture"), ("time", "time"),
])
def test_names_are_words(name: str, words: str) -> None:
    assert snake(name).removeprefix("u_").removeprefix("i_") == words


@pytest.mark.parametrize(("kind", "name", "role"), [
    ("int", "u_frame", "frame"), ("float", "sampleIndex", "frame"), ("uint", "accumulatedFrames", "frame"),
    ("int", "frameNumber", "frame"), ("int", "u_currentSample", "frame"), ("float", "passes", "frame"),
    ("float", "u_time", "time"), ("float", "timeSinceStart", "time"), ("float", "deltaTime", "time_delta"),
    ("vec2", "u_resolution", "resolution"), ("ivec2", "screenSize", "resolution"), ("vec2", "viewport", "resolution"),
    ("float", "uAspectRatio", "aspect"), ("int", "width", "width"), ("float", "u_height", "height"),
    ("float", "textureWeight", "past_weight"), ("float", "newWeight", "new_weight"),
    ("float", "u_blend", "past_weight"),
    ("vec2", "randomSeed", "random"), ("uint", "seed", "random"), ("vec4", "u_mouse", "mouse"),
    ("vec3", "eye", None), ("float", "cameraHeight", None), ("float", "exposure", None), ("int", "maxBounces", None),
    ("mat4", "timeMatrix", None), ("vec3", "lightSize", None), ("float", "sampleRadius", None), ("bool", "seed", None),
])
def test_roles(kind: str, name: str, role: str | None) -> None:
    assert role_of(kind, name) == role


@pytest.mark.parametrize(("kind", "name", "reads"), [
    ("sampler2D", "u_previous", "self"), ("sampler2D", "accumTexture", "self"), ("sampler2D", "texture_1", "self"),
    ("sampler2D", "uTexture0", "self"), ("sampler2D", "pingpong0", "self"), ("sampler2D", "backbuffer", "self"),
    ("sampler2D", "source", "self"), ("sampler2D", "blueNoise", "noise"), ("sampler2D", "uRandomTexture", "noise"),
    ("samplerCube", "sky", "cube"), ("sampler3D", "smoke", "volume"), ("sampler2D", "albedoMap", None),
    ("sampler2D", "inBuffer0", None), ("sampler2D", "trianglesTexture", None), ("isampler2D", "previous", None),
])
def test_samplers(kind: str, name: str, reads: str | None) -> None:
    channel = channel_of(kind, name)
    assert (channel.reads if channel else None) == reads
