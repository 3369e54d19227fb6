"""A folder of submissions graded: each judged alone, a table of all, and a page of evidence for each."""

from harness.grading.records import HINTS, Graded, Hints, Part

__all__ = ["HINTS", "Graded", "Hints", "Part"]
