"""Every package's `__all__` names what it has, and nothing else."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

PACKAGES = [
    name
    for top in ("schemas", "pipeline", "workers", "jobs")
    for name in [top, *(m.name for m in pkgutil.walk_packages([top], f"{top}.") if m.ispkg)]
]


@pytest.mark.parametrize("name", PACKAGES)
def test_names_in_all_exist(name: str) -> None:
    package = importlib.import_module(name)
    listed = getattr(package, "__all__", [])
    assert not [entry for entry in listed if not hasattr(package, entry)]
