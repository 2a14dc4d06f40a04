"""`pfcli summarize DIR`."""

import json
import math
from pathlib import Path
from typing import Any

import click

from pfcli.cli.types import Finite
from pfcli.errors import EXIT_DONE, EXIT_NOT_PASSED, LogError, UsageError
from pfcli.reports import batch_tables
from pfcli.reports.batch_tables import FORMATS, label

_FORMS = {"markdown": batch_tables.markdown, "junit": batch_tables.junit, "github": batch_tables.github}
_USUAL = ("truth.ate_m", "ms_per_update", "updates")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--metric", default=None, help="A number of run.json, such as truth.ate_m.  (default: truth.ate_m if it is there)"
)
@click.option("--higher-is-better", is_flag=True, help="What the metric means.")
@click.option("--baseline", type=click.Path(path_type=Path), default=None, help="Another batch to compare with.")
@click.option(
    "--tolerance",
    type=Finite(0, 1e6),
    default=0.1,
    show_default=True,
    help="Worse by more than this share is a failure.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="Parquet file (default: summary.parquet in DIR)."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default=FORMATS[0],
    show_default=True,
    help="For a person, a page, a test report, or annotations and the step summary of GitHub Actions.",
)
def summarize(folder: Path, **given: Any) -> int:
    """One row for every job of a batch in summary.parquet, and a table over the seeds.

    With --baseline: what got better or worse; exit code 4 if something got worse beyond the tolerance, or is missing.

    Example: pfcli summarize out/sweep --baseline out/sweep-of-main
    """
    from pfcli.batches import summary
    from pfcli.formats import parquet

    target = given["out"] or folder / "summary.parquet"
    if str(target) == "-":
        raise UsageError("--out -: a Parquet file has to be sought in; --json prints the result")
    numbers = summary.write(folder, target)
    metric = given["metric"] or next((name for name in _USUAL if name in numbers), "")
    if not numbers:
        raise LogError(f"{folder}: no job is done yet")
    if metric not in numbers:
        raise UsageError(f"--metric {metric}: {folder} has no such number, but {', '.join(numbers)}")
    higher = given["higher_is_better"]
    found = summary.groups(parquet.rows(target), metric, folder)
    table = [{**_named(group), **summary.spread(list(values.values()))._asdict()} for group, values in found.items()]
    result: dict[str, Any] = {"out": str(target), "metric": metric, "groups": table, "failed": summary.failures(folder)}
    result["jobs"] = sum(len(values) for values in found.values())
    result["without"] = result["jobs"] - sum(row["n"] for row in table)
    best = summary.best(found, higher=higher)
    result["best"] = {system: {"point": dict(point), "mean": mean} for system, (point, mean) in best.items()}
    code = EXIT_DONE
    if given["baseline"] is not None:
        before = summary.groups(summary.rows(given["baseline"]), metric, given["baseline"])
        if not found.keys() & before.keys():
            raise UsageError(f"--baseline {given['baseline']}: has no job of the same log, system and options")
        changes = summary.changes(found, before, higher=higher)
        result["changes"] = [_named(c.group) | {k: v for k, v in c._asdict().items() if k != "group"} for c in changes]
        if any(c.missing or c.worse > given["tolerance"] for c in changes):
            code = EXIT_NOT_PASSED
    if given["as_json"]:
        click.echo(json.dumps(_plain(result)))
    elif given["form"] != "text":
        click.echo(_FORMS[given["form"]](result, given["tolerance"]), nl=False)
    else:
        click.echo("\n".join(_lines(result, given["tolerance"])))
    return code


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _named(group: Any) -> dict[str, Any]:
    return {"system": group.system, "log": group.log, "point": dict(group.point), "mark": group.mark}


def _lines(result: dict[str, Any], tolerance: float) -> list[str]:
    names = [label(row) for row in result["groups"]]
    for row in result["groups"]:
        # the same words for different logs or options of the whole sweep
        row["log"] += f" ({row['mark'][:6]})" if names.count(label(row)) > 1 else ""
    width = max((len(label(row)) for row in result["groups"]), default=0)
    lines = [f"{result['metric']:{width}}      n        mean      median   95 % of the mean"]
    for row in result["groups"]:
        interval = f"{row['low']:.5g} .. {row['high']:.5g}" if row["n"] > 1 else "-"
        lines.append(f"{label(row):{width}} {row['n']:6d} {row['mean']:11.5g} {row['median']:11.5g}   {interval}")
    for system, row in result["best"].items():
        point = " ".join(f"{k}={v}" for k, v in row["point"].items())
        lines.append(f"best of {system}: {point} (mean over logs {row['mean']:.5g})")
    for row in result["failed"]:
        lines.append(f"failed: {label(row)} seed {row['seed']}: {row['why']}")
    for row in result.get("changes", []):
        if row["missing"]:
            seeds = ", ".join(map(str, row["missing"]))
            lines.append(f"missing: {label(row)}: seeds {seeds} of the baseline have no number here")
        if row["seeds"]:
            word = "worse" if row["worse"] > tolerance else "better" if row["worse"] < -tolerance else "same"
            change = f"{row['old']:.5g} -> {row['new']:.5g} ({row['worse']:+.1%}, {row['seeds']} seeds)"
            lines.append(f"{word}: {label(row)}: {change}")
    without = f", {result['without']} without {result['metric']}" if result["without"] else ""
    lines.append(f"{result['out']}: {result['jobs']} jobs{without}, {len(result['failed'])} failed")
    return lines
