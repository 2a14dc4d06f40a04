"""What every registered system must keep: bytes that repeat, no new compilation, declared parameters and rows."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pfcli import registry
from pfcli.params import build, fields, to_toml
from pfcli.replay.dead_reckoning import Drive

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
MAPS = {
    "localize-partial": SAMPLES / "partial-partial.yaml",
    "localize-lookup": SAMPLES / "four-rooms.yaml",
    "localize-reliable": SAMPLES / "kidnapped.yaml",
}
DRIVES = {"fuse-soccer": Drive("omni", None, (0.06,), arm_m=0.203, angle_deg=(45.0,))}
WHEELS = ["--wheel-radius-m", "0.1", "--track-width-m", "0.33"]
RUNS = {
    "slam-gdr-landmarks": ("landmarks", ["--end", "25", "--rejuvenate-steps", "40"]),
    "fuse-soccer": ("soccer", ["--end", "8", "--drive", str(SAMPLES / "soccer.toml")]),
    "slam-gdr": ("small-loop", ["--end", "50", "--particles", "6", "--resample-threshold", "0.9"]),
    "localize-lookup": ("four-rooms", ["--end", "25", "--map", str(MAPS["localize-lookup"]), *WHEELS]),
    "localize-reliable": ("kidnapped", ["--end", "30", "--map", str(MAPS["localize-reliable"])]),
    "localize-partial": ("partial", ["--end", "25", "--particles", "3000", "--map", str(MAPS["localize-partial"])]),
    "slam-gdr-smooth": ("small-loop", ["--end", "100", "--particles", "2"]),
}
COMMANDS = {"slam-gdr-landmarks": ("slam-gdr", "--landmarks"), "slam-gdr-smooth": ("slam-gdr", "--smooth")}
FILES = (
    "track.tum",
    "track.parquet",
    "metrics.parquet",
    "frames.parquet",
    "params.toml",
    "overlay.mcap",
)


@pytest.mark.parametrize("name", list(RUNS))
def test_the_same_command_gives_the_same_bytes_with_1_and_2_threads_and_again(
    name: str, sample: Callable[[str], Path], pfcli: Cli, tmp_path: Path
) -> None:
    log, words = RUNS[name]
    for out, threads in (("a", 1), ("b", 2), ("c", 2)):
        command = COMMANDS.get(name, (name,))
        done = pfcli(*command, sample(log), "--out", tmp_path / out, "--threads", threads, "--overlay", *words)
        assert done.returncode == 0, done.stderr
    maps = ("landmarks.csv",) if name == "slam-gdr-landmarks" else ("map.pgm", "map.yaml")
    for file in (*FILES, *maps):
        a, b, c = ((tmp_path / out / file).read_bytes() for out in "abc")
        assert a == b == c, file
    assert (tmp_path / "a" / "track.tum").read_bytes() != b""


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_another_seed_gives_another_track(name: str, sample: Callable[[str], Path], pfcli: Cli, tmp_path: Path) -> None:
    log, words = RUNS[name]
    for seed in (1, 2):
        pfcli(*COMMANDS.get(name, (name,)), sample(log), "--out", tmp_path / str(seed), "--seed", seed, *words)
    assert (tmp_path / "1/track.tum").read_bytes() != (tmp_path / "2/track.tum").read_bytes()


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_a_second_run_compiles_nothing(name: str, sample: Callable[[str], Path]) -> None:
    import numba.core.event as events

    from pfcli.replay.log import Settings
    from pfcli.runs import loop

    system = registry.system(name)
    job = loop.Job(
        system,
        build(system.params, {"particles": 5}, "test"),
        [sample(RUNS[name][0])],
        settings=Settings(end_s=20.0),
        map=MAPS.get(name),
        drive=DRIVES.get(name, Drive(radius_m=(0.1,), track_m=0.33)),
    )
    first = loop.execute(job)
    with events.install_recorder("numba:compile") as recorder:
        second = loop.execute(job)
    assert [e for _, e in recorder.buffer if e.is_start] == []
    assert np.array_equal(first.result.track.poses, second.result.track.poses, equal_nan=True)


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_parameters_are_declared_with_help_and_survive_toml(name: str) -> None:
    import tomllib

    params = registry.params_class(name)
    for field in fields(params):
        assert field.opt.help, field.name
        assert field.check(field.default, "default") == field.default
    assert build(params, tomllib.loads(to_toml(params())), "toml") == params()


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_the_paper_page_names_what_exists(name: str) -> None:
    import importlib
    import re

    package = Path(registry.SYSTEMS[name].split(":")[0].replace(".", "/")).parent
    root = Path(__file__).resolve().parents[2]
    text = (root / package / "PAPER.md").read_text()
    names = re.findall(r"`(pfcli(?:\.\w+)+)`", text)
    assert len(names) >= 5
    for full in names:
        module, attribute = full.rsplit(".", 1)
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError:
            pytest.fail(f"{full}: no such module")
        assert hasattr(found, attribute) or importlib.import_module(full), full
    for test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text):
        assert f"def {test[1]}" in (root / test[0]).read_text(), test
