"""Metrics: pure functions on arrays and frames; they never import the query stages."""
