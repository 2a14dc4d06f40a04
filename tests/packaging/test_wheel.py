"""What is in the wheel: an installation from it must have all that a checkout has."""

import zipfile
from configparser import ConfigParser
from importlib.metadata import requires
from pathlib import Path

from tests.packaging.wheels import ROOT, built


def test_the_wheel_holds_the_package_with_all_its_files_and_nothing_else(tmp_path: Path) -> None:
    with zipfile.ZipFile(built(ROOT, tmp_path)) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
        (points,) = (wheel.read(name).decode() for name in wheel.namelist() if name.endswith("entry_points.txt"))
    package = {str(p.relative_to(ROOT)) for p in (ROOT / "pfcli").rglob("*") if p.is_file()}
    schemas = {f"pfcli/schemas/{p.name}" for p in (ROOT / "schemas").iterdir()}
    assert names == {name for name in package if "__pycache__" not in name} | schemas
    found = ConfigParser()
    found.optionxform = str  # type: ignore[assignment,method-assign]
    found.read_string(points)
    assert {"console_scripts", "pfcli.systems", "pfcli.resamplers"} <= set(found.sections())


def test_the_distribution_is_named_so_that_no_other_pfcli_is_meant() -> None:
    assert any("distributed" in line for line in requires("pfcli-robotics") or ())
    for page in ("README.md", "docs/batch.md", "pfcli/batches/dask_cluster.py"):
        assert "'pfcli[" not in (ROOT / page).read_text(), page
