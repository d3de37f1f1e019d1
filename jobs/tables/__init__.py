"""The paper's tables: a file of rows and columns to runs, and runs to cells."""
