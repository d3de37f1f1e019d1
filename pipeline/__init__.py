"""The method of the paper: pure functions and small classes that know nothing of Ray or of the command line."""
