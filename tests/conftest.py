"""Shared fixtures: where the real data lies, and shape checks on every public function."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).resolve().parent.parent
os.environ.setdefault("NUMBA_NUM_THREADS", "2")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("same")
SHARED = Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data"))


def _checked_modules() -> list[str]:
    """Every leaf module of the pipeline but the kernels: numba cannot compile a checked function."""
    paths = [p for p in (ROOT / "pipeline").rglob("*.py") if not p.stem.endswith(("_kernels", "__init__"))]
    return [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in paths]


install_import_hook(_checked_modules(), "beartype.beartype")


@pytest.fixture
def shared_data() -> Path:
    """Folder with the real scenes and question files, or a skip where it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"no real data at {SHARED} (set SPLATREASONER_DATA)")
    return SHARED
