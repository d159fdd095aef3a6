"""The reports: self-contained pages that open offline in any browser, of a run, a synchronisation and a calibration."""

from skytrace.report.calibration_page import render_calibration_report
from skytrace.report.page import render_report
from skytrace.report.sync_page import render_sync_report
from skytrace.report.truth import add_truth

__all__ = ["add_truth", "render_calibration_report", "render_report", "render_sync_report"]
