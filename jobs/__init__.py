"""What a person runs: the command line, plans, runs, metrics tables and reports."""
