"""Convergence studies: several strategies on one scene against one reference, as curves, verdicts and costs."""

from harness.shader.samplers import EVEN
from harness.studies.plan import PROFILES, Profile, exhibited_strategies, judged

__all__ = ["EVEN", "PROFILES", "Profile", "exhibited_strategies", "judged"]
