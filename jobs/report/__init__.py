"""The report: a run, or two, as a page to look at, made from run folders and, for pictures, their scenes."""

from jobs.report.write import write_report

__all__ = ["write_report"]
