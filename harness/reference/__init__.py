"""Mitsuba's side: the reference renderer, and the plugins that make its scenes mean what the tracer's mean."""

from harness.reference.renderer import ReferenceRenderer

__all__ = ["ReferenceRenderer"]
