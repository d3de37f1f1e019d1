import os, signal, time
from pathlib import Path
from tests.jobs.faults import *
from tests.jobs.faults import processes
from tests.jobs.conftest import *
from tests.jobs.chaos.measured import measured
from tests.workers.fake_steps import EATEN
def test_dbg(make_scene, make_job, tmp_path):
    from ray._private import utils
    make_scene("a", ["a", "b", "eats memory", "cc", "d", "no evidence"])
    make_scene("b", ["a", "b", "cc"])
    used, total = utils.get_used_memory(), utils.get_system_memory()
    print("used", used>>20, "total", total>>20)
    limits = {"RAY_memory_usage_threshold": f"{(used + (3<<30)) / total:.3f}", "RAY_memory_monitor_refresh_ms": "100"}
    print(limits)
    job = make_job("hurt", workers={"in_process": False})
    with driver("submit", job_file(job, tmp_path), **{EATEN: str(5<<30)}, **limits) as process:
        t0=time.monotonic(); low=1e18
        while process.poll() is None and time.monotonic()-t0<110:
            time.sleep(0.3); low=max(0,0) or min(low, int([l for l in open("/proc/meminfo") if "Available" in l][0].split()[1])>>10)
        print("lowest avail MB", low, "code", process.poll())
    print(Path(job.output, "events.jsonl").read_text())
