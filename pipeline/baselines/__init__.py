"""The other rows of the paper's tables: each a method that a job file selects by `method.kind`."""
