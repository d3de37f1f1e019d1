"""What a run's rows amount to: scores, intervals, comparisons, exports."""
