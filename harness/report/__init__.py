"""The report: stored study results set as a PDF and as one self-contained HTML page. Never renders.

Inputs become chapters (`chapters/`), chapters are made of blocks (`blocks.py`), and pages (`pages/`) set blocks.
"""

from harness.report.document import build_report
from harness.report.inputs import Inputs

__all__ = ["Inputs", "build_report"]
