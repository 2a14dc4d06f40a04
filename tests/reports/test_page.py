"""The page of a run: from its own files only, whole, small, and alive in a browser."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli import registry
from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError
from pfcli.formats import map_yaml
from pfcli.reports import page
from tests.reports.runs import short_run

Sample = Callable[[str], Path]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.mark.parametrize("name", list(registry.records()))
def test_every_system_has_its_charts_and_a_small_page(name: str, tmp_path: Path) -> None:
    folder = short_run(name, tmp_path / "run")
    data = page.describe(folder)
    assert {c["title"] for c in data["charts"]} >= {
        c.title for c in registry.system(name).charts if c.table == "metrics"
    }
    assert data["charts"][-1]["title"] == "time of an update"
    assert data["truth"] is not None
    assert len(data["frames"]["t"]) > 3
    text = page.page(folder)
    assert len(text) < 3e6
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", text), "nothing from elsewhere"
    assert "'a b.mcap'" in data["command"]


def test_truth_is_drawn_in_the_frame_of_the_track(tmp_path: Path) -> None:
    """slam-gdr has a frame of its own: its truth is moved there, and lies as far from the track as the errors say."""
    data = page.describe(short_run("slam-gdr", tmp_path / "run"))
    track, truth = data["track"], data["truth"]
    off = np.hypot(np.subtract(track["x"], truth["x"]), np.subtract(track["y"], truth["y"]))
    assert np.allclose(off, track["error"], atol=2e-3)


def test_a_long_run_stays_small_and_keeps_its_extremes(tmp_path: Path) -> None:
    values = np.zeros(200_000)
    values[123_456] = 1.0
    kept = page._telling([values], "line")
    assert len(kept) <= page._CHART_POINTS
    assert 123_456 in kept
    side = 9000
    grid = GridMap(np.full((side, side), -1, np.int8), 0.05, map_yaml.Pose2(1.0, 2.0, 0.0))
    grid.cells[1000:8000, 1000:8000] = 0
    grid.cells[5000, 1000:8000] = 1
    layer = page._layer(grid, "map")
    assert len(layer["png"]) < 200_000
    assert layer["size"][0] * layer["cell"] == pytest.approx(side * 0.05, abs=layer["cell"])


def test_what_is_no_run_is_one_line(tmp_path: Path, pfcli: Callable[..., "subprocess.CompletedProcess[str]"]) -> None:
    with pytest.raises(LogError, match="not the folder of a run"):
        page.page(tmp_path)
    done = pfcli("report", tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert pfcli("report", tmp_path / "none").returncode == 2


@pytest.mark.parametrize(
    "broken",
    [
        lambda run, table: (run.pop("logs"), table),
        lambda run, table: (run.pop("span_s"), table),
        lambda run, table: (run.update(truth=[1]), table),
        lambda run, table: (None, table.slice(0, 0)),
        lambda run, table: (None, table.replace_schema_metadata({})),
        lambda run, table: (None, table.drop_columns(["x_m"])),
    ],
)
def test_half_a_run_is_one_line(broken: Any, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    folder = short_run("slam-gdr", tmp_path / "run")
    values, table = json.loads((folder / "run.json").read_text()), pq.read_table(folder / "track.parquet")
    _, table = broken(values, table)
    (folder / "run.json").write_text(json.dumps(values))
    pq.write_table(table, folder / "track.parquet")
    with pytest.raises(LogError, match="does not hold a whole run"):
        page.page(folder)


def test_names_from_a_log_are_text_and_nothing_else(tmp_path: Path) -> None:
    folder = short_run("slam-gdr", tmp_path / "run")
    values = json.loads((folder / "run.json").read_text())
    values["logs"] = ["@DATA@<script>alert(1).mcap"]
    (folder / "run.json").write_text(json.dumps(values))
    text = page.page(folder)
    assert "<script>alert" not in text
    assert "<h1>slam-gdr: @DATA@&lt;script&gt;alert(1).mcap" in text


_PROBE = """
<script>
const faults = [];
addEventListener("error", (event) => faults.push(event.message));
addEventListener("load", () => setTimeout(() => {
  const slider = document.getElementById("time"), before = document.body.dataset.pose;
  const painted = () => document.getElementById("map").toDataURL();
  const first = painted();
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  const moved = painted();
  document.querySelector("[data-zoom]").click();
  const map = document.getElementById("map");
  map.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowLeft", bubbles: true}));
  map.dispatchEvent(new PointerEvent("pointermove", {clientX: 300, clientY: 300, bubbles: true}));
  document.getElementById("theme").click();
  document.title = JSON.stringify({
    faults, before, after: document.body.dataset.pose, ready: document.body.dataset.ready,
    charts: document.querySelectorAll("#charts figure svg path, #charts figure svg polygon").length,
    redrawn: first !== moved, zoomed: moved !== painted(), theme: document.documentElement.dataset.theme,
    hover: document.getElementById("hover").textContent, rows: document.querySelectorAll("#details tr").length,
  });
}, 300));
</script>
"""


def in_browser(html: Path, *flags: str) -> tuple[str, str]:
    """The document after its scripts ran, and what the browser wrote."""
    assert CHROMIUM is not None
    words = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
        "--window-size=1200,900",
    ]
    done = subprocess.run(
        [*words, "--virtual-time-budget=3000", *flags, f"file://{html}"], capture_output=True, text=True, timeout=120
    )
    return done.stdout, done.stderr


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium; `apt-get install chromium` (CI does)")
@pytest.mark.parametrize("name", ["localize-partial", "slam-gdr-landmarks"])
def test_the_page_lives_in_a_browser(name: str, tmp_path: Path) -> None:
    folder = short_run(name, tmp_path / "run")
    path = tmp_path / "page.html"
    path.write_text(page.page(folder).replace("<head>", "<head>" + _PROBE, 1))
    document, said = in_browser(path, "--dump-dom")
    assert "CONSOLE" not in said, said
    title = re.search(r"<title>(.*?)</title>", document, re.S)
    assert title is not None
    found: dict[str, Any] = json.loads(title[1].replace("&quot;", '"').replace("&amp;", "&"))
    assert found["faults"] == []
    assert found["ready"] == "yes"
    assert found["after"] != found["before"]
    assert found["redrawn"]
    assert found["zoomed"]
    assert found["theme"] == "dark"
    assert found["charts"] >= 6
    assert found["rows"] > 20
    assert " m" in found["hover"]
