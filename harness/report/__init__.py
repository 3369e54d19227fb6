"""The report: stored study results set as a PDF and as one self-contained HTML page. Never renders."""

from harness.report.document import build_report

__all__ = ["build_report"]
