"""The summary of a batch for other readers: Markdown, JUnit XML, and GitHub's annotations."""

import math
import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

FORMATS = ("text", "markdown", "junit", "github")


def label(row: dict[str, Any]) -> str:
    """A group of jobs in words: system, log, and what the sweep varies."""
    return " ".join([row["system"], row["log"], *(f"{k}={v}" for k, v in row["point"].items())])


def judged(row: dict[str, Any], tolerance: float) -> str:
    """What became of a group of the baseline: missing, worse, better or same."""
    if row["missing"] or not row["seeds"]:
        return "missing"
    return "worse" if row["worse"] > tolerance else "better" if row["worse"] < -tolerance else "same"


def markdown(result: dict[str, Any], tolerance: float) -> str:
    """Tables of groups, changes and failures."""
    lines = [f"| {result['metric']} | n | mean | median | 95 % of the mean |", "|---|---|---|---|---|"]
    for row in result["groups"]:
        interval = f"{row['low']:.5g} .. {row['high']:.5g}" if row["n"] > 1 else "-"
        lines.append(f"| {_cell(label(row))} | {row['n']} | {row['mean']:.5g} | {row['median']:.5g} | {interval} |")
    if "changes" in result:
        lines += ["", "| against the baseline | verdict | before | now | change | seeds |", "|---|---|---|---|---|---|"]
        for row in result["changes"]:
            change = "" if math.isnan(row["worse"]) else f"{row['worse']:+.1%}"
            numbers = f"{row['old']:.5g} | {row['new']:.5g} | {change} | {row['seeds']}"
            lines.append(f"| {_cell(label(row))} | {judged(row, tolerance)} | {numbers} |")
    if result["failed"]:
        lines += ["", "| failed | seed | why |", "|---|---|---|"]
        lines += [f"| {_cell(label(row))} | {row['seed']} | {_cell(row['why'])} |" for row in result["failed"]]
    return "\n".join(lines) + "\n"


def junit(result: dict[str, Any], tolerance: float) -> str:
    """One test case per group and per failed job; what got worse, or is missing, is a failure."""
    suite = ElementTree.Element("testsuite", name="pfcli")
    changes = {label(row): row for row in result.get("changes", [])}
    count = failed = 0
    for row in [*result["groups"], *(row for name, row in changes.items() if judged(row, tolerance) == "missing")]:
        case = ElementTree.SubElement(suite, "testcase", classname=row["system"], name=label(row))
        change = changes.get(label(row))
        count += 1
        if change is not None and judged(change, tolerance) in ("worse", "missing"):
            failed += 1
            ElementTree.SubElement(case, "failure", message=_said(change, result["metric"], tolerance))
    for row in result["failed"]:
        name = f"{label(row)} seed {row['seed']}"
        case = ElementTree.SubElement(suite, "testcase", classname=row["system"], name=name)
        ElementTree.SubElement(case, "error", message=row["why"])
        count += 1
    suite.set("tests", str(count))
    suite.set("failures", str(failed))
    suite.set("errors", str(len(result["failed"])))
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def github(result: dict[str, Any], tolerance: float) -> str:
    """Annotations of what got worse or failed, on standard output; the tables go to the step summary, where there is one."""
    target = os.environ.get("GITHUB_STEP_SUMMARY")
    if target:
        with open(Path(target), "a") as out:
            out.write(markdown(result, tolerance))
    lines = [
        f"::error title=pfcli::{_said(row, result['metric'], tolerance)}"
        for row in result.get("changes", [])
        if judged(row, tolerance) in ("worse", "missing")
    ]
    lines += [f"::error title=pfcli::failed: {label(row)} seed {row['seed']}: {row['why']}" for row in result["failed"]]
    return "".join(line + "\n" for line in lines) or "::notice title=pfcli::nothing got worse\n"


def _said(row: dict[str, Any], metric: str, tolerance: float) -> str:
    if judged(row, tolerance) == "missing":
        return f"missing: {label(row)}: seeds {', '.join(map(str, row['missing']))} of the baseline have no number here"
    return (
        f"{judged(row, tolerance)}: {label(row)}: {metric} {row['old']:.5g} -> {row['new']:.5g} ({row['worse']:+.1%})"
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
