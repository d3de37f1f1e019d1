"""A driver that asks models, in a process of its own, to be killed: `python -m tests.jobs.run_calling JOB.json`."""

from __future__ import annotations

import sys
from pathlib import Path

from jobs.config import JobConfig
from jobs.runs.submit import submit
from tests.workers.calling_steps import STEPS

if __name__ == "__main__":
    submit(JobConfig.model_validate_json(Path(sys.argv[1]).read_text()), steps=STEPS)
