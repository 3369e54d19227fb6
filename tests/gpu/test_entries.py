"""The tracer's compute shader: bands, passes, errors and own files as the fragment shader has them.

That both draw the same bits of every scene by every strategy is held by tests/test_pixels.py.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from harness.errors import MachineError, ShaderError
from harness.files import data_dir
from harness.gpu import context as contexts
from harness.gpu import entries, pingpong
from harness.gpu.context import Program, device
from harness.gpu.device import ENTRY, USUAL, WIDE, Device
from harness.gpu.renderer import TracerRenderer
from harness.scene import Scene, SceneFile, load
from harness.shader.compute import COMPUTE, as_compute
from harness.shader.library import GENERATED, MAIN, OURS, Library, OwnFile
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import ShaderSource

WIDE_LLVMPIPE = {"GL_RENDERER": f"llvmpipe (LLVM 19.1.7, {WIDE} bits)", "GL_VERSION": "4.5", "GL_VENDOR": "Mesa"}


def spheres(width: int = 21, height: int = 13) -> Scene:
    return load(SceneFile.bundled("spheres", (width, height)))


def compute_of(library: Library = OURS) -> ShaderSource:
    made = as_compute(library.tracer(spheres(), "mixture"))
    assert made is not None
    return made


def drawn(source: ShaderSource | None = None) -> np.ndarray:
    """20 samples in several passes, from the middle of a replica."""
    renderer = TracerRenderer(spheres(), "mixture", source)
    try:
        return renderer.render_batch(3, 40, 20).mean
    finally:
        renderer.release()


def test_bands_and_passes_leave_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """A film that no group divides, in bands of 3 rows and passes of 4 samples."""
    monkeypatch.setenv(ENTRY, "fragment")
    whole = drawn()
    made: list[str] = []
    filled: list[tuple[int, int]] = []
    draw = entries.Groups.draw

    def noted(self: entries.Groups, bottom: int, rows: int) -> None:
        filled.append((bottom, rows))
        draw(self, bottom, rows)

    monkeypatch.setenv(ENTRY, "compute")
    monkeypatch.setattr(entries.Groups, "draw", noted)
    monkeypatch.setattr(entries, "Fragments", made.append)
    monkeypatch.setattr(pingpong, "MAX_SAMPLES_PER_PASS", 4)
    monkeypatch.setattr(pingpong, "FIRST_DRAW", 4 * 3 * 21)
    monkeypatch.setattr(pingpong, "device", lambda: dataclasses.replace(device(), least_rows=1))
    monkeypatch.setattr(pingpong, "DRAW_SECONDS", 0.0)  # so that bands stay small
    np.testing.assert_array_equal(drawn(), whole)
    assert not made and filled[0] == (0, 3) and (4, 1) in filled and len(filled) > 5 * 5


def test_the_file_is_a_shader_by_itself() -> None:
    """As it is assembled from its own includes, it is the one that is made of the fragment shader."""
    scene = spheres()
    whole = OURS.assembled(COMPUTE, {GENERATED: scene_chunk(scene, "mixture")}).text
    code = [[line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("//", "#line"))]
            for text in (whole, compute_of().text)]
    assert code[0] == code[1]


def test_it_has_the_librarys_own_files_and_errors_their_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ENTRY, "compute")
    dimmed = OURS.with_line("lib/path.glsl", "sum += vec4(radiance, 1.0);", "sum += vec4(0.5 * radiance, 1.0);")
    np.testing.assert_array_equal(drawn(dimmed.tracer(spheres(), "mixture")), 0.5 * drawn())
    text = (data_dir("glsl") / "lib" / "path.glsl").read_text(encoding="utf-8")
    text = text.replace("reach = NO_HIT;", "reach = no;")
    broken = OURS.with_files(OwnFile("lib/path.glsl", text, "mine/lib/path.glsl"))
    line = next(number for number, each in enumerate(text.splitlines(), start=1) if "reach = no;" in each)
    with pytest.raises(ShaderError, match=rf"^mine/lib/path\.glsl:{line}: .*no.* undeclared"):
        drawn(broken.tracer(spheres(), "mixture"))


def test_a_main_of_ones_own_stays_a_fragment_shader(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ENTRY, "compute")
    own = OURS.with_line(MAIN, "vec4 sum = numpass > 0 ? texelFetch(pingpong0, ivec2(pixel), 0) : vec4(0.0);",
                         "vec4 sum = numpass > 0 ? texture(pingpong0, texcoord) : vec4(0.0);")
    source = own.tracer(spheres(), "mixture")
    assert as_compute(source) is None
    np.testing.assert_array_equal(drawn(source), drawn())


def test_the_environment_chooses_between_two(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ENTRY, raising=False)
    assert entries.chosen() == device().entry == "fragment"
    monkeypatch.setenv(ENTRY, "geometry")
    with pytest.raises(MachineError, match=f"^{ENTRY}: expected fragment or compute, found 'geometry'; unset it"):
        entries.chosen()


def test_a_wide_llvmpipe_computes_and_draws_no_fragment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its key is that of the usual width, since its bits are."""
    wide = Device.of(WIDE_LLVMPIPE)
    assert (wide.entry, wide.only_computes) == ("compute", True)
    assert wide.describe()["gl_renderer"] == f"llvmpipe (LLVM 19.1.7, {USUAL} bits)"
    assert not Device.of({**WIDE_LLVMPIPE, "GL_RENDERER": "Arc 512 bits"}).only_computes
    monkeypatch.setattr(contexts, "device", lambda: wide)
    with pytest.raises(MachineError, match=r"^display\.frag: a fragment shader, and in those llvmpipe .* crashes; "):
        Program(OURS.assembled("display.frag"))


@pytest.mark.parametrize("groups", [1, 2, 3, 7, 432, 768, 1024, 16_384, 65_536, 1_048_576, 99_991])
def test_groups_are_led_through_in_an_order_that_spreads_them(groups):
    order = np.arange(groups, dtype=np.uint64) * entries.stride(groups)
    assert order.max() < 2**32  # as the shader's numbers are
    order %= groups
    assert np.array_equal(np.sort(order), np.arange(groups))
    if groups > 100:
        for threads in (2, 5, 16):  # each thread's run has its share of each tenth of the image
            for run in np.array_split(order, threads):
                shares = np.histogram(run, bins=10, range=(0, groups))[0] / len(run)
                assert shares.min() > 0.05 and shares.max() < 0.15
