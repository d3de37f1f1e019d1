"""What is shipped: type information, data files, one version, a citation, shell completion."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml

from tests.conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Names of the files in the wheel."""
    builder = pytest.importorskip("hatchling.build", reason="hatchling is not installed")
    folder = tmp_path_factory.mktemp("wheel")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        name = builder.build_wheel(str(folder))
    with zipfile.ZipFile(folder / name) as archive:
        return archive.namelist()


def test_wheel_holds_every_source_and_data_file_and_nothing_else(wheel: list[str]) -> None:
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix not in (".pyc", ".nbi", ".nbc")
    }
    wanted |= {f"jobs/tables/presets/{path.name}" for path in (ROOT / "examples" / "tables").iterdir()}
    assert {name for name in wheel if ".dist-info/" not in name} == wanted


def test_wheel_holds_prompts_page_files_and_type_markers(wheel: list[str]) -> None:
    for name in ("pipeline/models/prompts/evidence.txt", "jobs/report/page.css", "jobs/report/report.js"):
        assert name in wheel
    assert [package for package in PACKAGES if f"{package}/py.typed" not in wheel] == []


def test_version_stands_in_one_place_and_is_said() -> None:
    version = PROJECT["project"]["version"]
    assert metadata.version("splatreasoner") == version
    code = "import sys; from jobs.cli import main; sys.argv = ['splatreasoner', '--version']; main()"
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout == f"splatreasoner {version}\n"
    written = [
        path.name
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"^__version__", path.read_text(), re.MULTILINE)
    ]
    assert written == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_produced_and_completes_a_verb(shell: str, tmp_path: Path) -> None:
    code = "import sys; from jobs.cli import main; sys.argv = ['splatreasoner']; main()"

    def complete(**variables: str) -> str:
        # Typed words come by the environment, as the scripts give them.
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=variables, capture_output=True, text=True, check=False
        )
        return done.stdout

    assert "splatreasoner" in complete(_SPLATREASONER_COMPLETE=f"source_{shell}")
    typed = {"COMP_WORDS": "splatreasoner subm", "COMP_CWORD": "1"}
    if shell != "bash":
        typed = {"_TYPER_COMPLETE_ARGS": "splatreasoner subm", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    assert "submit" in complete(_SPLATREASONER_COMPLETE=f"complete_{shell}", **typed)


def test_citation_is_whole() -> None:
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(found)
    assert found["license"] == PROJECT["project"]["license"]


def test_image_installs_what_the_wheel_needs() -> None:
    told = (ROOT / "Dockerfile").read_text()
    assert [package for package in PACKAGES if f"COPY {package} {package}\n" not in told] == []
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    copied = {word for line in re.findall(r"^COPY (?!--)(.+)$", told, re.MULTILINE) for word in line.split()[:-1]}
    assert copied <= kept
