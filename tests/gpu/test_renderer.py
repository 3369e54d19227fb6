"""The renderer: no sample is lost, bits depend on the samples alone, and samples that are not finite are counted."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, ShaderError
from harness.gpu import context, pingpong
from harness.gpu.context import device
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest
from harness.scene import Camera, Material, Scene, Shape, load_scene
from harness.scene.strategies import DRAWS, STRATEGIES, check_strategy, suitable_strategies
from tests.support.tracer import TracerRenderer, library, tracer_source

SCENES = Path(__file__).parents[2] / "mitsuba_scenes"
IDENTITY = tuple(map(tuple, np.eye(4).tolist()))
CAMERA = Camera(IDENTITY, 0.5, 0.5, 0.01, 1e4)
WHITE = Material((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 1.0)


def sky(width: int = 8, height: int = 4) -> Scene:
    """Nothing but an environment of radiance 1, looked at along +z (+x is on the left)."""
    return Scene((), (1.0, 1.0, 1.0), CAMERA, width, height, max_depth=2)


def closed_box(max_depth: int) -> Scene:
    """A cube from inside whose white walls emit 1: every path runs to `max_depth` and gathers exactly that."""
    box = Shape("cube", IDENTITY, WHITE, emission=(1.0, 1.0, 1.0), flip_normals=True)
    return Scene((box,), (0.0, 0.0, 0.0), CAMERA, 8, 4, max_depth)


def busy(width: int = 40, height: int = 24) -> Scene:
    """The course's scene, small: several materials and bounces, so that sums are not round numbers."""
    return load_scene(SCENES / "spheres.xml", width=width, height=height)


def render(scene: Scene, strategy: str, replica: int, start: int, count: int) -> Batch:
    """One batch from a renderer of its own."""
    renderer = TracerRenderer(scene, strategy)
    try:
        return renderer.render_batch(replica, start, count)
    finally:
        renderer.release()


@pytest.mark.parametrize("max_depth", [1, 2, 8, 100, 1023, 1024])
def test_no_sample_is_lost(max_depth: int) -> None:
    """Passes as large as the renderer ever draws, every path at its full length: all samples are counted, exactly."""
    batch = render(closed_box(max_depth), "cosine", 0, 0, 128)
    assert batch.rejected == 0
    np.testing.assert_array_equal(batch.mean, np.float32(max_depth))


def test_counting_sees_lost_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that leaves loops early, without an error, drops samples, and alpha tells; ours are short enough for it.

    llvmpipe of Mesa 22 gives up after about 65,535 iterations, that of Mesa 25 does not: here the shader itself does,
    after fewer. The test above would be worth nothing if it could not see that.
    """
    limit, depth, samples = 40_000, 1024, 128
    loop = "for (int i = 0; i < {}; ++i) {{"
    impatient = library().with_line("lib/path.glsl", loop.format("samples * PATH_ITERATIONS"),
                                    loop.format(f"min(samples * PATH_ITERATIONS, {limit})"))
    scene = closed_box(depth)

    def rejected() -> int:
        renderer = TracerRenderer(scene, "cosine", impatient.tracer(scene, "cosine"))
        try:
            return renderer.render_batch(0, 0, samples).rejected
        finally:
            renderer.release()

    assert rejected() == 0
    lax = dataclasses.replace(device(), max_iterations=samples * depth)
    monkeypatch.setattr(pingpong, "device", lambda: lax)
    assert rejected() == (samples - limit // depth) * scene.width * scene.height


@pytest.mark.parametrize("strategy", ["uniform", "mixture"])
def test_bits_do_not_depend_on_bands_and_passes(monkeypatch: pytest.MonkeyPatch, strategy: str) -> None:
    """One row and one sample a draw, as on a slow device, gives the bits of the largest draws."""
    batches = []
    for first_draw, seconds in ((1, 0.0), (1 << 30, 1e9), (40 * 7 * 3, 0.25)):
        monkeypatch.setattr(pingpong, "FIRST_DRAW", first_draw)
        monkeypatch.setattr(pingpong, "DRAW_SECONDS", seconds)
        batches.append(render(busy(), strategy, 2, 5, 100))
    for batch in batches[1:]:
        np.testing.assert_array_equal(batch.mean, batches[0].mean)
        assert batch.rejected == batches[0].rejected == 0


def test_a_slow_device_gets_many_small_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two settings of the test above do differ in the number of draws, and the frame is covered by both."""
    draws = []
    original = context.Program.draw
    monkeypatch.setattr(context.Program, "draw", lambda self: (draws.append(1), original(self))[1])
    counts = []
    for first_draw, seconds in ((1, 0.0), (1 << 30, 1e9)):
        monkeypatch.setattr(pingpong, "FIRST_DRAW", first_draw)
        monkeypatch.setattr(pingpong, "DRAW_SECONDS", seconds)
        draws.clear()
        np.testing.assert_array_equal(render(sky(8, 100), "cosine", 0, 0, 64).mean, 1)
        counts.append(len(draws))
    assert counts[0] == 64 * 100 and counts[1] == 1


def test_batches_add_up() -> None:
    """Samples 0-63 and 64-127 are samples 0-127, but for the rounding of float32 sums."""
    first, second, both = (render(busy(), "mixture", 0, start, count).mean.astype(np.float64)
                           for start, count in ((0, 64), (64, 64), (0, 128)))
    np.testing.assert_allclose((first + second) / 2, both, rtol=2e-6)
    assert (first != second).mean() > 0.8  # all but the sky


def test_long_batches_are_summed_in_float64() -> None:
    """A float32 sum is flushed before it loses 1e-5 of a constant, at which it is worst; so 5000 are no worse."""
    for scale in np.linspace(0.5, 1, 9):  # where in its binade a constant lies decides how its sum is rounded
        scene = dataclasses.replace(sky(), environment=(float(scale), 0.7 * float(scale), float(scale) / 3))
        batch = render(scene, "cosine", 0, 0, 5000)
        np.testing.assert_allclose(batch.mean, np.broadcast_to(scene.environment, batch.mean.shape), rtol=1e-5)
        assert batch.samples == 5000 and batch.rejected == 0


def test_another_process_renders_the_same_bits() -> None:
    """Same inputs, same bits: what a cache of batches relies on."""
    here = hashlib.sha256(render(busy(), "lobes", 3, 10, 40).mean.tobytes()).hexdigest()
    script = (f"import hashlib\nfrom harness.scene import load_scene\n"
              f"from harness.gpu.renderer import TracerRenderer\n"
              f"scene = load_scene({str(SCENES / 'spheres.xml')!r}, width=40, height=24)\n"
              f"mean = TracerRenderer(scene, 'lobes').render_batch(3, 10, 40).mean\n"
              f"print(hashlib.sha256(mean.tobytes()).hexdigest())")
    there = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()
    assert there == here


def test_replicas_are_independent() -> None:
    """Their noise differs in nearly every pixel and is uncorrelated."""
    a, b, c, d = (render(busy(), "mixture", replica, 0, 32).mean.astype(np.float64) for replica in (0, 1, 2, 7))
    assert (a != b).mean() > 0.8  # all but the sky
    noise_ab, noise_cd = (a - b).ravel(), (c - d).ravel()
    correlation = noise_ab @ noise_cd / np.sqrt((noise_ab @ noise_ab) * (noise_cd @ noise_cd))
    assert abs(correlation) < 5 / np.sqrt(len(noise_ab) / 3)  # channels of a pixel share their paths


def test_the_image_is_the_right_way_up_and_round() -> None:
    """Row 0 is the top and column 0 the left: a light in the upper left corner of the view."""
    matrix = np.diag([0.3, 0.3, 1.0, 1.0])
    matrix[:3, 3] = (0.7, 0.7, 2.0)  # +x is on the left of Mitsuba's camera, +y up
    light = Shape("rectangle", tuple(map(tuple, matrix.tolist())), WHITE, emission=(1.0, 1.0, 1.0), flip_normals=True)
    image = render(Scene((light,), (0.0, 0.0, 0.0), CAMERA, 8, 8, max_depth=1), "cosine", 0, 0, 16).mean
    assert image[:4, :4].max() == 1 and image[4:].max() == 0 and image[:, 4:].max() == 0


@pytest.mark.parametrize("bits", ["0x7fc00000u", "0x7f800000u", "0xff800000u"], ids=["nan", "+inf", "-inf"])
def test_samples_that_are_not_finite_are_rejected_and_counted(bits: str) -> None:
    """By a shader that goes wrong on the right half of the image, and one that does so at random."""
    scene = sky()
    source = tracer_source(scene, "cosine")
    for condition in ("d.x < 0.0", "(rng_state & 0x10000u) != 0u"):
        bad = f"return {condition} ? vec3(1.0, uintBitsToFloat({bits}), 1.0) : vec3(1.0);"
        broken = dataclasses.replace(source, text=source.text.replace("return vec3(1.0, 1.0, 1.0);", bad))
        assert broken.text != source.text
        batch = TracerRenderer(scene, "cosine", broken).render_batch(0, 0, 64)
        if condition.startswith("d.x"):
            assert batch.rejected == 64 * 4 * 4
            np.testing.assert_array_equal(batch.mean, np.broadcast_to([[[1]] * 4 + [[0]] * 4], (4, 8, 3)))
        else:
            assert 0.4 < batch.rejected / (64 * 8 * 4) < 0.6
            np.testing.assert_array_equal(batch.mean, 1)  # the samples that are left have their own mean


@pytest.mark.parametrize("written", ["vec4(1.0)", "vec4(1.0, 1.0, 1.0, -1.0)", "vec4(1e30, 1.0, 1.0, 1e-30)",
                                     "sum + vec4(1.0, 1.0, 1.0, 20.0)", "vec4(0.0) / (sum.r - sum.r)"])
def test_alpha_is_believed_where_it_can_be_a_number_of_samples(written: str) -> None:
    """Of a shader that writes anything else the samples count as rejected, and the image stays finite."""
    source = tracer_source(sky(), "cosine")
    broken = dataclasses.replace(source, text=source.text.replace(
        "accumulated = trace_samples(sum, ", f"accumulated = {written} + 0.0 * trace_samples(sum, "))
    assert broken.text != source.text
    batch = TracerRenderer(sky(), "cosine", broken).render_batch(0, 0, 8)
    assert batch.rejected >= 7 * 8 * 4
    assert np.isfinite(batch.mean).all()


def stuck(monkeypatch: pytest.MonkeyPatch, *clocks: str) -> TracerRenderer:
    """A renderer that has compiled, and for which these clocks then run three seconds at every look."""
    renderer = TracerRenderer(sky(), "cosine")
    renderer.render_batch(0, 0, 1)
    seconds = iter(range(0, 1000, 3))
    for clock in clocks:
        monkeypatch.setattr(pingpong.time, clock, lambda: next(seconds))
    return renderer


def test_a_loop_without_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draws that take seconds of work for a few samples."""
    renderer = stuck(monkeypatch, "perf_counter", "process_time")
    with pytest.raises(ShaderError, match=r"^path_tracer\.frag: \d+ samples took \d\.0 s, as with a loop "):
        renderer.render_batch(1, 0, 1)


def test_a_process_that_was_stopped_is_not_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-Z in the midst of a draw: the clock goes on, the work does not."""
    assert stuck(monkeypatch, "perf_counter").render_batch(1, 0, 1).rejected == 0


def test_a_first_draw_may_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """It compiles."""
    renderer = stuck(monkeypatch, "perf_counter", "process_time")
    renderer._pingpong._compiled = False
    assert renderer.render_batch(1, 0, 1).rejected == 0


def test_a_shader_that_does_not_compile_is_refused() -> None:
    """With our file and line, before anything is drawn."""
    source = tracer_source(sky(), "cosine")
    broken = dataclasses.replace(source, text=source.text.replace("vec4 trace_samples(", "vec5 trace_samples("))
    with pytest.raises(ShaderError, match=r"^lib/path.glsl:\d+: "):
        TracerRenderer(sky(), "cosine", broken)


@pytest.mark.parametrize(("replica", "start", "count"), [(0, 0, 0), (0, 0, -1), (0, -1, 4), (-1, 0, 4),
                                                       (0, 2**32 - 3, 4), (2**32, 0, 4)])
def test_impossible_batches_are_refused(replica: int, start: int, count: int) -> None:
    """Nothing to draw, or more samples or replicas than there are seeds: those would repeat earlier ones."""
    with pytest.raises(HarnessError, match="found"):
        render(sky(), "cosine", replica, start, count)


def test_the_last_samples_there_are_can_be_drawn() -> None:
    """The largest replica and sample numbers differ from the first."""
    last = render(busy(), "cosine", 2**32 - 1, 2**32 - 8, 8)
    assert (last.mean != render(busy(), "cosine", 0, 0, 8).mean).mean() > 0.8  # all but the sky


def test_progress_is_reported_in_samples() -> None:
    """`advance` is told of every sample per pixel, once."""
    told: list[int] = []
    renderer = TracerRenderer(busy(), "cosine")
    batch = renderer.render_batch(0, 0, 1100, told.append)
    assert sum(told) == batch.samples == 1100
    assert batch.cost.seconds > 0


def test_identity_names_what_a_batch_depends_on() -> None:
    """Scene, strategy, shader and renderer: each changes it; another renderer of the same does not."""
    identity = TracerRenderer(busy(), "cosine").identity
    assert identity == TracerRenderer(busy(), "cosine").identity
    assert set(identity) == {"renderer", "scene", "strategy", "shader", "code", "gl_renderer", "gl_version",
                             "gl_vendor"}
    assert identity["code"] == code_digest("harness.gpu.renderer")
    assert identity["shader"] != TracerRenderer(busy(), "uniform").identity["shader"]
    assert identity["scene"] != TracerRenderer(busy(width=41), "cosine").identity["scene"]


def test_strategies_are_judged() -> None:
    """Unknown names are refused with the choice; lobe-only sampling suits scenes without diffuse materials only."""
    with pytest.raises(HarnessError, match=f"unknown strategy 'best'; choose from {', '.join(STRATEGIES)}"):
        check_strategy(sky(), "best")
    lobes_only = load_scene(SCENES / "furnace_phong.xml")
    assert suitable_strategies(lobes_only) == DRAWS
    assert suitable_strategies(busy()) == ("uniform", "cosine", "lobes", "mixture")
    judged = check_strategy(busy(), "phong")
    assert not judged.suits and "kd > 0" in judged.warning
    assert check_strategy(busy(), "mixture").warning == ""
