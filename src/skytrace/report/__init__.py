"""The reports: self-contained pages that open offline in any browser, of a run and of a synchronisation."""

from skytrace.report.page import render_report
from skytrace.report.sync_page import render_sync_report

__all__ = ["render_report", "render_sync_report"]
