"""A scene as rays see it that do not fill their pixels' squares: the same paths, from other places of the film."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.scene.footprint import Footprint


def render(mi: Any, scene: Any, integrator: Any, footprint: Footprint, seed: int, spp: int) -> np.ndarray:
    """Mitsuba's image, (H, W, 3) float32, each pixel the mean of `spp` rays spread as the footprint says.

    HarnessError for an integrator that draws whole images and no single paths.
    """
    import drjit as dr

    sensor = scene.sensors()[0]
    width, height = (int(side) for side in sensor.film().crop_size())
    if not isinstance(integrator, mi.SamplingIntegrator):
        raise HarnessError(f"integrator {integrator.class_name()} draws no single paths, so no ray can be moved "
                           "within its pixel; choose path or bsdf_path")
    sampler = sensor.sampler().clone()
    count = width * height * spp
    sampler.seed(seed, count)
    pixel = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, spp)
    place = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width)) + _within(sampler, footprint)
    time = sensor.shutter_open() + sampler.next_1d() * sensor.shutter_open_time()
    rays, weight = sensor.sample_ray_differential(time, sampler.next_1d(), place / mi.Point2f(width, height),
                                                  sampler.next_2d())
    light, _, _ = integrator.sample(scene, sampler, rays)
    light = weight * light
    dr.eval(light)  # once, and not for each channel
    parts = [np.array(dr.block_sum(channel, spp)).reshape(height, width) / spp for channel in light]
    return np.stack(parts, -1).astype(np.float32)


def _within(sampler: Any, footprint: Footprint) -> Any:
    """Where a ray goes, from its pixel's upper left corner, in pixels."""
    import drjit as dr

    spread = sampler.next_2d()
    if footprint.tent:
        spread = 0.5 * (spread + sampler.next_2d())
    # No part of the kernel, which takes as long to compile as a small picture to draw: one does for all boxes.
    width, *middle = (dr.opaque(type(spread.x), number)
                      for number in (footprint.width, 0.5 + footprint.right, 0.5 + footprint.down))
    return width * (spread - 0.5) + type(spread)(*middle)
