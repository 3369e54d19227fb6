"""The handout's errors as exhibits: each run in our tracer, found by a named check, its size measured."""

from harness.course.collection import measure_exhibits
from harness.course.storage import load_exhibits, save_exhibits

__all__ = ["load_exhibits", "measure_exhibits", "save_exhibits"]
