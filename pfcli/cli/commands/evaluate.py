"""`pfcli evaluate TRACK`."""

import math
from pathlib import Path
from typing import Any

import click

from pfcli.cli.types import Readable
from pfcli.errors import LogError, UsageError
from pfcli.events import stamp_text


@click.command()
@click.argument("track", type=Readable())
@click.option("--relations", type=click.Path(path_type=Path), help="Relations file: t1 t2 x y z roll pitch yaw.")
@click.option(
    "--stamps",
    type=click.Path(path_type=Path),
    help="Log that holds the scans' source stamps (default: track.parquet beside TRACK).",
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    help="Track (TUM, EuRoC, KITTI, CSV), or a log with a truth topic.",
)
@click.option(
    "--map", "map_file", type=click.Path(path_type=Path), help="Map to judge (default: map.yaml beside TRACK)."
)
@click.option("--true-map", type=click.Path(path_type=Path), help="Map YAML of the true world, in the truth's frame.")
@click.option("--align/--no-align", default=True, help="SE(2) alignment before comparing with truth.  (default: on)")
@click.option(
    "--max-gap",
    type=click.FloatRange(0),
    default=0.02,
    show_default=True,
    help="Stamps so far apart are still one [s].",
)
@click.option("--rpe-delta", type=click.IntRange(1), default=1, show_default=True, help="RPE over so many poses.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def evaluate(track: Path, as_json: bool, **given: Any) -> int:
    """Compare TRACK (TUM; `-`: standard input) with relations or truth, and judge the map beside it.

    Example: pfcli evaluate out/intel/track.tum --relations intel.relations
    """
    from pfcli.cli.printing import emit
    from pfcli.formats import tum

    stamps, poses = tum.read(track)
    found: dict[str, Any] = {"track": str(track), "poses": int(stamps.size)}
    lines = [f"{track}: {stamps.size} poses"]
    moved = None
    if given["relations"] is not None:
        _relations(track, poses, given, found, lines)
    if given["truth"] is not None:
        moved = _truth(stamps, poses, given, found, lines)
    _map(track, moved, given, found, lines)
    emit(found, lines, as_json)
    return 0


def _spread_lines(name: str, translation: Any, rotation: Any) -> str:
    if translation.n == 0:
        return f"{name}: none"
    t, r = translation, rotation
    deg = 180 / math.pi
    return (
        f"{name} ({t.n}): {t.mean:.4f} +- {t.sd:.4f} m (95 % of them <= {t.q95:.4f}, max {t.max:.4f};"
        f" interval of the mean {t.low:.4f} .. {t.high:.4f}), {r.mean * deg:.4f} +- {r.sd * deg:.4f} deg (max {r.max * deg:.4f})"
    )


def _relations(track: Path, poses: Any, given: dict[str, Any], found: dict[str, Any], lines: list[str]) -> None:
    from pfcli.core.evaluation.relation_error import FAR_SCANS, relation_errors
    from pfcli.core.evaluation.spread import spread
    from pfcli.formats import relations

    texts = _source_stamps(track, given["stamps"], len(poses))
    errors = relation_errors(relations.read(given["relations"]), texts, poses)
    far = errors.scans_apart >= FAR_SCANS
    found["relations"] = {"missing": errors.missing}
    if errors.missing:
        lines.append(f"{errors.missing} relations name stamps that the track does not have")
    for name, key, pick in (("all relations", "all", far | ~far), (f">= {FAR_SCANS} scans apart", "far", far)):
        t, r = spread(errors.translation_m[pick]), spread(errors.rotation_rad[pick])
        found["relations"][key] = {"translation_m": t._asdict(), "rotation_rad": r._asdict()}
        lines.append(_spread_lines(name, t, r))


def _source_stamps(track: Path, log: Path | None, count: int) -> list[str]:
    """Stamp text of every pose: from the log, from the table beside the track, else the track's own stamps."""
    from pfcli.formats import parquet, tum

    if log is not None:
        from pfcli.replay.log import Log

        texts = {e.stamp_ns: e.text for e in Log(log).events(["source_stamp"])}  # type: ignore[union-attr]
        if not texts:
            raise LogError(f"--stamps {log}: holds no /source_stamp topic; `pfcli convert` writes one")
        return [texts.get(int(s), stamp_text(int(s))) for s in tum.read(track)[0]]
    table = track.with_suffix(".parquet")
    if table.is_file():
        columns = parquet.read(table)
        if len(columns["t_ns"]) != count:
            raise LogError(f"{table}: has {len(columns['t_ns'])} rows, {track} has {count}; they are of different runs")
        if any(columns.get("source_stamp", [])):
            return list(columns["source_stamp"])
    return [stamp_text(int(s)) for s in tum.read(track)[0]]


def _truth(stamps: Any, poses: Any, given: dict[str, Any], found: dict[str, Any], lines: list[str]) -> Any:
    from pfcli.runs import judge

    rule = judge.Rule(given["align"], int(given["max_gap"] * 1e9), given["rpe_delta"])
    summary, moved = judge.judged(judge.Poses(stamps, poses, ""), judge.truth_of(given["truth"]), rule)
    found["truth"] = summary
    lines.append(
        f"ATE {summary['ate_m']:.4f} m (mean {summary['mean_m']:.4f}, max {summary['max_m']:.4f}) over {summary['poses']} poses,"
        + (
            " no heading"
            if summary["rpe_m"] is None
            else f" heading {summary['heading_rmse_deg']:.3f} deg, RPE {summary['rpe_m']:.4f} m {summary['rpe_deg']:.3f} deg"
        )
    )
    return moved


def _map(track: Path, moved: Any, given: dict[str, Any], found: dict[str, Any], lines: list[str]) -> None:
    from pfcli.core.evaluation import map_quality
    from pfcli.events import Pose2
    from pfcli.formats import map_yaml

    path = given["map_file"] or track.with_name("map.yaml")
    if given["map_file"] is None and not path.is_file():
        return
    grid = map_yaml.read(path)
    score = map_quality.doubled_walls(grid)
    found["map"] = {"doubled_walls": round(score, 6)}
    line = f"map: doubled-wall score {score:.4f}"
    if given["true_map"] is not None:
        if moved is None:
            raise UsageError("--true-map needs --truth, which says how the two maps lie")
        true = map_yaml.read(given["true_map"])
        agreement = map_quality.map_iou(grid, true, Pose2(*moved.tolist()))
        found["map"] |= {
            "iou": round(agreement.iou, 6),
            "doubled_walls_true": round(map_quality.doubled_walls(true), 6),
        }
        line += f", intersection over union {agreement.iou:.4f}"
    lines.append(line)
