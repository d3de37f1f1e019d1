"""Builds as runs: captures to scenes with the plan, commits and resume that questions have."""
