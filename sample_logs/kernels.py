"""Write `kernels.json` of every system: the kernels that runs of its sample log call, for `pfcli warm` and first runs.

python sample_logs/kernels.py            (make kernels)
python sample_logs/kernels.py KEY FILE   one system, in this process, whose cache has to be empty
"""

import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
MORE = {
    "slam-gdr": [["--end", "60", "--smooth"], ["--end", "30", "--variant", "paper"]],
    "slam-gdr-landmarks": [["--end", "25", "--smooth"], ["--end", "10", "--association", "unknown"]],
    "localize-partial": [[]],
    "localize-reliable": [[]],
    "localize-lookup": [[]],
    "fuse-soccer": [[]],
}
"""Runs beside the example: what else people do."""


def recorded(key: str) -> list[tuple[str, str, list[Any], float]]:
    """The kernels that Python calls in these runs, with their types and how long they took to compile."""
    import numba.core.event as event

    from pfcli import registry
    from pfcli.cli.app import main
    from pfcli.core import signatures

    found: list[tuple[str, str, list[Any], float]] = []
    begun: list[float] = []

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            begun.append(time.process_time())

        def on_end(self, event: Any) -> None:
            took = time.process_time() - begun.pop()
            kernel = event.data["dispatcher"].py_func
            if not begun and kernel.__module__.startswith("pfcli."):
                kinds = [signatures.to_json(kind) for kind in event.data["args"]]
                found.append((kernel.__module__, kernel.__qualname__, kinds, round(took, 1)))

    event.register("numba:compile", Listener())
    system = registry.system(key)
    assert system.example is not None
    options = [str(HERE / word) if (HERE / word).is_file() else word for word in system.example.options]
    given = ["--map", str(HERE / system.example.map)] if system.map else []
    with tempfile.TemporaryDirectory() as out:
        for more in ([], *MORE.get(key, [])):
            words = [*system.name.split(), str(HERE / system.example.log), *options, *given, *more]
            main.main([*words, "--out", f"{out}/run", "--force", "-q", "--threads", "1"], standalone_mode=False)
    return sorted(found, key=json.dumps)


def write() -> None:
    """The lists of all systems, each from a process with an empty cache."""
    from pfcli import registry

    for key, system in registry.records().items():
        package = Path(str(importlib.import_module(system.filter.split(":")[0]).__file__)).parent
        (package / "kernels.json").unlink(missing_ok=True)
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, __file__, key, str(package / "kernels.json")]
            subprocess.run(command, check=True, env=os.environ | {"PFCLI_CACHE_DIR": cache})


if __name__ == "__main__":
    if len(sys.argv) > 1:
        rows = ",\n".join(json.dumps(row) for row in recorded(sys.argv[1]))
        Path(sys.argv[2]).write_text(f"[\n{rows}\n]\n")
    else:
        write()
