"""What a run gives to Python: tables, maps, errors and a picture; `save` writes the files of the command."""

import base64
import html
import shlex
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pfcli.core.grid.grid_map import GridMap
from pfcli.findings import Finding
from pfcli.formats import parquet
from pfcli.formats.atomic import check_picture, output_dir
from pfcli.reports import overlay as overlays
from pfcli.reports import page, run_picture
from pfcli.runs import loop, results
from pfcli.systems.shared.contract import Result

if TYPE_CHECKING:
    from pfcli.core.evaluation.track_error import Errors

_SHOWN = ("scans", "span_s", "way_m", "updates", "ms_per_update")


class DoubtfulResult(UserWarning):
    """Part of the input was left out, or the result may be wrong: where the command ends with exit code 3."""


class FinishedRun:
    """A run of a system. `pfcli.run` makes it.

    result: as the system gave it; errors: against truth, per pose, where truth was asked for; findings: what was noticed.
    """

    def __init__(self, job: loop.Job, done: loop.Run) -> None:
        self._job = job
        self._done = done
        self.result: Result = done.result
        self.errors: Errors | None = done.errors
        self.findings: Sequence[Finding] = done.findings

    @cached_property
    def tables(self) -> Mapping[str, Any]:
        """Every table (pyarrow.Table) by the name of its file; the metadata of a field has its unit."""
        about = results.provenance(self._job)
        return {name: parquet.table(columns, about) for name, columns in results.tables(self._job, self._done).items()}

    @property
    def track(self) -> Any:
        """Pose of every scan (pyarrow.Table): `t_ns`, `x_m`, `y_m`, `yaw_rad`, covariances, errors where truth is known."""
        return self.tables["track"]

    @property
    def metrics(self) -> Any:
        """One row for each update (pyarrow.Table)."""
        return self.tables["metrics"]

    @property
    def grid(self) -> GridMap | None:
        """The map that was built or localised in; None where there is none."""
        return self.result.grid

    @property
    def layers(self) -> Mapping[str, GridMap]:
        """More maps by name."""
        return self.result.layers

    @property
    def params(self) -> Any:
        """The parameters of the run."""
        return self._job.params

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What `run.json` holds: counts, the system's own figures, errors, findings, times."""
        return results.summarize(self._job, self._done)

    @property
    def command(self) -> str:
        """The command that gives the same result."""
        return shlex.join(self._job.command)

    def save(self, folder: str | Path, *, force: bool = False, overlay: bool = False, report: bool = False) -> Path:
        """Write the files that the command writes, the same bytes but for the times in `run.json`. Returns the folder.

        force: replace a folder that is not empty; overlay, report: also `overlay.mcap`, `report.html`. Raises OutputError.
        """
        target = Path(folder)
        job = self._job._replace(command=(*self._job.command, f"--out={target}"))
        with output_dir(target, force=force) as made:
            results.write(made, job, self._done)
            if overlay:
                overlays.write(made / "overlay.mcap", self.result)
            if report:
                page.write(made, made / "report.html")
        return target

    def plot(self, path: str | Path) -> Path:
        """Draw map and track into a PNG, SVG or PDF. Raises OutputError."""
        check_picture(Path(path))
        run_picture.write(Path(path), self._job, self._done)
        return Path(path)

    def __repr__(self) -> str:
        found = self.summary
        return f"<{found['system']}: {found['scans']} {self._job.system.readings}, {found['updates']} updates>"

    def _repr_png_(self) -> bytes:
        return run_picture.png(self._job, self._done)

    def _repr_html_(self) -> str:
        truth = self.summary.get("truth", {})
        shown = {name: self.summary[name] for name in _SHOWN} | {k: truth[k] for k in ("ate_m",) if k in truth}
        rows = "".join(f"<tr><th>{html.escape(k)}</th><td>{html.escape(str(v))}</td></tr>" for k, v in shown.items())
        notes = "".join(f"<p>{html.escape(finding.line)}</p>" for finding in self.findings)
        picture = base64.b64encode(self._repr_png_()).decode()
        alt = f"map and track of {self._job.system.name}"
        return (
            f"<p><code>{html.escape(self.command)}</code></p><table>{rows}</table>{notes}"
            f'<img style="max-width: 100%; width: 640px" alt="{alt}" src="data:image/png;base64,{picture}">'
        )
