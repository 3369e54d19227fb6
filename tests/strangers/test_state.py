"""Pixels that hold something of the author's own are found, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from harness.gpu.frames import Frames
from harness.strangers.law import find_law
from harness.strangers.state import state_pixels
from tests.strangers.test_law import CASES, SIZE, toy

CORNER = "if (p.x < 1.0 && p.y < 1.0) c = vec4(16.0, 12.0, 0.5, 7.0);"
UPDATES = {"sum": "c = vec4(o.rgb + s, o.a + 1.0);", "mean": "c = vec4(mix(o.rgb, s, 1.0 / (n + 1.0)), 1.0);",
           "count in alpha": "c = vec4((o.rgb * o.a + s) / (o.a + 1.0), o.a + 1.0);",
           "kept as roots": "c = vec4(sqrt(mix(o.rgb * o.rgb, s, 1.0 / (n + 1.0))), 1.0);"}


def found(frames: Frames) -> np.ndarray:
    return state_pixels(frames, find_law(frames).law)


@pytest.mark.parametrize("update", UPDATES.values(), ids=UPDATES)
def test_a_corner_that_keeps_state_is_found(update: str) -> None:
    mask = found(Frames(toy(f"{update} {CORNER}"), SIZE))
    assert mask[0, 0] and mask.sum() == 1


@pytest.mark.parametrize("name", [name for name in CASES if name != "clamped"])
def test_radiance_is_not_taken_for_state(name: str) -> None:
    assert not found(Frames(CASES[name][0], SIZE)).any()


def test_a_corner_without_radiance_that_counts_as_others_do_is_found() -> None:
    counted = UPDATES["count in alpha"]
    mask = found(Frames(toy(f"{counted} if (p.x < 1.0 && p.y > 11.0) c.rgb = vec3(0.0);"), SIZE))
    assert mask[-1, 0] and mask.sum() == 1


def test_a_corner_that_light_rarely_reaches_is_not_taken_for_state() -> None:
    """Where a path in three finds the lamp, a pixel that is black in all frames that are looked at is no wonder."""
    rare = ("s *= float((iFrame + int(p.x + p.y)) % 3 == 0); if (p.x < 1.0 && p.y < 1.0) s = vec3(0.0); "
            f"{UPDATES['count in alpha']}")
    assert not found(Frames(toy(rare), SIZE)).any()


def test_where_most_pixels_are_off_none_is_an_exception() -> None:
    half = "c = vec4(o.rgb + s, 1.0); if (p.x < 9.0) c = vec4(s, 1.0);"
    assert not found(Frames(toy(half), SIZE)).any()
