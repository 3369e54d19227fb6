"""Procedural textures for Mitsuba 3."""

from __future__ import annotations

from typing import Any

from harness.scene.noise import Arithmetic


def arithmetic(mi: Any) -> Arithmetic:
    """How `harness.scene.noise` computes with drjit's arrays of Mitsuba's current variant."""
    import drjit as dr

    # By way of Int32: a negative float has no unsigned counterpart.
    return Arithmetic(dr.floor, lambda x: mi.UInt32(mi.Int32(x)), lambda x: mi.Float(mi.Int32(x)))
