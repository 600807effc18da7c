"""One self-contained HTML page about an answer: why to believe it, or why not."""

from tuners.report.page import render, write_report

__all__ = ["render", "write_report"]
