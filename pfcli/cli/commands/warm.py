"""`pfcli warm [SYSTEM...]`."""

import click

from pfcli import registry
from pfcli.cli.printing import compiling, emit


@click.command()
@click.argument("systems", nargs=-1, type=click.Choice(list(registry.records())))
@click.option("--workers", type=click.IntRange(0, 1024), default=0, help="Processes that compile (default: all cores).")
def warm(systems: tuple[str, ...], workers: int) -> int:
    """Compile the kernels of some systems, or of all, so that no later run has to: for CI images and containers.

    They are kept in the cache folder (PFCLI_CACHE_DIR, else ~/.cache/pfcli).

    Example: pfcli warm slam-gdr localize-partial
    """
    from pfcli.runs.warm import ensure

    for name in systems or registry.records():
        with compiling() as say:
            count = ensure(registry.system(name), say, workers)
        emit({}, [f"{name}: {count} kernels compiled" if count else f"{name}: nothing to compile"], as_json=False)
    return 0
