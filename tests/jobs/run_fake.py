"""A driver in a process of its own, to be hurt: `python -m tests.jobs.run_fake submit|resume ARGUMENT`."""

from __future__ import annotations

import sys
from pathlib import Path

from jobs.config import JobConfig
from jobs.runs.progress import Lines
from jobs.runs.submit import resume, submit
from schemas.errors import SplatReasonerError
from tests.workers.fake_steps import STEPS

if __name__ == "__main__":
    verb, argument = sys.argv[1:]
    try:
        if verb == "submit":
            config = JobConfig.model_validate_json(Path(argument).read_text())
            result = submit(config, steps=STEPS, progress=Lines())
        else:
            result = resume(argument, steps=STEPS, progress=Lines())
    except SplatReasonerError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    sys.exit(130 if result.driven.stopped else 0)
