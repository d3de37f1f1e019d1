"""What a run says of the code that made it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from jobs.runs.versions import source_commit

ROOT = Path(__file__).resolve().parents[3]


def test_source_commit_of_a_checkout_is_its_head() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    head = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    assert (source_commit() or "").removesuffix("+") == head.stdout.strip()
