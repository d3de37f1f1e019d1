"""The report: a run as one page to look at, made from the run folder alone."""

from jobs.report.write import write_report

__all__ = ["write_report"]
