"""Make the sample logs, run them with the installed `pfcli`, and write or check their golden figures.

python sample_logs/make.py samples | golden | check
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent


def pfcli(*words: str) -> dict[str, Any]:
    """Run the installed command and return the object it prints."""
    done = subprocess.run(["pfcli", *words, "--json"], capture_output=True, text=True, check=False, cwd=HERE)
    if done.returncode:
        sys.exit(f"pfcli {' '.join(words)}: exit code {done.returncode}\n{done.stderr}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def samples() -> dict[str, dict[str, Any]]:
    """The logs of samples.toml by name."""
    table = tomllib.loads((HERE / "samples.toml").read_text())
    return {name: row for name, row in table.items() if isinstance(row, dict) and "run" in row}


def make(folder: Path) -> None:
    """Write every sample log with its true map, or with the map that a localiser is given."""
    for name, row in samples().items():
        kind = "--partial-map" if row.get("map", "").endswith("-partial.yaml") else "--true-map"
        which = [] if row["run"][0] == "fuse-soccer" or "--landmarks" in row["run"] else [kind]
        pfcli("simulate", row["simulate"][0], str(folder / f"{name}.mcap"), *row["simulate"][1:], *which, "--force")


def figures() -> dict[str, dict[str, float]]:
    """Run every sample log through its system and evaluate it."""
    found = {}
    for name, row in samples().items():
        log = str(HERE / f"{name}.mcap")
        with tempfile.TemporaryDirectory() as out:
            given = ["--map", str(HERE / row["map"])] if "map" in row else []
            ran = pfcli(row["run"][0], log, "--out", f"{out}/run", "--truth", "auto", *given, *row["run"][1:])
            if "--landmarks" in row["run"]:
                found[name] = {"ate_m": ran["truth"]["ate_m"], "updates": ran["updates"], "landmarks": ran["landmarks"]}
                continue
            if given or row["run"][0] == "fuse-soccer":
                found[name] = _localised(ran)
                continue
            judged = pfcli("evaluate", f"{out}/run/track.tum", "--truth", log, "--true-map", str(HERE / f"{name}.yaml"))
        found[name] = {
            "ate_m": judged["truth"]["ate_m"],
            "heading_deg": judged["truth"]["heading_rmse_deg"],
            "iou": judged["map"]["iou"],
            "doubled_walls": judged["map"]["doubled_walls"],
            "updates": ran["updates"],
        }
    return found


def _localised(ran: dict[str, Any]) -> dict[str, float]:
    """Figures of a localiser: poses in the map's frame, and what the system says of itself."""
    found = {"median_m": ran["truth"]["median_m"], "updates": ran["updates"]}
    if "crossings" in ran:
        return found | {"crossings": len(ran["crossings"]), "in_map_at_end": ran["in_map_at_end"]}
    if "recoveries" in ran:
        return found | {"recoveries": len(ran["recoveries"]), "p_success_at_end": ran["p_success_at_end"]}
    since = ran["certain_since_s"]
    return found | {"max_m": ran["truth"]["max_m"], "certain_since_s": 1e9 if since is None else since}


def check() -> int:
    """Compare with golden.json; prints every figure, returns how many are off."""
    table = tomllib.loads((HERE / "samples.toml").read_text())
    golden = json.loads((HERE / "golden.json").read_text())
    off = 0
    for name, row in figures().items():
        for key, value in row.items():
            expected = golden[name][key]
            good = abs(value - expected) <= max(table["floor"][key], table["tolerance"] * abs(expected))
            off += not good
            print(f"{name} {key}: {value:.4f}, golden {expected:.4f}{'' if good else '  <-- OFF'}")
    return off


if __name__ == "__main__":
    task = sys.argv[1]
    if task == "samples":
        make(HERE)
    elif task == "golden":
        (HERE / "golden.json").write_text(json.dumps(figures(), indent=2) + "\n")
    else:
        sys.exit(1 if check() else 0)
