"""One self-contained HTML page about a result: why to trust it, or why not."""

from tuners.cli.report.page import render, write_report

__all__ = ["render", "write_report"]
