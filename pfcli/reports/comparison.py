"""Runs side by side: errors and times, what differs between their parameters, and their tracks over one map."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli import registry
from pfcli.core.evaluation.track_error import align_se2, associate
from pfcli.core.geometry import compose
from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError
from pfcli.formats import map_yaml, parquet
from pfcli.reports.page import summary_of, whole_run

_GAP_NS = 50_000_000


class Compared(NamedTuple):
    """A run: name of its folder, its `run.json`, what determines it, stamps (n,) and poses (n, 3) of its track in the frame of
    the first run, and how far it is from that (RMSE, m; NaN where no stamp is shared)."""

    name: str
    summary: dict[str, Any]
    about: dict[str, Any]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    apart_m: float


def read(folders: Sequence[Path]) -> list[Compared]:
    """Runs in the frame of the first. Tracks of SLAM are moved onto it (SE(2)), those in a given map stay where they are.

    Raises LogError where a folder holds no run.
    """
    found: list[Compared] = []
    for name, folder in zip(_names(folders), folders, strict=True):
        with whole_run(folder):
            found.append(_read(name, folder, found[0] if found else None))
    return found


def _read(name: str, folder: Path, first: Compared | None) -> Compared:
    summary, about = summary_of(folder), parquet.provenance(folder / "track.parquet")
    table = parquet.read(folder / "track.parquet")
    poses = np.column_stack([table[k] for k in ("x_m", "y_m", "yaw_rad")])
    known = np.isfinite(poses).all(axis=1)
    stamps, poses, apart = np.asarray(table["t_ns"])[known], poses[known], 0.0
    if first is not None:
        own = not all(registry.system(run["system"]).frame == "given" for run in (about, first.about))
        poses, apart = _onto(first, stamps, poses, own)
    made = Compared(name, summary, about, stamps, poses, apart)
    rows([made]), _flat(about)  # what a table will need of it is there
    return made


def _names(folders: Sequence[Path]) -> list[str]:
    """The shortest ends of the paths that tell them apart."""
    parts = [folder.absolute().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(names):
            return names
    raise LogError(f"{folders[0]}: is named twice")


def _onto(
    first: Compared, stamps: NDArray[np.int64], poses: NDArray[np.float64], aligned: bool
) -> tuple[NDArray[np.float64], float]:
    try:
        mine, theirs = associate(stamps, first.stamps_ns, _GAP_NS)
    except LogError:
        return poses, float("nan")
    if aligned:
        poses = compose(align_se2(poses[mine], first.poses[theirs])[None], poses)
    off = (poses[mine] - first.poses[theirs])[:, :2]
    return poses, float(np.sqrt((off**2).sum(axis=1).mean()))


def rows(runs: Sequence[Compared]) -> list[dict[str, Any]]:
    """Per run what the table shows; None where a run has no such figure."""
    found = []
    for run in runs:
        truth = run.summary.get("truth") or {}
        row = {"run": run.name, "system": run.about["system"], "seed": run.about["seed"]}
        row |= {name: truth.get(name) for name in ("ate_m", "mean_m", "max_m", "heading_rmse_deg")}
        row |= {"apart_m": round(run.apart_m, 6) if np.isfinite(run.apart_m) else None}
        row |= {"updates": run.summary["updates"], "ms_per_update": run.summary["ms_per_update"]}
        found.append(row)
    return found


def differences(runs: Sequence[Compared]) -> dict[str, list[Any]]:
    """What is not the same in all runs, per run; None where a run has no such thing."""
    flat = [_flat(run.about) for run in runs]
    names = dict.fromkeys(name for one in flat for name in one if name != "seed")
    columns = {name: [one.get(name) for one in flat] for name in names}
    return {name: values for name, values in columns.items() if len(set(map(repr, values))) > 1}


def _flat(about: dict[str, Any]) -> dict[str, Any]:
    found = {name: value for name, value in about.items() if isinstance(value, int | float | str)}
    found |= about["params"]
    found |= {f"input {k}": row["sha256"][:12] for k, row in enumerate(about["inputs"])}
    found |= {f"reading {name}": value for name, value in about["reading"].items()}
    if "map" in about:
        found["map"] = about["map"]["sha256"][:12]
    return found


def grid_of(folders: Sequence[Path]) -> GridMap | None:
    """The map of the first run, which the tracks are drawn over."""
    path = folders[0] / "map.yaml"
    return map_yaml.read(path) if path.is_file() else None
