"""What a batch costs beside its jobs.

python benchmarks/batch.py overhead      a job's cost beyond its replay, on a warm worker
python benchmarks/batch.py workers       two workers against one, paired
python benchmarks/batch.py dask          jobs a second through a scheduler and two workers on loopback
python benchmarks/batch.py summary [N]   time and memory of the summary of N synthetic jobs (default 100 000)
"""

import contextlib
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.batches import summary, sweep
from pfcli.batches.job_records import Tally
from pfcli.batches.processes import Limits, run_local
from pfcli.cli.system_command import COMMAND_LINE
from pfcli.formats import parquet

SAMPLES = Path(__file__).resolve().parents[1] / "sample_logs"
SWEEP = """logs = ["landmarks.mcap"]
systems = ["slam-gdr"]
seeds = {seeds}
[options]
landmarks = true
end = {end}
"""


def tasks(folder: Path, seeds: int, end_s: float) -> list[sweep.Task]:
    with contextlib.suppress(shutil.SameFileError):
        shutil.copy(SAMPLES / "landmarks.mcap", folder / "landmarks.mcap")
    path = folder / "sweep.toml"
    path.write_text(SWEEP.format(seeds=seeds, end=end_s))
    return sweep.read(path, COMMAND_LINE)


def local(jobs: list[sweep.Task], folder: Path, workers: int) -> tuple[float, float]:
    """Seconds of the batch, and mean seconds of the replays in it."""
    tally = Tally(folder, "never")
    began = time.perf_counter()
    run_local(tally.open(jobs), tally, workers, Limits(), COMMAND_LINE)
    took = time.perf_counter() - began
    ran = [json.loads(path.read_text())["seconds"] for path in (folder / "jobs").glob("*/run.json")]
    return took, float(np.mean([sum(seconds.values()) for seconds in ran]))


def overhead() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        few, many = tasks(folder, 20, 2.0), tasks(folder, 220, 2.0)
        each = []
        for k in range(3):
            first, _ = local(few, folder / f"few{k}", 1)
            second, replay = local(many, folder / f"many{k}", 1)
            each.append(1e3 * ((second - first) / (len(many) - len(few)) - replay))
        print(
            f"beyond the replay of {1e3 * replay:.1f} ms: {np.median(each):.1f} ms a job (three runs: {np.round(each, 1)})"
        )


def workers() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, ratios = Path(name), []
        shutil.copy(SAMPLES / "small-loop.mcap", folder / "small-loop.mcap")
        (folder / "long.toml").write_text('logs = ["small-loop.mcap"]\nsystems = ["slam-gdr"]\nseeds = 40\n')
        jobs = sweep.read(folder / "long.toml", COMMAND_LINE)
        local(jobs[:2], folder / "warm", 2)
        for k in range(3):
            one, _ = local(jobs, folder / f"one{k}", 1)
            two, _ = local(jobs, folder / f"two{k}", 2)
            ratios.append(one / two)
        print(f"two workers: {np.median(ratios):.2f} times one (three pairs: {np.round(ratios, 2)})")


def dask() -> None:
    from pfcli.batches.dask_cluster import run_dask

    with tempfile.TemporaryDirectory() as name:
        folder, where = Path(name), Path(name) / "scheduler.json"
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": name}
        words = [sys.executable, "-m", "dask"]
        head = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where)]
        processes = [subprocess.Popen([*words, *head], **quiet)]
        while not where.is_file() or not where.stat().st_size:
            time.sleep(0.1)
        address = json.loads(where.read_text())["address"]
        for _ in range(2):
            worker = [*words, "worker", address, "--nthreads", "1", "--no-dashboard"]
            processes.append(subprocess.Popen(worker, **quiet))
        try:
            warm = Tally(folder / "warm", "never")
            run_dask(warm.open(tasks(folder, 20, 2.0)), warm, address, COMMAND_LINE, send=False)
            jobs = tasks(folder, 400, 2.0)
            began = time.perf_counter()
            tally = Tally(folder / "out", "never")
            run_dask(tally.open(jobs), tally, address, COMMAND_LINE, send=False)
            took = time.perf_counter() - began
        finally:
            for process in processes:
                process.kill()
        print(f"Dask, two workers on loopback: {tally.done} jobs in {took:.1f} s, {tally.done / took:.0f} a second")


def summarize(count: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, rng = Path(name), np.random.default_rng(0)
        job = tasks(folder, 1, 2.0)
        local(job, folder / "out", 1)
        template = json.loads(next((folder / "out/jobs").glob("*/run.json")).read_text())
        record = json.loads(next((folder / "out/jobs").glob("*/job.json")).read_text())
        shutil.rmtree(folder / "out/jobs")
        began = time.perf_counter()
        for k in range(count):
            place = folder / "out/jobs" / f"{k:016x}"
            place.mkdir(parents=True)
            template["truth"] = {"ate_m": float(rng.exponential())}
            (place / "run.json").write_text(json.dumps(template))
            point = {"particles": k % 100}
            (place / "job.json").write_text(json.dumps({**record, "seed": k // 100, "point": point, "exit": 0}))
        made = time.perf_counter() - began
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        began = time.perf_counter()
        summary.write(folder / "out", folder / "summary.parquet")
        wrote = time.perf_counter() - began
        found = summary.groups(parquet.rows(folder / "summary.parquet"), "truth.ate_m", folder)
        took = time.perf_counter() - began
        more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before
        size = (folder / "summary.parquet").stat().st_size / count
        print(
            f"{count} jobs in {len(found)} groups: table in {wrote:.1f} s, with groups {took:.1f} s, {more:.0f} MB more memory,"
            f" {size:.0f} bytes a row (their folders were made in {made:.1f} s)"
        )


if __name__ == "__main__":
    if sys.argv[1] == "summary":
        summarize(int(sys.argv[2]) if len(sys.argv) > 2 else 100_000)
    else:
        {"overhead": overhead, "workers": workers, "dask": dask}[sys.argv[1]]()
