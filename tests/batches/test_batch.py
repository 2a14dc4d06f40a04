"""Sweeps: what they mean, that nothing is lost or done twice, and that all runners give the same bytes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from pfcli.batches import summary
from pfcli.batches import sweep as manifest
from pfcli.batches.job_records import Tally
from pfcli.batches.processes import Limits, run_local
from pfcli.batches.worker import perform
from pfcli.cli.system_command import COMMAND_LINE
from pfcli.errors import LogError, OutputError, UsageError

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
SWEEP = """
logs = ["*.mcap"]
systems = ["slam-gdr"]
seeds = {seeds}
[options]
landmarks = true
truth = "auto"
end = 1
[grid]
particles = {particles}
"""
_PFCLI = [sys.executable, "-c", "from pfcli.cli.app import run; run()"]


def sweep(folder: Path, seeds: int = 2, particles: str = "[4, 8]", logs: int = 1) -> Path:
    folder.mkdir(exist_ok=True)
    for k in range(logs):
        shutil.copy(SAMPLES / "landmarks.mcap", folder / f"log-{k}.mcap")
    path = folder / "sweep.toml"
    path.write_text(SWEEP.format(seeds=seeds, particles=particles))
    return path


def contents(out: Path) -> dict[str, bytes]:
    """Every file of every job; of run.json what is not wall-clock, nor where the log lay."""
    found = {}
    for path in sorted((out / "jobs").glob("*/*")):
        data = path.read_bytes()
        if path.name == "run.json":
            told = json.loads(data)
            for name in ("seconds", "ms_per_update", "update_ms", "logs", "command"):
                del told[name]
            data = json.dumps(told).encode()
        found[f"{path.parent.name}/{path.name}"] = data
    return found


def finish(path: Path, out: Path) -> None:
    """Run all jobs of a sweep here and now."""
    for task in manifest.read(path, COMMAND_LINE):
        perform(COMMAND_LINE, task.system, task.words, task.record(), out / "jobs" / task.key)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory, pfcli: Cli) -> Path:
    folder = tmp_path_factory.mktemp("sweep") / "a"
    done = pfcli("batch", sweep(folder), "--out", folder / "out", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return folder


def test_a_sweep_is_every_combination_and_keys_are_of_what_determines_it(tmp_path: Path) -> None:
    path = sweep(tmp_path / "a", logs=2)
    tasks = manifest.read(path, COMMAND_LINE)
    assert sorted((t.log, t.seed, t.point["particles"]) for t in tasks) == [
        (log, seed, n) for log in ("log-0.mcap", "log-1.mcap") for seed in (0, 1) for n in (4, 8)
    ]
    assert len({task.key for task in tasks}) == 8
    moved = manifest.read(sweep(tmp_path / "b"), COMMAND_LINE)
    assert {task.key for task in moved} == {task.key for task in tasks if task.log == "log-0.mcap"}
    parts = [manifest.shard(tasks, f"{k}/3") for k in (1, 2, 3)]
    assert sorted(task.key for part in parts for task in part) == [task.key for task in tasks]
    path.write_text(path.read_text().replace("end = 1", "end = 1.5"))
    assert not {task.key for task in manifest.read(path, COMMAND_LINE)} & {task.key for task in tasks}


def test_tables_of_one_system_points_and_placeholders(tmp_path: Path) -> None:
    for name in ("partial.mcap", "partial-partial.yaml", "partial-partial.pgm"):
        shutil.copy(SAMPLES / name, tmp_path / name)
    path = tmp_path / "sweep.toml"
    path.write_text(
        'logs = ["partial.mcap"]\nsystems = ["localize-partial", "slam-gdr"]\nseeds = [7]\n'
        '[options.localize-partial]\nmap = "{log}-partial.yaml"\n[grid.slam-gdr]\nparticles = [2, 3]\n'
        "[[points]]\nstart = 0\n[[points]]\nstart = 1\n"
    )
    tasks = manifest.read(path, COMMAND_LINE)
    assert sorted((t.system, t.point.get("particles"), t.point["start"]) for t in tasks if t.system == "slam-gdr") == [
        ("slam-gdr", n, s) for n in (2, 3) for s in (0, 1)
    ]
    (mapped, _) = [t for t in tasks if t.system == "localize-partial"]
    assert str(tmp_path / "partial-partial.yaml") in mapped.words


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (("seeds = 2", "seeds = 0"), "seeds"),
        (("seeds = 2", 'seeds = "x"'), "seeds"),
        (('["slam-gdr"]', '["gmapping"]'), "gmapping"),
        (('["*.mcap"]', '["no-*.mcap"]'), "no-*.mcap"),
        (("end = 1", "end = 1\nout = 'x'"), "'out'"),
        (("end = 1", "end = 1\nno-such-flag = 3"), "no-such-flag"),
        (("particles = [4, 8]", "particles = 4"), "grid.particles"),
        (("particles = [4, 8]", "particles = [[4, 5]]"), "'particles' takes one value"),
        (("end = 1", "help = true"), "'help'"),
        (("end = 1", '"end=3" = true'), "no name of a flag"),
        (("seeds = 2", "seeds = [99999999999999999999]"), "seeds"),
        (("logs =", "points = []\nlogs ="), "points"),
        (("particles = [4, 8]", "particles = [-4]"), "particles"),
        (("[grid]", "[grid.slam]"), "'slam'"),
        (("logs =", "colour = 1\nlogs ="), "'colour'"),
        (("logs =", "logs"), "sweep"),
    ],
)
def test_a_sweep_that_is_wrong_is_one_line_before_anything_runs(
    change: tuple[str, str], word: str, tmp_path: Path
) -> None:
    path = sweep(tmp_path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(UsageError) as caught:
        manifest.read(path, COMMAND_LINE)
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_a_killed_batch_left_half_is_swept_but_not_what_another_is_writing(tmp_path: Path) -> None:
    old, fresh = tmp_path / "jobs/.a.1.part", tmp_path / "jobs/.b.2.part"
    old.mkdir(parents=True)
    fresh.mkdir()
    os.utime(old, (1e9, 1e9))
    Tally(tmp_path, "never").open([])
    assert (old.exists(), fresh.exists()) == (False, True)


def test_shards_that_are_none_are_refused(pfcli: Cli, tmp_path: Path) -> None:
    done = pfcli("batch", sweep(tmp_path), "--out", tmp_path / "out", "--shard", "3/2")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert not (tmp_path / "out").exists()


def test_done_jobs_are_skipped_and_an_extended_sweep_goes_on(reference: Path, pfcli: Cli) -> None:
    before = {p: p.stat().st_mtime_ns for p in (reference / "out/jobs").glob("*/run.json")}
    assert len(before) == 4
    again = pfcli("batch", sweep(reference, seeds=3), "--out", reference / "out", "--json")
    assert json.loads(again.stdout) == {"jobs": 6, "done": 2, "done_before": 4, "partial": 0, "failed": {}}
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in before.items())
    for path in (reference / "out/jobs").iterdir():
        if path / "run.json" not in before:
            shutil.rmtree(path)
    lines = pfcli("batch", sweep(reference), "--out", reference / "out", "--dry-run").stdout.splitlines()
    assert [line.split()[1] for line in lines] == ["done"] * 4


def test_workers_give_the_bytes_of_the_plain_command(reference: Path, pfcli: Cli, tmp_path: Path) -> None:
    both = pfcli("batch", sweep(reference), "--out", tmp_path / "out", "--workers", 2, "--progress", "json")
    assert both.returncode == 0
    assert json.loads(both.stderr.splitlines()[-1])["jobs"] == 4
    assert contents(tmp_path / "out") == contents(reference / "out")
    task = manifest.read(reference / "sweep.toml", COMMAND_LINE)[0]
    plain = pfcli(task.system, *task.words, "--out", tmp_path / "plain")
    assert plain.returncode == 0, plain.stderr
    for name in ("track.tum", "track.parquet", "metrics.parquet", "frames.parquet", "landmarks.parquet", "params.toml"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "out/jobs" / task.key / name).read_bytes(), name


def test_a_job_that_fails_is_in_the_table_and_takes_no_other_with_it(pfcli: Cli, tmp_path: Path) -> None:
    path = sweep(tmp_path)
    (tmp_path / "bad.mcap").write_bytes(b"this is no log")
    path.write_text(path.read_text() + "[[points]]\n")
    done = pfcli("batch", path, "--out", tmp_path / "out")
    assert done.returncode == 1, done.stderr
    assert "2 of 4 jobs done" not in done.stdout
    assert done.stdout.count("bad.mcap") >= 4
    assert "Traceback" not in done.stdout + done.stderr
    assert len(list((tmp_path / "out/failed").iterdir())) == 4
    assert len(list((tmp_path / "out/jobs").iterdir())) == 4
    told = pfcli("summarize", tmp_path / "out")
    assert told.returncode == 0
    assert told.stdout.count("failed: slam-gdr bad.mcap") == 4
    (tmp_path / "bad.mcap").unlink()
    assert pfcli("batch", path, "--out", tmp_path / "out").returncode == 0


def test_part_of_an_input_lost_is_exit_code_3_now_and_later(pfcli: Cli, tmp_path: Path) -> None:
    path = sweep(tmp_path, seeds=1, particles="[4]")
    log = tmp_path / "log-0.mcap"
    log.write_bytes(log.read_bytes()[: 3 * log.stat().st_size // 4])
    for _ in range(2):
        done = pfcli("batch", path, "--out", tmp_path / "out", "--json")
        assert done.returncode == 3, done.stderr
        assert json.loads(done.stdout)["partial"] == 1


def test_limits_end_the_job_and_not_the_batch(tmp_path: Path) -> None:
    tasks = manifest.read(sweep(tmp_path, seeds=1, particles="[4]"), COMMAND_LINE)
    for limits, word in ((Limits(seconds=0.01), "--timeout"), (Limits(megabytes=1.0), "--memory")):
        tally = Tally(tmp_path / "out", "never")
        run_local(tally.open(tasks), tally, 1, limits, COMMAND_LINE)
        assert [why for why in tally.failed.values() if word in why] == list(tally.failed.values())
        assert len(tally.failed) == 1
    record = json.loads(next((tmp_path / "out/failed").iterdir()).read_text())
    assert record["system"] == "slam-gdr"


def children(pid: int) -> list[int]:
    """Worker processes of a batch."""
    found = []
    for path in Path("/proc").iterdir():
        if path.name.isdecimal():
            try:
                words = (path / "stat").read_text().rsplit(")", 1)[1].split()
                command = (path / "cmdline").read_text()
            except OSError:
                continue
            if int(words[1]) == pid and "spawn_main" in command:
                found.append(int(path.name))
    return found


def test_a_worker_that_dies_takes_only_its_job_with_it_and_that_is_tried_again(tmp_path: Path) -> None:
    path, out = sweep(tmp_path, seeds=8), tmp_path / "out"
    path.write_text(path.read_text().replace("end = 1", "end = 30"))
    batch = subprocess.Popen([*_PFCLI, "batch", path, "--out", out, "--workers", "2", "--json"], stdout=subprocess.PIPE)
    killed = 0
    for _ in range(4800):
        if batch.poll() is not None:
            break
        done = len(list((out / "jobs").glob("[0-9a-f]*"))) if (out / "jobs").is_dir() else 0
        if killed < 2 and done > 4 * killed + 2:
            for pid in children(batch.pid)[:1]:
                os.kill(pid, signal.SIGKILL)
                killed += 1
        time.sleep(0.05)
    told = json.loads(batch.communicate(timeout=60)[0])
    assert killed == 2
    assert told["done"] == 16
    assert told["failed"] == {}


def kill_and_go_on(tmp_path: Path, reference: Path, times: int) -> None:
    out = tmp_path / "out"
    path = sweep(reference)
    rounds = 0
    for k in range(times):
        batch = subprocess.Popen([*_PFCLI, "batch", path, "--out", out, "--workers", "2"], stderr=subprocess.DEVNULL)
        try:
            batch.wait(0.6 + 3.0 * ((k * 0.618) % 1.0))
        except subprocess.TimeoutExpired:
            batch.kill()
            batch.wait()
            rounds += 1
        for job in (out / "jobs").glob("[0-9a-f]*") if out.exists() else ():
            assert (job / "run.json").is_file()
            assert (job / "job.json").is_file()
        if k % 3 == 2:
            time.sleep(0.3)  # its workers end with it
            shutil.rmtree(out)
    assert rounds > times // 5
    done = subprocess.run([*_PFCLI, "batch", path, "--out", out], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert contents(out) == contents(reference / "out")


def test_killed_at_any_moment_nothing_half_is_taken_for_whole(tmp_path: Path, reference: Path) -> None:
    kill_and_go_on(tmp_path, reference, 3)


@pytest.mark.slow
def test_killed_fifty_times(tmp_path: Path, reference: Path) -> None:
    kill_and_go_on(tmp_path, reference, 50)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """A Dask scheduler and two workers on loopback."""
    where = tmp_path / "scheduler.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "dask"]
    scheduler = subprocess.Popen(
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where)],
        **quiet,
    )
    for _ in range(300):
        if where.is_file() and where.stat().st_size:
            break
        time.sleep(0.1)
    address = json.loads(where.read_text())["address"]
    workers = [
        subprocess.Popen([*dask, "worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"], **quiet)
        for _ in range(2)
    ]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


def test_a_cluster_gives_the_same_bytes(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], tmp_path: Path, reference: Path, pfcli: Cli
) -> None:
    for out, words in ((tmp_path / "read", ()), (tmp_path / "sent", ("--send",))):
        done = pfcli("batch", sweep(reference), "--out", out, "--scheduler", cluster[0], *words)
        assert done.returncode == 0, done.stderr
        assert contents(out) == contents(reference / "out")


@pytest.mark.parametrize("jobs", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_a_dask_worker_killed_in_a_sweep_loses_nothing(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], jobs: int, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    path = sweep(tmp_path / "s", seeds=jobs // 2, particles="[4, 5]")
    batch = subprocess.Popen(
        [*_PFCLI, "batch", path, "--out", out, "--scheduler", cluster[0], "--send", "--json"], stdout=subprocess.PIPE
    )
    for _ in range(4800):
        if out.exists() and len(list((out / "jobs").glob("[0-9a-f]*"))) > jobs // 4:
            break
        assert batch.poll() is None
        time.sleep(0.05)
    cluster[1][0].kill()
    told = json.loads(batch.communicate(timeout=240)[0])
    assert told == {"jobs": jobs, "done": jobs, "done_before": 0, "partial": 0, "failed": {}}


def test_workers_that_cannot_begin_are_one_line_and_not_a_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = manifest.read(sweep(tmp_path, seeds=1), COMMAND_LINE)
    (tmp_path / "pfcli.py").write_text("raise ImportError('broken')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    tally = Tally(tmp_path / "out", "never")
    with pytest.raises(OutputError, match=r"a worker cannot begin: its worker died \(exit code 1\)"):
        run_local(tally.open(tasks), tally, 1, Limits(), COMMAND_LINE)


def test_nobody_at_the_scheduler_is_one_line(pfcli: Cli, tmp_path: Path) -> None:
    done = pfcli("batch", sweep(tmp_path), "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("pfcli: --scheduler tcp://127.0.0.1:9: nobody answers")
    assert "Traceback" not in done.stderr


def test_the_summary_is_the_runs_and_the_baseline_is_a_gate(reference: Path, pfcli: Cli, tmp_path: Path) -> None:
    from pfcli.formats import parquet

    out = tmp_path / "out"
    shutil.copytree(reference / "out", out)
    told = json.loads(pfcli("summarize", out, "--json").stdout)
    table = parquet.read(out / "summary.parquet")
    for key, ate in zip(table["job"], table["truth.ate_m"].tolist(), strict=True):
        assert ate == json.loads((out / "jobs" / key / "run.json").read_text())["truth"]["ate_m"]
    for group in told["groups"]:
        own = [
            a
            for a, n in zip(table["truth.ate_m"].tolist(), table["point.particles"], strict=True)
            if n == group["point"]["particles"]
        ]
        assert (group["n"], group["mean"]) == (2, pytest.approx(sum(own) / 2))
        assert group["low"] < group["mean"] < group["high"]
    lowest = min(told["groups"], key=lambda g: g["mean"])
    assert told["best"]["slam-gdr"]["point"] == lowest["point"]
    same = pfcli("summarize", out, "--baseline", reference / "out")
    assert same.returncode == 0
    assert same.stdout.count("same:") == 2
    for path in (out / "jobs").glob("*/run.json"):
        ran = json.loads(path.read_text())
        ran["truth"]["ate_m"] *= 1.2 if ran["particles"] == 8 else 0.7
        path.write_text(json.dumps(ran))
    worse = pfcli("summarize", out, "--baseline", reference / "out")
    assert worse.returncode == 4
    strict = pfcli("summarize", out, "--baseline", reference / "out", "--json").stdout
    assert "NaN" not in strict
    assert (worse.stdout.count("worse:"), worse.stdout.count("better:")) == (1, 1)
    assert pfcli("summarize", out, "--baseline", reference / "out", "--tolerance", 0.5).returncode == 0
    given = ("summarize", out, "--baseline", reference / "out", "--format")
    page = pfcli(*given, "markdown")
    assert page.returncode == 4
    assert (page.stdout.count("| worse |"), page.stdout.count("| better |")) == (1, 1)
    suite = ElementTree.fromstring(pfcli(*given, "junit").stdout.partition("\n")[2])
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "1", "0")
    assert len(suite.findall("testcase/failure")) == 1
    steps = tmp_path / "steps.md"
    said = pfcli(*given, "github", env=os.environ | {"GITHUB_STEP_SUMMARY": str(steps)})
    assert (said.stdout.count("\n"), said.stdout.startswith("::error title=pfcli::worse: slam-gdr")) == (1, True)
    assert steps.read_text() == page.stdout
    wrong = pfcli("summarize", out, "--metric", "beauty")
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)


def test_seeds_that_the_baseline_has_and_a_run_lacks_fail_the_gate(reference: Path, pfcli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(reference / "out", out)
    first, second, *_ = sorted((out / "jobs").iterdir())
    shutil.rmtree(first)
    ran = json.loads((second / "run.json").read_text())
    ran["truth"]["ate_m"] = float("nan")
    (second / "run.json").write_text(json.dumps(ran))
    done = pfcli("summarize", out, "--metric", "truth.ate_m", "--baseline", reference / "out")
    assert done.returncode == 4
    assert "missing:" in done.stdout
    assert "3 jobs, 1 without truth.ate_m" in done.stdout


def test_jobs_of_other_options_are_other_groups(pfcli: Cli, tmp_path: Path, reference: Path) -> None:
    """The option of the whole sweep changed, in the same folder: nothing is mixed, and nothing of it is compared."""
    path = sweep(tmp_path / "s", particles="[4]")
    finish(path, tmp_path / "out")
    path.write_text(path.read_text().replace("end = 1", "end = 1.4"))
    finish(path, tmp_path / "out")
    told = json.loads(pfcli("summarize", tmp_path / "out", "--json").stdout)
    assert [group["n"] for group in told["groups"]] == [2, 2]
    assert told["jobs"] == 4
    later = tmp_path / "later"
    finish(path, later)
    wrong = pfcli("summarize", later, "--baseline", reference / "out")
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)


def test_a_record_that_a_power_cut_left_empty_is_no_done_job(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference / "out", tmp_path / "out")
    task = manifest.read(sweep(reference), COMMAND_LINE)[0]
    (tmp_path / "out/jobs" / task.key / "job.json").write_text("")
    assert Tally(tmp_path / "out", "never").open(manifest.read(reference / "sweep.toml", COMMAND_LINE)) == [task]
    (tmp_path / "out/failed").mkdir()
    (tmp_path / "out/failed/x.json").write_text("{")
    with pytest.raises(LogError, match=r"x\.json"):
        summary.failures(tmp_path / "out")


def test_interrupted_it_says_what_is_done(tmp_path: Path) -> None:
    batch = subprocess.Popen(
        [*_PFCLI, "batch", sweep(tmp_path, seeds=50), "--out", tmp_path / "out", "--workers", "1"],
        stderr=subprocess.PIPE,
    )
    for _ in range(4800):
        if len(list((tmp_path / "out/jobs").glob("[0-9a-f]*"))) > 2:
            break
        time.sleep(0.05)
    batch.send_signal(signal.SIGINT)
    said = batch.communicate(timeout=60)[1].decode()
    assert batch.returncode == 130
    assert " of 100 jobs are done; the same command goes on" in said
    assert "Traceback" not in said


def test_what_is_no_batch_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no folder of pfcli batch"):
        list(summary.rows(tmp_path))
    (tmp_path / "jobs/abc").mkdir(parents=True)
    with pytest.raises(LogError, match="abc"):
        list(summary.rows(tmp_path))


def test_the_interval_of_the_mean_is_students() -> None:
    """Of 1, 2, 3, 4, 5: 3 +- 2.776 * 1.581 / sqrt(5)."""
    found = summary.spread([1.0, 2.0, 3.0, 4.0, 5.0])
    assert (found.mean, found.median) == (3.0, 3.0)
    assert found.high - found.mean == pytest.approx(2.7764 * 1.5811 / 5**0.5, rel=1e-4)
