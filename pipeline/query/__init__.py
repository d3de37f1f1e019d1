"""The query stages of the paper, one a file."""
