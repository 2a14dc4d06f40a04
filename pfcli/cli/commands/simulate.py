"""`pfcli simulate SCENARIO OUT`."""

from pathlib import Path

import click

from pfcli.formats.atomic import check_file


@click.command()
@click.argument("scenario")
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of noise, slips and people."
)
@click.option("--true-map", is_flag=True, help="Also write the true map as TARGET's name + .yaml and .pgm.")
@click.option(
    "--partial-map",
    is_flag=True,
    help="Also write the part of it that the robot is given, as TARGET's name + -partial.yaml.",
)
@click.option("--force", is_flag=True, help="Replace TARGET.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
def simulate(
    scenario: str, target: Path, seed: int, true_map: bool, partial_map: bool, force: bool, as_json: bool
) -> None:
    """Write a log of SCENARIO (a name, a TOML file with its fields, or a JSON world of landmarks) with truth to TARGET (.mcap).

    `pfcli simulate list -` prints the names. Example: pfcli simulate office office.mcap --seed 3
    """
    from pfcli.simulation import catalogue

    if scenario == "list":
        for name, known in catalogue.all_scenarios().items():
            click.echo(f"{name:<18} {catalogue.described(known)}")
        return
    check_file(target, force=force)
    from pfcli.cli.printing import emit

    found = catalogue.load(scenario)
    counts = catalogue.write(found, seed, target)
    if true_map:
        catalogue.write_map(found, target.parent, target.stem)
    if partial_map:
        catalogue.write_partial_map(found, target.parent, f"{target.stem}-partial")
    what = "frames" if "frames" in counts else "scans"
    line = f"{target}: {counts[what]} {what}, {counts['way_m']:.1f} m in {counts['span_s']:.0f} s"
    emit({"out": str(target), "scenario": found.name, "seed": seed, **counts}, [line], as_json)
