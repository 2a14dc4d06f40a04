"""`python -m pfcli`."""

from pfcli.cli.app import run

if __name__ == "__main__":
    run()
