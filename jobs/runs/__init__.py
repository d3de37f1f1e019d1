"""The life of a run: plan, driver, commits, resume, status, retry, verification."""
