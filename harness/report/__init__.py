"""The report: stored study results set as a PDF and as one self-contained HTML page. Never renders."""

from harness.report.document import build_report
from harness.report.storage import load_study, save_study

__all__ = ["build_report", "load_study", "save_study"]
