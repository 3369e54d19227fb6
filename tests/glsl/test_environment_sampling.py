"""Directions drawn from an environment map in the shader, against the density of their table's definition."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from harness import checks
from harness.checks import own_environment
from harness.gpu.samplers import Samplers
from harness.scene import Scene
from harness.scene.bitmaps import environment_texels
from harness.scene.importance import mean_radiance, pdf, texel_density
from harness.scene.model import EnvironmentMap
from harness.shader.scene.environment import environment_function, sampling_functions
from tests.support.tracer import evaluate, library

FREE_UNIT = 4  # of the texture units; the probe uses those before
COUNT = 1 << 16
TURNED = '<transform name="to_world"><rotate y="1" angle="65"/><rotate x="1" angle="-20"/></transform>'
MIRRORED = '<transform name="to_world"><scale x="-1"/><rotate z="1" angle="40"/></transform>'
# Of the mean of radiance / pdf over so many points of a Sobol sequence, which know it to 7e-5.
MEAN, MEAN_COUNT = 1e-4, 1 << 20
# A pdf interpolated in float32, against float64, in parts of the largest: by rounding of values, and of directions by a
# ten-millionth of a turn, so of the place between two columns by so many times their number, and more near the poles.
VALUE, TURNS = 1e-5, 1e-7


def emitter(options: str) -> str:
    return f'<emitter type="envmap"><string name="filename" value="map.exr"/>{options}</emitter>'


def of_noise(height: int, width: int, floor: float = 0.1) -> np.ndarray:
    """(H, W, 3) float32, of which one texel in eight is bright."""
    rng = np.random.default_rng(3)
    texels = rng.uniform(floor, 1, (height, width, 3))
    texels[rng.random((height, width)) < 0.125] *= 20
    return texels.astype(np.float32)


def of_one_texel(row: int, column: int) -> np.ndarray:
    """(6, 8, 3) float32: black but for one."""
    texels = np.zeros((6, 8, 3), dtype=np.float32)
    texels[row, column] = 3, 2, 1
    return texels


def drawn(scene: Scene, numbers: np.ndarray, asked: np.ndarray, compensated: bool) -> np.ndarray:
    """(N, 8): for numbers (N, 3) a direction, its pdf, the radiance from there; the pdf of `asked` (N, 3)."""
    environment = scene.environment
    assert isinstance(environment, EnvironmentMap)
    lines = [*environment_function(environment), *sampling_functions(environment, compensated=compensated)]
    generated = {"scene.glsl": "\n".join(lines) + "\n"}
    samplers = Samplers(scene, library().probe("environment_drawn.frag", generated))
    nothing = np.zeros(len(numbers))
    try:
        return evaluate("environment_drawn.frag", np.c_[numbers, nothing], np.c_[asked, nothing], outputs=2,
                        uniforms=samplers.bind(FREE_UNIT), generated=generated).astype(np.float64)
    finally:
        samplers.release()


@functools.cache
def even(count: int) -> np.ndarray:
    """Points of the unit cube of 24 bits each."""
    return np.asarray(np.floor(qmc.Sobol(3, seed=1).random(count) * 2**24) / 2**24)


def test_the_library_keeps_its_promises() -> None:
    """χ² over the sphere and about both poles, ∫ pdf, the mean of radiance / pdf, the ends of the numbers' range."""
    for found in own_environment.findings(functools.partial(evaluate)):
        assert found.passed, found.sentence


@pytest.mark.parametrize(("texels", "options", "compensated"), [
    (of_noise(12, 16), TURNED, False), (of_noise(12, 16), TURNED, True), (of_noise(7, 5), MIRRORED, False),
    (of_noise(64, 1), '<float name="scale" value="2.5"/>', False), (of_noise(2, 9), "", False),
    (of_noise(1, 1), TURNED, True), (of_noise(20, 50).repeat(12, axis=1), "", True),
    (of_noise(20, 50).repeat(12, axis=1), "", False),
], ids=["turned", "turned, compensated", "mirrored", "one column", "two rows", "one texel, compensated",
        "more columns than bins, compensated", "more columns than bins"])
def test_directions_follow_their_pdf(mi: Any, scene: Any, tmp_path: Path, texels: np.ndarray, options: str,
                                     compensated: bool) -> None:
    """Which is that of the table's definition, in the scene's space; and radiance / pdf has the right mean."""
    mi.Bitmap(texels).write(str(tmp_path / "map.exr"))
    loaded = scene(emitter(options))
    environment = loaded.environment

    def expected(d: np.ndarray) -> np.ndarray:
        return pdf(environment, d, compensated=compensated)

    asked = np.random.default_rng(2).normal(size=(COUNT, 3))
    asked = (asked / np.linalg.norm(asked, axis=1, keepdims=True)).astype(np.float32)
    found = drawn(loaded, np.random.default_rng(1).random((COUNT, 3), dtype=np.float32), asked, compensated)
    pole = tuple(float(part) for part in np.array(environment.to_world)[:3, 1])
    largest = texel_density(environment, compensated=compensated).max()
    for at, value in ((asked, found[:, 7]), (found[:, :3], found[:, 3])):
        from_axis = np.linalg.norm(np.cross(at, pole), axis=1)
        tolerance = VALUE + TURNS * texels.shape[1] / np.maximum(from_axis, TURNS)
        assert (np.abs(value - expected(at)) < tolerance * largest).all()
    # As many steps as hit every piece of the density's support.
    judged = checks.chi2(lambda _: found[:, :3], expected, checks.Sphere(pole), count=COUNT, cells=(21, 11), steps=30)
    assert judged.passed, judged.sentence
    if not compensated:
        found = drawn(loaded, even(MEAN_COUNT), np.tile(pole, (MEAN_COUNT, 1)), compensated)
        mean = (found[:, 4:7] / found[:, 3:4]).mean(axis=0) / (4 * np.pi)
        np.testing.assert_allclose(mean, mean_radiance(environment), rtol=MEAN)


@pytest.mark.parametrize(("row", "column"), [(0, 3), (5, 3), (2, 0), (3, 7), (1, 4)],
                         ids=["first pole", "last pole", "seam", "seam's other side", "inside"])
def test_one_bright_texel_is_all_that_is_drawn(mi: Any, scene: Any, tmp_path: Path, row: int, column: int) -> None:
    """Its tent reaches to the centres of its neighbours, across the seam as anywhere; radiance / pdf is constant."""
    mi.Bitmap(of_one_texel(row, column)).write(str(tmp_path / "map.exr"))
    loaded = scene(emitter(TURNED))
    numbers = np.concatenate([even(1 << 12), np.eye(3), np.zeros((1, 3)), np.full((1, 3), 1 - 2.0**-24)])
    numbers = np.minimum(numbers, 1 - 2.0**-24)
    found = drawn(loaded, numbers, np.tile([0, 0, 1.0], (len(numbers), 1)), False)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1, atol=1e-6)
    local = found[:, :3] @ np.array(loaded.environment.to_world)[:3, :3]
    turn = np.arctan2(local[:, 0], -local[:, 2]) / (2 * np.pi) * 8 - 0.5 - column
    around = np.abs((turn + 4) % 8 - 4)
    down = np.abs(np.arctan2(np.hypot(local[:, 0], local[:, 2]), local[:, 1]) / np.pi * 5 - row)
    off_poles = np.hypot(local[:, 0], local[:, 2]) > 1e-3  # on them there is no azimuth
    assert around[off_poles].max() < 1 + 1e-5 and down.max() < 1 + 1e-5
    assert around.max() > 0.9 and down.max() > 0.9
    # Where the tent ends, both are zero but for rounding.
    inside = found[:, 3] > 0.01 * texel_density(loaded.environment).max()
    assert inside.mean() > 0.98
    ratio = found[inside, 4:7] / found[inside, 3:4] / (4 * np.pi)
    np.testing.assert_allclose(ratio, np.tile(mean_radiance(loaded.environment), (len(ratio), 1)), rtol=1e-5)


def test_where_there_is_light_there_is_a_pdf(mi: Any, scene: Any, tmp_path: Path) -> None:
    """And where there is none there is none: their supports are the same, as bilinear lookups of the same texels."""
    texels = of_noise(9, 12)
    texels[np.random.default_rng(8).random((9, 12)) < 0.6] = 0
    mi.Bitmap(texels).write(str(tmp_path / "map.exr"))
    loaded = scene(emitter(""))
    found = drawn(loaded, even(COUNT), np.tile([0, 0, 1.0], (COUNT, 1)), False)
    assert (found[:, 3] > 0).all() and (found[:, 4:7] > 0).all()
    assert ((texel_density(loaded.environment) > 0) == (environment_texels(loaded.environment).max(axis=2) > 0)).all()
