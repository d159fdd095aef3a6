"""The report of a run: one self-contained page that opens offline in any browser."""

from skytrace.report.page import render_report

__all__ = ["render_report"]
