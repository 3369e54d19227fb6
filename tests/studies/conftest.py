"""The fixtures of the report's tests, for those of studies that are stored."""

from tests.report.conftest import exact, study, synthetic

__all__ = ["exact", "study", "synthetic"]
