"""Fakes shared by the runner tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.workers import fake_steps
from workers.steps import Work


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Work:
    """Work of a run in a fresh folder; faults that happen once leave their marks there."""
    marks = tmp_path / "marks"
    marks.mkdir()
    monkeypatch.setenv(fake_steps.MARKS, str(marks))
    return Work(None, None, str(tmp_path / "calls"), str(tmp_path / "visibility"), str(tmp_path / "run"))
