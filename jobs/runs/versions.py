"""Versions that decide whether two runs did the same work."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

STAGES = {
    "evidence": 2,
    "activate": 1,
    "cluster": 2,
    "visibility": 1,
    "initial_views": 1,
    "perturb": 2,
    "render": 1,
    "judge": 2,
    "verify": 2,
    "answer": 2,
    "ground": 2,
    "symbolic": 1,
    "scores": 1,
    "baselines": 1,
}
"""Raise a stage's number with every change that can change an answer or a score: unit ids depend on it."""

BUILD_STAGES = {"select": 1, "fuse": 1, "photos": 1, "train": 1, "describe": 2, "save": 2}
"""The same for what shapes a scene that is built from a capture."""

RECORDED = ("numpy", "numba", "scipy", "hdbscan", "pyarrow", "pandas", "pydantic", "openai", "ray", "pillow")


def package_versions() -> dict[str, str]:
    """Return the versions of Python, this project and the packages that shape its results."""
    found = {"python": platform.python_version()}
    for name in ("splatreasoner", *RECORDED):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def source_commit() -> str | None:
    """Return the git commit this code was checked out at, with "+" when files differ from it; None outside git."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return None
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return commit + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
