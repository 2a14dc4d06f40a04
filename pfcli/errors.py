"""Foreseen failures. Each is one line that names the file, the topic or the field, and the way out."""

EXIT_DONE = 0
EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_PARTIAL = 3
EXIT_NOT_PASSED = 4
EXIT_INTERRUPTED = 130


class PfcliError(Exception):
    """A failure that the user can understand and mend; printed as one line, exit code 1."""

    exit_code = EXIT_FAILED


class UsageError(PfcliError):
    """Flags, parameters or topics that do not fit together; exit code 2."""

    exit_code = EXIT_USAGE


class LogError(PfcliError):
    """A log (or another input file) that cannot be used."""


class FilterDegenerate(PfcliError):
    """Every particle has weight zero: the model cannot explain the reading at all."""


class OutputError(PfcliError):
    """Results that cannot be written."""


def printable(text: str) -> str:
    """Text from a file, with control characters escaped, so that a message stays one line."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def reason(error: BaseException) -> str:
    """What an operating system or library error says, in one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return printable(" ".join(str(error).split()))[:200] or type(error).__name__
