"""Footprints against closed forms: how much of a pixel's rays meet a light whose edge lies within it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.reference import ReferenceRenderer
from harness.scene import SceneFile
from harness.scene.footprint import BOX, Footprint

SIGMAS, SPP = 5.0, 1024
# A light that ends above the row y = 4 and left of the column x = 4, both at a quarter of pixel 3, seen head on.
EDGE = 3.25
SCENE = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="1"/></integrator>
    <sensor type="orthographic"><transform name="to_world"><scale x="4" y="4"/>
        <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
        <rfilter type="box"/></film>
    </sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="10"/><translate x="-10.75" y="10.75"/></transform>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
</scene>"""


def lit(tmp_path: Path, footprint: Footprint) -> np.ndarray:
    """The image's luminance."""
    (tmp_path / "edge.xml").write_text(SCENE, encoding="utf-8")
    renderer = ReferenceRenderer(SceneFile(tmp_path / "edge.xml"), footprint=footprint)
    return renderer.render_batch(0, 0, SPP).mean[..., 1].astype(np.float64)


@pytest.mark.parametrize(("footprint", "columns", "rows"), [
    (BOX, [1, 1, 1, 0.25, 0, 0], [1, 1, 1, 0.25, 0, 0]),
    (Footprint(1.0, right=1e-9), [1, 1, 1, 0.25, 0, 0], [1, 1, 1, 0.25, 0, 0]),
    (Footprint(0.0), [1, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0]),
    (Footprint(1.0, right=0.5, down=-0.5), [1, 1, 0.75, 0, 0, 0], [1, 1, 1, 0.75, 0, 0]),
    (Footprint(2.0), [1, 1, 0.875, 0.375, 0, 0], [1, 1, 0.875, 0.375, 0, 0]),
    # The mass of a tent about the pixel's middle left of the edge: 1 - (0.25)^2 / 2, and (0.75)^2 / 2.
    (Footprint(2.0, tent=True), [1, 1, 0.96875, 0.28125, 0, 0], [1, 1, 0.96875, 0.28125, 0, 0]),
])
def test_edges_are_met_by_as_many_rays_as_the_footprint_says(mi: Any, tmp_path: Path, footprint: Footprint,
                                                             columns: list[float], rows: list[float]) -> None:
    image = lit(tmp_path, footprint)
    along_x, along_y = np.array(columns), np.array(rows)
    for found, expected in ((image[0, :6], along_x), (image[:6, 0], along_y)):
        sigma = np.sqrt(expected * (1 - expected) / SPP)
        assert np.all(np.abs(found - expected) <= SIGMAS * sigma + 1e-6)


def test_the_store_tells_footprints_apart(mi: Any) -> None:
    scene = SceneFile.bundled("diffuse", (8, 8))
    usual, other = (ReferenceRenderer(scene, footprint=one).identity for one in (BOX, Footprint(0.0)))
    assert "footprint" not in usual
    assert other != usual


def test_an_integrator_without_single_paths_is_refused(mi: Any) -> None:
    renderer = ReferenceRenderer(SceneFile.bundled("diffuse", (8, 8)), "ptracer", footprint=Footprint(0.0))
    with pytest.raises(HarnessError, match="no single paths"):
        renderer.render_batch(0, 0, 1)


def test_one_kernel_draws_the_boxes_of_all_cameras(mi: Any) -> None:
    """A stranger's picture is held against seven footprints; to compile a kernel takes longer than to draw them."""
    import drjit

    kernels = set()
    scene = SceneFile.bundled("furnace_convex", (8, 8))
    with drjit.scoped_set_flag(drjit.JitFlag.KernelHistory, True):
        for footprint, samples in ((Footprint(1.0, right=0.5), 4), (Footprint(2.0), 4), (Footprint(0.5, down=0.25), 6)):
            drjit.kernel_history_clear()
            ReferenceRenderer(scene, footprint=footprint).render_batch(0, 0, samples)
            kernels |= {each["hash"] for each in drjit.kernel_history() if each.get("operation_count", 0) > 200}
        drjit.kernel_history_clear()
    assert len(kernels) == 1
