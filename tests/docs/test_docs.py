"""Documentation that runs and stays current."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


def test_the_command_reference_is_current() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "docs/generate.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_the_readme_has_exactly_two_set_up_commands_and_ci_runs_the_second() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    set_up = [b.strip() for b in blocks if "venv" in b]
    assert len(set_up) == 2
    assert "sample_logs/" in set_up[0]
    assert all("\n" not in b for b in set_up)
    assert "README.md" in (ROOT / ".ci/run").read_text()


def test_python_examples_run(tmp_path: Path, pfcli: object, sample: object) -> None:
    (tmp_path / "schemas").symlink_to(ROOT / "schemas")
    done = pfcli("slam-gdr", sample("small-loop"), "--end", 5, "--out", tmp_path / "out/small-loop")  # type: ignore[operator]
    assert done.returncode == 0, done.stderr
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/formats.md").read_text(), re.S)
    assert len(blocks) == 2
    for block in blocks:
        ran = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
    assert "/odom" in pfcli("info", tmp_path / "robot.mcap").stdout  # type: ignore[operator]


def test_the_shell_examples_of_batches_run(tmp_path: Path) -> None:
    for name in ("sample_logs", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    page = (ROOT / "docs/batch.md").read_text()
    sweep = re.search(r"```toml\n# docs/batch/sweep.toml\n(.*?)```", page, re.S)
    assert sweep is not None
    assert tomllib.loads(sweep[1]) == tomllib.loads((ROOT / "docs/batch/sweep.toml").read_text())
    blocks = re.findall(r"```sh\n(.*?)```", page, re.S)
    assert len(blocks) == 3
    if shutil.which("jq") is None:
        pytest.skip("jq is not there")
    script = f'set -euo pipefail\npfcli() {{ {sys.executable} -m pfcli "$@"; }}\nexport -f pfcli\n'
    script += "\n".join(blocks).replace("xargs -P 2 -I {} pfcli", "xargs -P 2 -I {} bash -c 'pfcli \"$@\"' -")
    ran = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "4 of 4 jobs done" in ran.stdout
    assert (tmp_path / "out/one/landmarks.csv").is_file()


def test_the_files_for_clusters_are_well_formed() -> None:
    gate = yaml.safe_load((ROOT / "docs/batch/gate.yml").read_text())
    assert gate["jobs"]["compare"]["needs"] == "sweep"
    checked = subprocess.run(["sh", "-n", ROOT / "docs/batch/array.slurm"], capture_output=True, check=False)
    assert checked.returncode == 0


def test_every_metric_of_a_run_is_declared_with_a_known_unit() -> None:
    from pfcli import registry
    from pfcli.formats.parquet import unit_of

    for system in registry.records().values():
        for name in registry.filter_of(system).info._fields:
            assert unit_of(name) in {"ns", "m", "s", "rad", "1", "m^2", "rad^2"}, name


@pytest.mark.parametrize("page", sorted(p.name for p in (ROOT / "docs/decisions").glob("*.md")))
def test_decisions_are_short(page: str) -> None:
    assert len((ROOT / "docs/decisions" / page).read_text().splitlines()) <= 16


def test_links_inside_the_tree_lead_somewhere() -> None:
    for page in [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("benchmarks/*.md"),
        *ROOT.glob("pfcli/**/*.md"),
    ]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_proofs_of_the_reliability_page_exist() -> None:
    text = (ROOT / "docs/reliability.md").read_text()
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    assert len(named) > 25
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(), f"{file}::{test}"
    for file in re.findall(r"`((?:benchmarks|pfcli)/[\w/]+\.py)`", text):
        assert (ROOT / file).is_file(), file


def test_man_pages_of_every_command_format_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs/manpages.py"), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    pages = sorted(tmp_path.glob("*.1"))
    assert len(pages) > 15
    if shutil.which("groff") is None:
        pytest.skip("groff is not there")
    for page in pages:
        shown = subprocess.run(
            ["groff", "-ww", "-man", "-Tutf8", str(page)], capture_output=True, text=True, check=True
        )
        assert shown.stderr == "", page.name
        assert "EXIT STATUS" in re.sub(r".\x08|\x1b\[[0-9;]*m", "", shown.stdout)


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in SYSTEM_PAGES:
        text = (tmp_path / "site/systems" / f"{name}.html").read_text()
        assert "Reported number" in text, "the paper's tables are on the page"


def test_every_system_has_a_page_whose_tutorial_is_run_with_its_sample_log() -> None:
    """The commands of the tutorials are those that the golden figures are taken from (tests/golden)."""
    samples = tomllib.loads((ROOT / "sample_logs/samples.toml").read_text())
    for name, sample in SYSTEM_PAGES.items():
        (block,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/systems" / f"{name}.md").read_text(), re.S)
        words, row = block.split(), samples[sample]
        assert words[:2] == ["pfcli", row["run"][0]]
        assert words[2] == f"sample_logs/{sample}.mcap"
        if "map" in row:
            assert f"sample_logs/{row['map']}" in words
        assert block.replace("sample_logs/", "") in (ROOT / "README.md").read_text().replace("sample_logs/", "")


SYSTEM_PAGES = {
    "slam-gdr": "small-loop",
    "slam-gdr-landmarks": "landmarks",
    "localize-partial": "partial",
    "localize-reliable": "kidnapped",
    "localize-lookup": "four-rooms",
    "fuse-soccer": "soccer",
}
