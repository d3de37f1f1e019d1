"""Parts of models of random weights that several tests build."""

from __future__ import annotations

import json
from pathlib import Path


def tokenizer_files(folder: Path) -> tuple[str, str]:
    """Write a vocabulary of letters and one merge, as CLIP's tokenizer reads them; return the two files."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    tokens = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>", "ch"]
    vocabulary, merges = folder / "vocab.json", folder / "merges.txt"
    vocabulary.write_text(json.dumps({token: number for number, token in enumerate(tokens)}))
    merges.write_text("#version: 0.2\nc h\n")
    return str(vocabulary), str(merges)
