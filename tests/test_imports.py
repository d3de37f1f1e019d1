"""Imports point one way, and each third-party library stays where DESIGN puts it."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("schemas", "pipeline", "workers", "jobs")
"""Lowest first: a package may import itself and those before it."""

PIPELINE_ORDER = {
    "geometry": set(),
    "scene": {"geometry"},
    "datasets": {"geometry", "scene"},
    "render": {"geometry", "scene"},
    "models": {"scene"},
    "metrics": {"geometry", "scene", "models"},
    "construct": {"geometry", "scene", "render", "metrics"},
    "query": {"geometry", "scene", "datasets", "render", "models"},
    "tasks": {"geometry", "scene", "datasets", "render", "models", "metrics", "query"},
    "baselines": {"geometry", "scene", "datasets", "render", "construct", "models", "metrics", "query", "tasks"},
}
"""Subpackages of pipeline, and the others each may import."""

HOMES = {
    "ray": lambda path: path.parts[0] == "workers",
    "pyarrow": lambda path: path.parts[0] == "schemas",
    "obstore": lambda path: path == Path("schemas/object_store.py"),
    "numba": lambda path: path.stem.endswith("_kernels"),
    "torch": lambda path: path.parts[:2] == ("pipeline", "construct"),
    "gsplat": lambda path: path == Path("pipeline/construct/training/gsplat_rasterizer.py"),
    "openai": lambda path: path.stem == "endpoint",
    "aiohttp": lambda path: path.stem == "endpoint",
    "httpx": lambda path: path.stem == "endpoint",
    "httpx2": lambda path: path.stem == "endpoint",
    "typer": lambda path: path.parts[0] == "jobs",
    "rich": lambda path: path.parts[0] == "jobs",
    "viser": lambda path: path.parts[:2] == ("jobs", "viewer"),
}
"""Where a library may be imported."""


def _sources() -> list[Path]:
    return [p.relative_to(ROOT) for layer in LAYERS for p in sorted((ROOT / layer).rglob("*.py"))]


def _imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.append(node.module or "")
    return found


@pytest.mark.parametrize("path", _sources(), ids=str)
def test_imports_point_one_way(path: Path) -> None:
    allowed_layers = LAYERS[: LAYERS.index(path.parts[0]) + 1]
    for name in _imports(path):
        top = name.split(".")[0]
        if top in LAYERS:
            assert top in allowed_layers, f"{path} imports {name}: {path.parts[0]} may import {allowed_layers}"
        if top in HOMES:
            assert HOMES[top](path), f"{path} imports {name} outside its home"
        parts = name.split(".")
        if path.parts[0] == "pipeline" == top and len(path.parts) > 2 and len(parts) > 1:
            own, other = path.parts[1], parts[1]
            if other != own and other in PIPELINE_ORDER:
                assert other in PIPELINE_ORDER[own], f"{path} imports {name}: pipeline.{own} may not"


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Imports within functions and for types alone count too: who needs whom is then plain from the files."""
    modules = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in _sources()}
    needs: dict[str, set[str]] = {}
    for module, path in modules.items():
        found = set()
        for node in ast.walk(ast.parse((ROOT / path).read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names = (f"{node.module}.{alias.name}" for alias in node.names)
                found |= {name if name in modules else str(node.module) for name in names}
        needs[module] = (found & set(modules)) - {module}
    list(TopologicalSorter(needs).static_order())  # names the circle, where there is one


def test_every_subpackage_of_the_pipeline_has_a_place_in_the_order() -> None:
    folders = {p.name for p in (ROOT / "pipeline").iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert folders <= set(PIPELINE_ORDER)


def test_command_line_imports_nothing_heavy() -> None:
    code = "import sys, jobs.cli; print(*[m for m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    heavy = {"numba", "torch", "ray", "pandas", "hdbscan", "scipy", "openai", "pyarrow", "viser"} & set(out.split())
    assert not heavy, f"`splatreasoner --help` would pay for importing {sorted(heavy)}"
