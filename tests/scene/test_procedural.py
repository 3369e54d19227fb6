"""Marble, wood and fractal: their formulas, the bound on their steepness, and what the loader reads and refuses."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.errors import SceneError
from harness.scene import load_scene
from harness.scene.model import Procedural
from harness.scene.noise import NUMPY, Triple, fbm
from harness.scene.procedural import KINDS, evaluate, ramp, wave

BODY_LINE = 5  # of the files that the fixture `write` makes
IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
TEXTURE = Procedural("fractal", ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 3, 2.0, 0.5, 2.0, 1.5, 7, IDENTITY)


def textured(kind: str, inner: str = "") -> str:
    """A sphere whose albedo is a texture."""
    return f'<shape type="sphere"><bsdf type="diffuse"><texture type="{kind}" name="reflectance">{inner}</texture>' \
           "</bsdf></shape>"


def load(write: Callable[..., Path], kind: str, inner: str = "") -> Procedural:
    """The texture as the loader reads it."""
    found = load_scene(write(textured(kind, inner))).shapes[0].material.kd
    assert isinstance(found, Procedural)
    return found


def points(count: int = 2000) -> Triple:
    """Random points of texture space."""
    x, y, z = np.random.default_rng(8).uniform(-2, 2, (3, count))
    return x, y, z


def integer(name: str, value: int) -> str:
    return f'<integer name="{name}" value="{value}"/>'


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


class TestFormula:
    """t as a function of the point."""

    def test_fractal_is_the_noise(self) -> None:
        p = points()
        t, _ = evaluate(NUMPY, TEXTURE, p)
        np.testing.assert_array_equal(t, fbm(NUMPY, (2 * p[0], 2 * p[1], 2 * p[2]), 3, 2.0, 0.5, 7)[0])

    def test_marble_without_distortion_has_flat_veins(self) -> None:
        """It then depends on x alone, with the period 1 / frequency."""
        marble = dataclasses.replace(TEXTURE, kind="marble", distortion=0.0)
        x, y, z = points()
        t, _ = evaluate(NUMPY, marble, (x, y, z))
        np.testing.assert_allclose(evaluate(NUMPY, marble, (x + 0.5, 2 * z, y))[0], t, atol=1e-12)
        assert np.abs(t - (0.5 - 0.5 * np.cos(2 * np.pi * 2 * x))).max() < 0.011

    def test_wood_without_distortion_has_round_rings(self) -> None:
        """It then depends on the distance from the z axis alone; a ring darkens slowly and ends at once."""
        wood = dataclasses.replace(TEXTURE, kind="wood", distortion=0.0, frequency=1.0)
        x, y, z = points()
        t, _ = evaluate(NUMPY, wood, (x, y, z))
        np.testing.assert_allclose(evaluate(NUMPY, wood, (np.hypot(x, y), 0 * y, -z))[0], t, atol=1e-12)
        radius = np.array([0.0, 0.375, 0.75, 0.875, 1.0, 1.75])
        across, _ = evaluate(NUMPY, wood, (radius, 0 * radius, radius))
        np.testing.assert_allclose(across, [0, 0.5, 1, 0.5, 0, 1], atol=1e-12)

    @pytest.mark.parametrize("kind", KINDS)
    def test_values_fill_the_ramp(self, kind: str) -> None:
        """Within [0, 1], and beyond the middle half of it on both sides."""
        t, _ = evaluate(NUMPY, dataclasses.replace(TEXTURE, kind=kind), points(20_000))
        assert 0 <= t.min() < 0.25 and 0.75 < t.max() <= 1

    @pytest.mark.parametrize("kind", KINDS)
    def test_gradient_is_the_slope(self, kind: str) -> None:
        """Against central differences; a displaced sphere takes its normals from it."""
        texture, p, step = dataclasses.replace(TEXTURE, kind=kind), points(), 1e-6
        _, gradient = evaluate(NUMPY, texture, p)
        for axis in range(3):
            ahead, behind = list(p), list(p)
            ahead[axis], behind[axis] = p[axis] + step, p[axis] - step
            slope = (evaluate(NUMPY, texture, (ahead[0], ahead[1], ahead[2]))[0]
                     - evaluate(NUMPY, texture, (behind[0], behind[1], behind[2]))[0]) / (2 * step)
            # Where a wave turns, its curvature jumps: the difference is then off by the step times that.
            np.testing.assert_allclose(gradient[axis], slope, atol=1e-2 if kind == "wood" else 1e-3)
            assert np.median(np.abs(gradient[axis] - slope)) < 1e-7

    def test_wood_has_a_slope_on_its_axis(self) -> None:
        """Where the distance has none: a finite one, since one NaN would spread."""
        at = np.zeros(3)
        t, gradient = evaluate(NUMPY, dataclasses.replace(TEXTURE, kind="wood"), (at, at, np.arange(3.0)))
        assert np.isfinite([t, *gradient]).all()


@pytest.mark.parametrize("rise", sorted({kind.rise for kind in KINDS.values()}))
def test_waves_are_smooth(rise: float) -> None:
    """Value and slope run on through crests, troughs and the border of the period."""
    s = np.linspace(-2, 2, 400_001)
    value, slope = wave(NUMPY, s, rise)
    step = s[1] - s[0]
    assert value.min() == pytest.approx(0, abs=1e-9) and value.max() == pytest.approx(1, abs=1e-9)
    assert np.abs(np.diff(value)).max() < 1.51 / min(rise, 1 - rise) * step
    assert np.abs(np.diff(slope)).max() < 6.1 / min(rise, 1 - rise)**2 * step
    np.testing.assert_allclose(slope[1:-1], (value[2:] - value[:-2]) / (2 * step), atol=1e-2)


def test_ramps_pass_through_their_colours_at_equal_steps() -> None:
    stops = (0.2, 1.0, 0.0, 0.4)
    t = np.linspace(0, 1, 301)
    value, slope = ramp(NUMPY, t, stops)
    np.testing.assert_allclose(value, np.interp(t * 3, np.arange(4), stops), atol=1e-12)
    inside = np.abs(t * 3 - np.round(t * 3)) > 1e-6
    np.testing.assert_allclose(slope[inside], np.gradient(value, t)[inside], atol=1e-9)


class TestLoader:
    """The three plugins in a scene file."""

    @pytest.mark.parametrize("kind", KINDS)
    def test_reads_every_parameter(self, write: Callable[..., Path], kind: str) -> None:
        texture = load(write, kind, '<rgb name="color0" value="0.1, 0.2, 0.3"/>' + number("color1", 0.5)
                       + '<rgb name="color2" value="1, 0, 0"/>' + integer("octaves", 6) + number("lacunarity", 1.9)
                       + number("gain", 0.6) + number("frequency", 3) + integer("seed", 2**32 - 1)
                       + (number("distortion", -2) if kind != "fractal" else "")
                       + '<transform name="to_texture"><scale x="2"/><translate z="1"/></transform>')
        assert texture.kind == kind
        assert texture.colors == ((0.1, 0.2, 0.3), (0.5, 0.5, 0.5), (1.0, 0.0, 0.0))
        assert (texture.octaves, texture.seed, texture.distortion) == (6, 2**32 - 1, 0.0 if kind == "fractal" else -2.0)
        np.testing.assert_allclose([texture.lacunarity, texture.gain, texture.frequency], [1.9, 0.6, 3])
        np.testing.assert_array_equal(texture.to_texture, [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]])

    def test_defaults_show_the_noise_itself(self, write: Callable[..., Path]) -> None:
        texture = load(write, "fractal")
        assert texture == Procedural("fractal", ((0.0,) * 3, (1.0,) * 3), 4, 2.0, 0.5, 4.0, 0.0, 0, IDENTITY)

    def test_any_parameter_of_a_material_and_a_light_may_be_textured(self, write: Callable[..., Path]) -> None:
        shape = load_scene(write(
            '<shape type="sphere"><bsdf type="phong"><texture type="wood" name="kd"/><texture type="marble" name="ks"/>'
            '<texture type="fractal" name="alpha"/></bsdf>'
            '<emitter type="area"><texture type="marble" name="radiance"/></emitter></shape>')).shapes[0]
        slots = (shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission)
        kinds = [texture.kind for texture in slots if isinstance(texture, Procedural)]
        assert kinds == ["wood", "marble", "fractal", "marble"]

    @pytest.mark.parametrize(("kind", "inner", "message"), [
        ("fractal", integer("octaves", 0), "'octaves' must be between 1 and 16, found 0"),
        ("fractal", integer("octaves", 17), "'octaves' must be between 1 and 16, found 17"),
        ("fractal", number("octaves", 2.5), "'octaves' must be an integer, found 2.5"),
        ("marble", number("lacunarity", 0), "'lacunarity' must be positive, found 0"),
        ("marble", number("frequency", -1), "'frequency' must be positive, found -1"),
        ("marble", number("gain", 0), "'gain' must lie above 0 and at most at 1, found 0"),
        ("marble", number("gain", 1.5), "'gain' must lie above 0 and at most at 1, found 1.5"),
        ("marble", '<string name="distortion" value="much"/>', "'distortion' must be a number, found 'much'"),
        ("wood", integer("seed", -1), "'seed' must be between 0 and 4294967295, found -1"),
        ("wood", integer("seed", 2**32), "'seed' must be between 0 and 4294967295, found 4294967296"),
        ("wood", number("distortion", float("nan")), "'distortion' must be finite"),
        ("wood", '<rgb name="color1" value="-1, 0, 0"/>', "'color1' must be finite and not negative"),
        ("fractal", number("distortion", 1), "property 'distortion' of texture 'fractal' is not supported"),
        ("fractal", number("color3", 1), "'color3' is given but 'color2' is not; number the colours without a gap"),
        ("fractal", number("color8", 1), "property 'color8' of texture 'fractal' is not supported; supported: color0"),
        ("fractal", number("color1", 2), "diffuse albedo must not exceed 1, found 2"),
        ("fractal", '<spectrum name="color1" value="0.5"/>', "'color1' is a spectrum; give it as <rgb> or <float>"),
        ("fractal", '<texture type="fractal" name="color1"/>', "texture 'fractal' is not supported"),
        ("fractal", number("frequency", 1e4) + integer("octaves", 16), "the noise reaches 3.28e+08 cells"),
        ("fractal", number("lacunarity", 1e38) + integer("octaves", 16), "the noise reaches inf cells from"),
        ("fractal", '<transform name="to_texture"><translate x="1e7"/></transform>', "the noise reaches 3.2e+08 cells"),
        ("fractal", '<transform name="to_texture"><scale x="0"/></transform>', "'to_texture' is degenerate"),
    ])
    def test_refuses_in_one_line(self, write: Callable[..., Path], kind: str, inner: str, message: str) -> None:
        """With the file and the line of the texture."""
        path = write(textured(kind, inner))
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        assert str(caught.value).startswith(f"{path}:{BODY_LINE}: ") and message in str(caught.value)
        assert "\n" not in str(caught.value)
