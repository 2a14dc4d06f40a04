"""`pfcli calibrate MAP LOG`."""

from pathlib import Path

import click

from pfcli.errors import LogError, UsageError
from pfcli.formats.atomic import check_file, output_file


@click.command()
@click.argument("map_file", metavar="MAP", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Where the classifier goes (.json).")
@click.option("--poses", type=click.IntRange(50, 1_000_000), default=5000, show_default=True, help="Simulated scans.")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True)
@click.option("--params", "params_file", type=click.Path(path_type=Path), help="Parameters of localize-reliable.")
@click.option("--topic", multiple=True, metavar="ROLE=TOPIC", help="Which topic plays a role, such as scan=/front.")
@click.option("--force", is_flag=True, help="Replace OUT.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
def calibrate(
    map_file: Path,
    log: Path,
    out: Path,
    poses: int,
    seed: int,
    params_file: Path | None,
    topic: tuple[str, ...],
    force: bool,
    as_json: bool,
) -> None:
    """Learn from MAP, by simulation, what scans of LOG's scanner look like where localisation succeeds and where it fails.

    localize-reliable learns so by itself, once for a map and a scanner, from fewer poses; a file fixes the decision.

    Example: pfcli calibrate map.yaml log.mcap --out classifier.json
    """
    check_file(out, force=force)
    from pfcli import registry
    from pfcli.cli.options import build_params, pairs
    from pfcli.cli.printing import emit
    from pfcli.formats.roles import ROLES
    from pfcli.replay import align
    from pfcli.replay.log import Log
    from pfcli.replay.settings import Settings
    from pfcli.rng import Purpose, rng_for
    from pfcli.runs import loop
    from pfcli.systems.localize_reliable import map_models, success_decision

    params = build_params(registry.system("localize-reliable").params, {}, params_file)
    settings = Settings(topics=pairs(topic, "--topic", tuple(ROLES)))
    opened = Log(log, settings)
    if opened.choose("scan") is None:
        raise UsageError(f"{log}: has no laser scans; map a topic with --topic scan=TOPIC")
    first = next(iter(align.bare(opened.events(["scan"]))), None)
    if first is None:
        raise LogError(f"{log}: holds no scan that can be read")
    if map_models.usable_scan(first, params) is None:
        raise LogError(f"{log}: its first scan has no usable beam (see max_range_m)")
    place = map_models.load(params, loop.Job(registry.system("localize-reliable"), params, [log], map=map_file))
    view = map_models.view_of(first, params)
    model = map_models.model_of(params, view.range_m)
    rng = rng_for(seed, Purpose.CALIBRATE, 0)
    found = success_decision.learn(place.free_xy, place.field, model, view, rng, poses)
    if not found.slope.any():
        raise LogError(
            f"{map_file}, {log}: too few simulated scans could be compared; is the map of that place, or too small?"
        )
    with output_file(out) as partial:
        success_decision.save(partial, found, place.digest)
    values = {"out": str(out), "accuracy": round(found.accuracy, 4), "poses": poses, "sensor": list(found.sensor)}
    emit(values, [f"{out}: tells success from failure in {found.accuracy:.1%} of held-out scans"], as_json)
