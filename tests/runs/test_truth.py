"""Runs against truth of any kind."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.core.geometry import compose
from pfcli.formats import tum


def test_an_antenna_is_judged_where_it_sits_and_in_position_only(
    sample: Callable[[str], Path], pfcli: Any, tmp_path: Path
) -> None:
    """Positions of an antenna 0.5 m ahead and 0.2 m to the left of a track are that track's, with the lever."""
    first = pfcli("slam-gdr", sample("small-loop"), "--end", "60", "--out", tmp_path / "a")
    assert first.returncode == 0, first.stderr
    stamps, poses = tum.read(tmp_path / "a" / "track.tum")
    antenna = compose(poses, np.array([[0.5, 0.2, 0.0]]))
    rows = [f"{t} {x} {y}" for t, (x, y, _) in zip((stamps / 1e9).tolist(), antenna.tolist(), strict=True)]
    (tmp_path / "gps.txt").write_text("\n".join(rows))
    found = []
    for lever in ([], ["--truth-lever", "0.5,0.2"]):
        done = pfcli(
            "slam-gdr", sample("small-loop"), "--end", "60", "--truth", tmp_path / "gps.txt", *lever, "--json",
            "--out", tmp_path / f"b{len(lever)}",
        )  # fmt: skip
        found.append(json.loads(done.stdout)["truth"])
    assert found[0]["ate_m"] > 0.05
    assert found[1]["ate_m"] < 1e-3
    assert found[1]["heading_rmse_deg"] is None
    plain = pfcli("slam-gdr", sample("small-loop"), "--truth-lever", "0.5", "--out", tmp_path / "c")
    assert "--truth-lever 0.5: expected X,Y" in plain.stderr
