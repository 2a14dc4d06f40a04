"""The same jobs on a Dask cluster (`pfcli-robotics[dask]`)."""

import hashlib
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import yaml

from pfcli.batches.job_records import Tally
from pfcli.batches.sweep import Task
from pfcli.batches.worker import CommandLine, fault, perform
from pfcli.errors import UsageError
from pfcli.formats.atomic import output_dir

_AHEAD = 4
"""Jobs handed over for each thread of the cluster."""
_ONE = threading.Lock()
"""A worker process has one replay at a time, whatever its threads: kernels set the number of threads of the process."""


def remote(
    cli: CommandLine, system: str, words: tuple[str, ...], record: dict[str, Any], files: dict[str, bytes]
) -> tuple[int, str, dict[str, bytes]]:
    """On a worker: run a job; its exit code, or why it failed, and the files of its folder. files: contents of those that the
    words name and that were sent."""
    with _ONE, tempfile.TemporaryDirectory(prefix="pfcli-") as folder:
        known = dict(_stored(files, Path(folder)))
        words = tuple(known.get(word, word) for word in words)
        try:
            code = perform(cli, system, words, record, Path(folder) / "run")
        except Exception as error:
            return 1, fault(error), {}
        return code, "", {path.name: path.read_bytes() for path in sorted((Path(folder) / "run").iterdir())}


def _stored(files: dict[str, bytes], folder: Path) -> Iterator[tuple[str, str]]:
    """Path on the sender's side -> path here, for what was sent; files of one folder stay beside each other."""
    for path, data in files.items():
        place = folder / hashlib.sha256(os.path.dirname(path).encode()).hexdigest()[:12] / os.path.basename(path)
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(data)
        yield path, str(place)


def run_dask(tasks: list[Task], tally: Tally, scheduler: str, cli: CommandLine, *, send: bool) -> None:
    """Run all jobs on the cluster at `scheduler`; what came of each is in the tally. A worker that is lost gives its jobs to
    others, as often as the scheduler allows (`distributed.scheduler.allowed-failures`). send: the workers do not see the files
    of this machine. Raises UsageError."""
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'pfcli-robotics[dask]'") from None
    try:
        client = Client(scheduler, timeout=3)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(f"--scheduler {scheduler}: nobody answers there ({fault(error)})") from None
    with client:
        sent: dict[str, Any] = {}

        def files(task: Task) -> dict[str, Any]:
            if not send:
                return {}
            named = [path for word in task.words if (path := Path(word)).is_absolute() and path.is_file()]
            whole = sorted({str(p) for path in named for p in (path, *_beside(path))})
            for name in whole:
                if name not in sent:
                    # a result, not scattered data: the scheduler makes it anew where a worker took it along
                    data = Path(name).read_bytes()
                    sent[name] = client.submit(bytes, data, key=f"pfcli-file-{hashlib.sha256(data).hexdigest()}")
            return {name: sent[name] for name in whole}

        def begun(task: Task) -> Any:
            of[(key := f"pfcli-{task.key}")] = task
            return client.submit(remote, cli, task.system, task.words, task.record(), files(task), key=key, pure=True)

        of: dict[str, Task] = {}
        queue = iter(tasks)
        count = max(1, sum(client.ncores().values())) * _AHEAD
        running = as_completed([begun(task) for task in islice(queue, count)])
        for future in running:
            task = of.pop(future.key)
            try:
                code, why, contents = future.result()
            except Exception as error:
                code, why, contents = 1, fault(error), {}
            if why:
                tally.fail(task, why)
            else:
                with output_dir(tally.target(task), force=True) as folder:
                    for name, data in contents.items():
                        (folder / name).write_bytes(data)
                tally.succeed(task, code)
            future.release()
            for task in islice(queue, 1):
                running.add(begun(task))


def _beside(path: Path) -> Iterator[Path]:
    """The picture that a map's YAML names."""
    if path.suffix in (".yaml", ".yml"):
        with suppress(OSError, yaml.YAMLError, AttributeError, TypeError):
            image = path.parent / yaml.safe_load(path.read_text()).get("image")
            if image.is_file():
                yield image
