"""A driver in a process of its own, to be killed: `python -m tests.jobs.run_fake submit|resume ARGUMENT`."""

from __future__ import annotations

import sys
from pathlib import Path

from jobs.config import JobConfig
from jobs.progress import Lines
from jobs.submit import resume, submit
from tests.workers.fake_steps import STEPS

if __name__ == "__main__":
    verb, argument = sys.argv[1:]
    if verb == "submit":
        config = JobConfig.model_validate_json(Path(argument).read_text())
        result = submit(config, steps=STEPS, progress=Lines())
    else:
        result = resume(argument, steps=STEPS, progress=Lines())
    sys.exit(130 if result.driven.stopped else 0)
