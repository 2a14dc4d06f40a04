"""`pfcli batch SWEEP.toml`."""

import json
import os
from pathlib import Path
from typing import Any

import click

from pfcli.cli.types import Finite
from pfcli.errors import EXIT_DONE, EXIT_FAILED, EXIT_INTERRUPTED, EXIT_PARTIAL, OutputError, UsageError
from pfcli.formats.atomic import interrupt_on_terminate


@click.command()
@click.argument("sweep", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of all jobs; done ones are kept.")
@click.option("--workers", type=click.IntRange(1, 1024), default=None, help="Worker processes (default: all cores).")
@click.option("--timeout", type=Finite(0), default=0.0, help="Most seconds of a job; 0: no limit.  (default: 0)")
@click.option("--memory", type=Finite(0), default=0.0, help="Most MB of memory of a job; 0: no limit.  (default: 0)")
@click.option("--shard", metavar="I/N", default=None, help="Only the I-th of N parts, for CI matrices and job arrays.")
@click.option("--scheduler", metavar="URL", default=None, help="A Dask scheduler, such as tcp://host:8786.")
@click.option("--send", is_flag=True, help="With --scheduler: the workers do not see the files here; send them once.")
@click.option("--dry-run", is_flag=True, help="Print the jobs, run none.")
@click.option("--progress", type=click.Choice(["auto", "never", "json"]), default="auto", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Print the result, or the jobs, as JSON.")
def batch(sweep: Path, out: Path, **given: Any) -> int:
    """Run every combination of logs, systems, parameters and seeds of a sweep file; what is done already is not done again.

    Exit code 0: all jobs are done; 3: all, but parts of some inputs were lost; 1: some failed, and a table says why.

    Example: pfcli batch sweep.toml --out out/sweep
    """
    from pfcli.batches import sweep as manifest
    from pfcli.batches.job_records import Tally
    from pfcli.cli.system_command import COMMAND_LINE

    if given["send"] and given["scheduler"] is None:
        raise UsageError("--send goes with --scheduler")
    if given["scheduler"] is not None and given["memory"]:
        raise UsageError("--memory does not go with --scheduler: dask worker --memory-limit says it there")
    if given["scheduler"] is not None and given["timeout"]:
        raise UsageError("--timeout does not go with --scheduler")
    tasks = manifest.read(sweep, COMMAND_LINE)
    if given["shard"] is not None:
        tasks = manifest.shard(tasks, given["shard"])
    tally = Tally(out, given["progress"])
    if given["dry_run"]:
        _print(tasks, tally, given["as_json"])
        return EXIT_DONE
    interrupt_on_terminate()
    try:
        left = tally.open(tasks)
        if given["scheduler"] is not None:
            from pfcli.batches.dask_cluster import run_dask

            run_dask(left, tally, given["scheduler"], COMMAND_LINE, send=given["send"])
        elif left:
            from pfcli.batches.processes import Limits, run_local

            workers = given["workers"] or len(os.sched_getaffinity(0))
            run_local(left, tally, workers, Limits(given["timeout"], given["memory"]), COMMAND_LINE)
    except KeyboardInterrupt:
        click.echo(
            f"pfcli: interrupted: {tally.done + tally.skipped} of {len(tasks)} jobs are done; the same command goes on",
            err=True,
        )
        return EXIT_INTERRUPTED
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({error.strerror or error})") from None
    finally:
        tally.close()
    _report(tasks, tally, given["as_json"])
    return EXIT_FAILED if tally.failed else EXIT_PARTIAL if tally.partial else EXIT_DONE


def _print(tasks: list[Any], tally: Any, as_json: bool) -> None:
    for task in tasks:
        done = tally.code(task) is not None
        if as_json:
            click.echo(json.dumps({"key": task.key, "done": done, **task.record()}))
        else:
            click.echo(f"{task.key} {'done' if done else 'open'}  pfcli {task.system} {' '.join(task.words)}")


def _report(tasks: list[Any], tally: Any, as_json: bool) -> None:
    found = {
        "jobs": len(tasks),
        "done": tally.done,
        "done_before": tally.skipped,
        "partial": tally.partial,
        "failed": tally.failed,
    }
    if as_json:
        click.echo(json.dumps(found))
        return
    click.echo(
        f"{tally.out}: {tally.done} of {len(tasks)} jobs done, {tally.skipped} before, {len(tally.failed)} failed"
    )
    by_key = {task.key: task for task in tasks}
    for key, why in sorted(tally.failed.items()):
        task = by_key[key]
        click.echo(f"  {key}  {task.system} {task.log} seed {task.seed} {task.point or ''}: {why}")
