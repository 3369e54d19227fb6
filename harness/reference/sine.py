"""The sine as Mitsuba's compiler computes it: what a hash built on it gets there."""

from __future__ import annotations

import numpy as np

from harness.machine.mitsuba_runtime import use_reference_variant


def sine(angles: np.ndarray) -> np.ndarray:
    """sin of angles (N,), in radians and rounded to float32, by drjit in the reference's variant; (N,) float32."""
    mi = use_reference_variant()
    import drjit as dr

    return np.array(dr.sin(mi.Float(np.asarray(angles, dtype=np.float32))))
