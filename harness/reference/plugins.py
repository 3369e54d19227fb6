"""Makes the harness's own Mitsuba plugins known to Mitsuba, in whichever variant is current."""

from __future__ import annotations

from typing import Any

from harness.machine.mitsuba_runtime import import_mitsuba
from harness.reference import lights, phong, procedural, same_algorithm
from harness.scene.procedural import KINDS

_registered: set[str] = set()
_watching = False


def register_plugins() -> None:
    """Register `phong` and `bsdf_path` in Mitsuba's current variant, if one is set, and in each that is set later."""
    global _watching
    mi = import_mitsuba()
    if not _watching:
        _watching = True
        mi.detail.add_variant_callback(lambda before, now: _register_in(mi, now))
    if mi.variant() is not None:
        _register_in(mi, mi.variant())


def _register_in(mi: Any, variant: str) -> None:
    """Once per variant: a plugin's base class, and so the plugin's, exists once in each."""
    if variant not in _registered:
        _registered.add(variant)
        mi.register_bsdf("phong", phong.plugin_class(mi))
        for kind in KINDS:
            mi.register_texture(kind, procedural.plugin_class(mi))
        mi.register_texture(lights.PLUGIN, lights.plugin_class(mi))
        mi.register_integrator("bsdf_path", same_algorithm.plugin_class(mi))
