"""The report: one self-contained HTML page that shows a result and why it is trusted or not.

Figures, tables and the page's template.  Nothing is computed here that `tune --json` would lack,
but for the correlations of the residual; figures of studies are in `scripts/studies`.
"""

from tuners.cli.report.page import render, write_report

__all__ = ["render", "write_report"]
