"""Write man pages from the commands themselves: `python docs/manpages.py DIR` (`make man`)."""

import sys
from pathlib import Path

import click

from pfcli import __version__
from pfcli.cli.app import main

EXITS = ("0 done", "1 failed", "2 usage", "3 done, but part of the input was lost", "130 interrupted")


def escaped(text: str) -> str:
    """Text as roff prints it: no line is a request, no backslash an escape, a dash is a dash."""
    lines = (line.strip().replace("\\", "\\e").replace("-", "\\-") for line in text.splitlines())
    return "\n".join("\\&" + line if line[:1] in (".", "'") else line for line in lines)


def page(name: str, command: click.Command, context: click.Context) -> str:
    """The page `pfcli-NAME(1)`, or `pfcli(1)` for the group."""
    title = f"pfcli-{name}" if name else "pfcli"
    short = command.get_short_help_str(200)
    usage = " ".join(command.collect_usage_pieces(context))
    out = [f'.TH "{title.upper()}" 1 "" "pfcli {__version__}"', ".SH NAME", f"{escaped(title)} \\- {escaped(short)}"]
    out += [".SH SYNOPSIS", f".B pfcli {escaped(name)}", escaped(usage), ".SH DESCRIPTION"]
    for paragraph in (command.help or "").split("\n\n"):
        out += [".PP", escaped(paragraph)]
    out.append(".SH OPTIONS")
    for param in command.get_params(context):
        record = param.get_help_record(context) if isinstance(param, click.Option) else None
        if record is not None:
            out += [".TP", f".B {escaped(record[0])}", escaped(record[1])]
    if isinstance(command, click.Group):
        out.append(".SH COMMANDS")
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            assert found is not None
            out += [".TP", f".BR pfcli\\-{escaped(inner)} (1)", escaped(found.get_short_help_str(200))]
    out.append(".SH EXIT STATUS")
    for line in EXITS:
        code, _, meaning = line.partition(" ")
        out += [".TP", f".B {code}", escaped(meaning)]
    return "\n".join(out) + "\n"


def write(folder: Path) -> int:
    """Write a page for each command and one for `pfcli`; how many."""
    folder.mkdir(parents=True, exist_ok=True)
    context = click.Context(main, info_name="pfcli", terminal_width=100)
    pages = {"pfcli": page("", main, context)}
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        assert command is not None
        pages[f"pfcli-{name}"] = page(name, command, click.Context(command, info_name=name, parent=context))
    for title, text in pages.items():
        (folder / f"{title}.1").write_text(text)
    return len(pages)


if __name__ == "__main__":
    print(f"{write(Path(sys.argv[1]))} pages in {sys.argv[1]}")
