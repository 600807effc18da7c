"""One self-contained HTML page about an answer: why to believe it, or why not."""

from tuners.cli.report.page import render, write_report
from tuners.cli.report.plant_page import render_plant, write_plant_report

__all__ = ["render", "render_plant", "write_plant_report", "write_report"]
