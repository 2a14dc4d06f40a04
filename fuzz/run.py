"""Coverage-guided fuzzing: `python fuzz/run.py SECONDS [TARGET ...]`, all targets one after the other by default.

Kernels run as plain Python: so their branches count as coverage, and a look beyond an array is an error.
A finding is kept as fuzz/found/TARGET-...; as a regression test it moves to tests/fuzz/found/TARGET/.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST_S, MOST_MIB = 5, 2048


def fuzz(target: str, seconds: int, corpus: str) -> None:
    """Fuzz one target in this process; ends it."""
    import atheris

    with atheris.instrument_imports(include=["pfcli", "fuzz"]):
        from fuzz import corpus as seeds
        from fuzz import targets

    for k, data in enumerate(seeds.seeds(target)):
        (Path(corpus) / f"seed-{k}").write_bytes(data)
        targets.check(target, data)  # compiles kernels, which must not count as a hang
    found = ROOT / "fuzz" / "found"
    found.mkdir(exist_ok=True)
    flags = [f"-max_total_time={seconds}", f"-timeout={LONGEST_S}", f"-rss_limit_mb={MOST_MIB}", "-max_len=65536"]
    atheris.Setup(
        [sys.argv[0], *flags, f"-artifact_prefix={found}/{target}-", corpus], lambda d: targets.check(target, d)
    )
    atheris.Fuzz()


def main() -> int:
    if sys.argv[1] == "--one":
        sys.path.insert(0, str(ROOT))
        fuzz(sys.argv[2], int(sys.argv[3]), sys.argv[4])
        return 0
    sys.path.insert(0, str(ROOT))
    from fuzz.targets import TARGETS

    bad = []
    for target in sys.argv[2:] or TARGETS:
        with tempfile.TemporaryDirectory() as corpus:
            words = [sys.executable, __file__, "--one", target, sys.argv[1], corpus]
            plain = os.environ | {"NUMBA_DISABLE_JIT": "1"}
            done = subprocess.run(words, capture_output=True, text=True, env=plain)
        tail = [line for line in done.stderr.splitlines() if line.strip()]
        print(f"{target}: {'no finding' if done.returncode == 0 else 'FOUND'}; {tail[-1] if tail else ''}", flush=True)
        if done.returncode:
            bad.append(target)
            print("\n".join([*done.stdout.splitlines()[-20:], *tail[-20:]]), flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
