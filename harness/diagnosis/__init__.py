"""Autopsies: the stages of a path, compared vertex by vertex; the first that differs names a function and a line."""

from harness.diagnosis.autopsy import SAMPLES, autopsy
from harness.diagnosis.record import AutopsyRecord

__all__ = ["SAMPLES", "AutopsyRecord", "autopsy"]
