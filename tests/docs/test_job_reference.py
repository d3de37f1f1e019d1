"""docs/job.md and docs/build_job.md say what the code accepts."""

from __future__ import annotations

import importlib.util
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_job_reference_is_the_generated_one() -> None:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    assert (DOCS / "job.md").read_text() == generate.job_reference(), "run: python docs/generate.py"
    built = generate.job_reference(generate.BuildJob, generate.BUILD_HEAD)
    assert (DOCS / "build_job.md").read_text() == built, "run: python docs/generate.py"
