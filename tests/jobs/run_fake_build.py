"""A build driver in a process of its own, to be hurt: `python -m tests.jobs.run_fake_build submit|resume ARGUMENT`."""

from __future__ import annotations

import sys
from pathlib import Path

from jobs.builds.build_captures import resume_build, submit_build
from jobs.builds.build_job import BuildJob
from jobs.runs.progress import Lines
from schemas.errors import SplatReasonerError
from tests.workers.fake_builds import fake_build

if __name__ == "__main__":
    verb, argument = sys.argv[1:]
    shown = Lines(items="captures")
    try:
        if verb == "submit":
            job = BuildJob.model_validate_json(Path(argument).read_text())
            result = submit_build(job, build=fake_build, progress=shown)
        else:
            result = resume_build(argument, build=fake_build, progress=shown)
    except SplatReasonerError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    sys.exit(130 if result.driven.stopped else 0)
