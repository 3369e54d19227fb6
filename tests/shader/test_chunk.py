"""The generated scene: literals that read back exactly, the right values for every shape, and code that compiles."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.gpu.probes import evaluate
from harness.gpu.renderer import TracerRenderer
from harness.scene import Camera, Material, Scene, Shape, load_scene
from harness.scene.strategies import STRATEGIES, parse_strategy
from harness.shader.library import OURS
from harness.shader.scene.chunk import scene_chunk
from harness.shader.scene.geometry import geometric_normal
from harness.shader.scene.materials import glossy_probability

SCENES = sorted((Path(__file__).parents[2] / "mitsuba_scenes").glob("*.xml"))
IDENTITY = tuple(map(tuple, np.eye(4)))
CAMERA = Camera(IDENTITY, 0.5, 0.5, 0.01, 1e4)
GREY = Material((0.5, 0.5, 0.5), (0, 0, 0), 1.0)


def scene_of(*shapes: Shape, environment: tuple[float, float, float] = (0.0, 0.0, 0.0), camera: Camera = CAMERA,
             name: str = "test") -> Scene:
    """A scene without a file."""
    return Scene(shapes, environment, camera, 8, 8, max_depth=4, name=name)


def described(scene: Scene) -> np.ndarray:
    """What the compiled chunk says of each shape, (shapes, 16): see glsl/probes/material.frag."""
    ids = np.zeros((len(scene.shapes), 4))
    ids[:, 3] = np.arange(len(ids))
    return evaluate("material.frag", ids, outputs=4, generated={"scene.glsl": scene_chunk(scene, "mixture")})


def expected(scene: Scene) -> np.ndarray:
    """The same from the scene itself, rounded to float32."""
    return np.float32([[*s.material.kd, s.material.alpha, *s.material.ks, glossy_probability(s.material),
                        *(s.emission or (0, 0, 0)), s.material.two_sided, *scene.environment, 0] for s in scene.shapes])


def awkward_floats(count: int) -> np.ndarray:
    """Float64 numbers over the whole range of normal float32, most of which need all its digits."""
    rng = np.random.default_rng(5)
    exponents = rng.integers(-126, 127, count)
    return np.ldexp(rng.uniform(1, 2, count), exponents)


def test_literals_read_back_as_the_same_float32() -> None:
    """From the compiled shader, bit for bit, for numbers of every magnitude."""
    numbers = awkward_floats(90).reshape(-1, 9).tolist()
    shapes = [Shape("sphere", IDENTITY, Material((a, b, c), (d, e, f), g), emission=(h, i, a))
              for a, b, c, d, e, f, g, h, i in numbers]
    scene = scene_of(*shapes, environment=tuple(awkward_floats(3).tolist()))
    np.testing.assert_array_equal(described(scene), expected(scene))


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, 1e-5, 1e20, 16777216.0, 1 / 3, 123456789.0, 3.4028234e38])
def test_literals_are_floats_in_glsl(value: float) -> None:
    """A point or an exponent in each, so none is an int; and no -0.0, which compilers fold differently."""
    line = next(line for line in scene_chunk(scene_of(environment=(value,) * 3), "cosine").splitlines()
                if line.startswith("    return vec3("))
    for literal in re.findall(r"[^(), ]+", line.strip().removeprefix("return vec3(").removesuffix(");")):
        assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?", literal) and ("." in literal or "e" in literal)
        assert literal != "-0.0"
        assert np.float32(float(literal)) == np.float32(value)


def test_literals_do_not_follow_numpys_print_options() -> None:
    scene = scene_of(environment=(1 / 3, 123456789.0, 1e-5))
    expected = scene_chunk(scene, "cosine")
    options = np.get_printoptions()
    try:
        np.set_printoptions(legacy="1.13", precision=3)
        assert scene_chunk(scene, "cosine") == expected
    finally:
        np.set_printoptions(**options)


def test_no_negative_zero_in_transforms() -> None:
    """Rotations are full of them."""
    matrix = np.array([[-0.0, 0, 1, -0.0], [0, -1, -0.0, 0], [1, -0.0, 0, 0], [0, 0, 0, 1]])
    rows = tuple(map(tuple, matrix.tolist()))
    shapes = [Shape(kind, rows, GREY, flip_normals=flip) for kind in ("sphere", "rectangle", "disk", "cube")
              for flip in (False, True)]
    chunk = scene_chunk(scene_of(*shapes, camera=dataclasses.replace(CAMERA, to_world=rows)), "cosine")
    assert not re.search(r"-0\.0\b(?!\d)", chunk)


def constant(scene: Scene) -> Scene:
    """The scene without textures and environment map, which have tests of their own."""
    def colour(value: Any) -> Any:
        return value if value is None or isinstance(value, tuple | float | int) else (0.25, 0.5, 0.125)

    shapes = []
    for shape in scene.shapes:
        m = shape.material
        alpha = m.alpha if isinstance(m.alpha, float | int) else 3.0
        material = dataclasses.replace(m, kd=colour(m.kd), ks=colour(m.ks), alpha=alpha)
        shapes.append(dataclasses.replace(shape, material=material, emission=colour(shape.emission)))
    return dataclasses.replace(scene, shapes=tuple(shapes), environment=colour(scene.environment))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_shape_gets_its_own_material_and_emission(path: Path) -> None:
    """In the scenes that the project ships, shape by shape; a colour stands for whatever varies."""
    scene = constant(load_scene(path))
    np.testing.assert_array_equal(described(scene), expected(scene))


def test_two_sided_shapes_are_told_apart() -> None:
    """Only the shapes whose material is `twosided` are."""
    both = dataclasses.replace(GREY, two_sided=True)
    scene = scene_of(*(Shape("rectangle", IDENTITY, m) for m in (GREY, both, GREY, both, both)))
    np.testing.assert_array_equal(described(scene)[:, 11], [0, 1, 0, 1, 1])


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_is_written_for_every_strategy(path: Path) -> None:
    """Suitable or not: an unsuitable strategy is warned of, never an error. (All compile: tests/test_pixels.py.)"""
    scene = load_scene(path)
    for strategy in STRATEGIES:
        source = OURS.tracer(scene, strategy)
        assert f"#define STRATEGY STRATEGY_{parse_strategy(strategy).draw.upper()}" in source.text


def test_a_scene_without_shapes_is_its_sky() -> None:
    """An empty scene is a scene."""
    for strategy in STRATEGIES:
        renderer = TracerRenderer(scene_of(environment=(0.25, 0.5, 1)), strategy)
        assert (renderer.render_batch(0, 0, 2).mean == [0.25, 0.5, 1]).all()
        renderer.release()


@pytest.mark.parametrize("name", ["ends in a backslash \\", "two\nlines", "carriage\rreturn", "*/ comment", "größe Ω"])
def test_names_cannot_change_the_program(name: str) -> None:
    """A shape's or scene's name appears in a comment: it must neither continue the line nor end the comment."""
    def code(scene: Scene) -> list[str]:
        chunk = scene_chunk(scene, "mixture").replace("\\\n", "")  # GLSL joins such lines before it drops comments
        return [line.split("//")[0].rstrip() for line in chunk.splitlines() if line.split("//")[0].strip()]

    named = scene_of(Shape("sphere", IDENTITY, GREY, name=name), Shape("disk", IDENTITY, GREY, name=name), name=name)
    plain = scene_of(Shape("sphere", IDENTITY, GREY), Shape("disk", IDENTITY, GREY))
    assert code(named) == code(plain)
    assert scene_chunk(named, "mixture").isascii()


def test_probability_of_the_lobe_is_its_share_of_the_largest_channels() -> None:
    """0 without a lobe, 1 without a diffuse term, 0 where both are black."""
    assert glossy_probability(Material((0.3, 0.1, 0), (0.1, 0, 0.2), 5)) == pytest.approx(0.4)
    assert glossy_probability(GREY) == 0
    assert glossy_probability(Material((0, 0, 0), (0, 0.2, 0), 5)) == 1
    assert glossy_probability(Material((0, 0, 0), (0, 0, 0), 5)) == 0


def test_geometric_normal_is_perpendicular_under_shear() -> None:
    """The inverse transpose, not the transformed axis: it stays at right angles to the plane's own directions."""
    matrix = np.array([[1, 0.3, 0.7, 0], [0, 2, -0.4, 0], [0.2, 0, 0.5, 0], [0, 0, 0, 1.0]])
    for flip in (False, True):
        normal = geometric_normal(Shape("rectangle", tuple(map(tuple, matrix.tolist())), GREY, flip_normals=flip))
        np.testing.assert_allclose(normal @ np.c_[matrix[:3, :2], normal], [0, 0, 1], atol=1e-12)
        assert (normal @ matrix[:3, 2] > 0) != flip


def test_rounding_of_right_angles_is_written_as_zero() -> None:
    """And nothing else: a tilt of 1e-6 stays, and so do the entries of a shape that is a billionth of a unit wide."""
    quarter, tilt = (np.eye(4) for _ in range(2))
    for turn, angle in ((quarter, np.pi / 2), (tilt, 1e-6)):
        turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    assert quarter[1, 1] != 0
    tiny = np.diag([1e-9, 1e-9, 1e-9, 1.0])
    places = (tuple(map(tuple, matrix.tolist())) for matrix in (quarter, tilt, quarter @ tiny))
    shapes = [Shape("rectangle", place, GREY) for place in places]
    turned, tilted, small = (row for row in scene_chunk(scene_of(*shapes), "cosine").splitlines()
                             if "= hit_rectangle(" in row)
    assert "vec4(0.0, 0.0, 1.0, 0.0), vec4(0.0, -1.0, 0.0, 0.0)" in turned
    assert "vec4(0.0, 1.0, 1.0e-06, 0.0), vec4(0.0, -1.0e-06, 1.0, 0.0)" in tilted
    assert "vec4(1.0e+09, 0.0, 0.0, 0.0), vec4(0.0, 0.0, 1.0e+09, 0.0), vec4(0.0, -1.0e+09, 0.0, 0.0)" in small


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_no_literal_is_what_rounding_left_of_zero(path):
    """It is not the same on every processor, and so neither were the pixels of cylinders."""
    text = scene_chunk(load_scene(path), "mixture")
    assert not re.findall(r"\d[\d.]*e-(?:1[2-9]|[2-9]\d)", text)
