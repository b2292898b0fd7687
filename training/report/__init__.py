"""``passloc report``: one page of a run or an evaluation, which a browser shows without a network."""

from training.report.command import report, report_page
from training.report.page import write_report

__all__ = ["report", "report_page", "write_report"]
