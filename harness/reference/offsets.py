"""How far Mitsuba lifts rays off the surfaces of a scene that our tracer does not read, beside what its camera sees."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.scene.frame import OFFSET, RAYS


def offset_seen(mi: Any, scene: Any) -> float:
    """The offset at the middle of what is seen, as a part of its width; 0 where the camera sees nothing.

    Where our tracer reads a scene, `harness.scene.frame` knows, and can move it; here Mitsuba's own rays are asked, on
    the same grid over the film, and the width is what the grid's neighbours are apart.
    """
    side = (np.arange(RAYS) + 0.5) / RAYS
    x, y = (axis.ravel().tolist() for axis in np.meshgrid(side, side))
    if mi.variant().startswith("scalar"):
        met = [_meet(mi, scene, u, v) for u, v in zip(x, y, strict=True)]
        points = np.array([np.ravel(found.p) for found in met])
        valid = np.array([bool(found.is_valid()) for found in met])
    else:
        found = _meet(mi, scene, x, y)
        points, valid = np.array(found.p).T, np.array(found.is_valid())
    grid = np.where(valid[:, None], points, np.nan).reshape(RAYS, RAYS, 3)
    apart = np.concatenate([np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)])
    apart = apart[np.isfinite(apart)]
    if not len(apart):
        return 0.0
    center = np.median(points[valid], axis=0)
    return OFFSET * (1 + float(np.abs(center).max())) / max(RAYS * float(np.median(apart)), np.finfo(float).tiny)


def _meet(mi: Any, scene: Any, x: Any, y: Any) -> Any:
    """Where rays through the film meet the scene; one or many, as the variant has it."""
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))
    return scene.ray_intersect_preliminary(ray).compute_surface_interaction(ray)
