"""W501 in a run: a map whose grey of unknown cells is free, and the flag that mends it."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

from tests.conftest import SAMPLES


def test_a_map_of_an_old_map_saver_is_told_and_mended(
    pfcli: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    text = (SAMPLES / "partial-partial.yaml").read_text().replace("0.196", "0.25")
    (tmp_path / "old.yaml").write_text(text.replace("partial-partial.pgm", str(SAMPLES / "partial-partial.pgm")))
    words = (
        "localize-partial",
        SAMPLES / "partial.mcap",
        "--map",
        tmp_path / "old.yaml",
        "--initial",
        "inside",
        "--end",
        "8",
    )
    done = pfcli(*words, "--out", tmp_path / "a")
    assert done.returncode == 3, done.stderr
    assert "W501" in done.stderr
    assert "--unknown-grey 205" in done.stderr
    mended = pfcli(*words, "--out", tmp_path / "b", "--unknown-grey", "205")
    assert "W501" not in mended.stderr
    assert json.loads((tmp_path / "b/run.json").read_text())["findings"] == []
