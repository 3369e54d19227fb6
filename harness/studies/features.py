"""A scene without one of its features, and by two strategies at equal samples: drawn for the report, and kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.files import cache_dir
from harness.results import FeatureImage
from harness.samples.keys import code_digest, digest
from harness.samples.memo import Warn, remembered
from harness.samples.pictured import load_pictured, save_pictured
from harness.samples.store import Store
from harness.scene import Scene, file_of
from harness.scene.strategies import STRATEGIES, suitable_strategies
from harness.scene.without import FEATURES
from harness.shader.library import OURS, Library
from harness.shader.samplers import EVEN
from harness.studies.memo import glsl_digest
from harness.work.batches import render_estimate
from harness.work.provenance import versions

IMAGES_FILE = "features.npz"
# Left out of a pixel: its samples are rays through its centre, all the same.
FOOTPRINT = "footprint"
# Samples per pixel that are spread evenly: noise is then no more than what an eye takes for a smooth surface.
SPP = 64
# Of strategies beside each other: so few that each shows its own noise.
EQUAL = 16
# What a ray through the centre of a pixel is in our library: file, line, and the line in its place.
_CENTRE = ("lib/path.glsl", "camera_ray((vec2(pixel) + rand2()) * pixel_size, o, d, reach);",
           "camera_ray((vec2(pixel) + 0.5) * pixel_size, o, d, reach);")


def remembered_features(scene: Scene, sides: Sequence[str], store: Store | None, *,
                        warn: Warn) -> tuple[tuple[FeatureImage, ...], bool]:
    """The scene's pictures, one a side (see `FeatureImage`), and whether they were drawn now.

    `warn` is told of damaged ones, drawn again. HarnessError for a side that is neither a feature nor a strategy.
    """
    return remembered(features_folder(scene, sides), IMAGES_FILE, load=load_features, save=save_features, warn=warn,
                      make=lambda: tuple(draw(scene, side, store) for side in sides),
                      loss="the pictures are drawn again")


def features_folder(scene: Scene, sides: Sequence[str]) -> Path:
    """Where the cache keeps those pictures, be they there or not."""
    key = {"scene": scene.content_hash, "name": scene.name, "sides": list(sides), "code": code_digest(__name__),
           "glsl": glsl_digest(), **versions()}
    return cache_dir() / "features" / digest(key, 24)


def draw(scene: Scene, side: str, store: Store | None) -> FeatureImage:
    """One picture; its samples are read back from the store where they are there. Errors as above."""
    tracer = estimator(scene, side)
    spp = EQUAL if side in STRATEGIES else SPP
    with tracer.open(file_of(scene)) as renderer:
        return FeatureImage(scene.name, side, spp, render_estimate(renderer, spp, store=store).mean)


def estimator(scene: Scene, side: str) -> Tracer:
    """The tracer that draws a side: by the strategy itself, or, without the feature, by one that looks for lights where
    there are any; its samples of all but strategies are spread evenly. Errors as above."""
    if side in STRATEGIES:
        return Tracer(side)
    if side not in (FOOTPRINT, *FEATURES):
        raise HarnessError(f"no feature '{side}' to leave out; there are {', '.join((FOOTPRINT, *FEATURES))}")
    changed = FEATURES[side](scene) if side in FEATURES else scene
    strategy = "mis" if "mis" in suitable_strategies(changed) else "mixture"
    if side == FOOTPRINT:
        return Tracer(strategy, library=_centres(), sampler=EVEN)
    return Tracer(strategy, without=(side,), sampler=EVEN)


def save_features(images: Sequence[FeatureImage], folder: str | Path) -> None:
    """Write pictures to `folder` (made if missing), as float32; StoreError where they cannot be written."""
    save_pictured(Path(folder) / IMAGES_FILE, images, "image")


def load_features(folder: str | Path) -> tuple[FeatureImage, ...]:
    """Read pictures back, rounded to float32; StoreError where the file is missing, damaged or something else."""
    held = load_pictured(Path(folder) / IMAGES_FILE, FeatureImage, "image", "remove it and draw again")
    return tuple(dataclasses.replace(each, image=each.image.astype(np.float64)) for each in held)


def _centres() -> Library:
    return OURS.with_line(*_CENTRE)
