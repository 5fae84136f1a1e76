"""The calibration report: on the terminal as rich tables, and as one self-contained HTML page.

Both take the rig file's content and say the same: the verdict, what to do next, then the evidence. They measure nothing
themselves; every figure was judged when the rig was calibrated.
"""

from rigcal.report.html import html_report
from rigcal.report.lens import lens_report
from rigcal.report.text import text_report

__all__ = ["html_report", "lens_report", "text_report"]
