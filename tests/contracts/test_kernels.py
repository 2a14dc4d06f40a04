"""What kernels must not do, by their source."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "pfcli"
KERNELS = {"kernel", "inline_kernel", "reduction_kernel"}


def _copies(function: ast.FunctionDef) -> list[int]:
    """Lines of assignments of something other than a number to a whole array."""
    found = []
    for node in ast.walk(function):
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            pairs = (
                zip(target.elts, node.value.elts, strict=False)
                if _tuples(target, node.value)
                else [(target, node.value)]
            )
            found += [node.lineno for left, right in pairs if _whole(left) and not isinstance(right, ast.Constant)]
    return found


def _tuples(left: ast.expr, right: ast.expr) -> bool:
    return isinstance(left, ast.Tuple) and isinstance(right, ast.Tuple)


def _whole(target: ast.expr) -> bool:
    return isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice)


def test_kernels_copy_arrays_with_put() -> None:
    """`a[:] = b` in a kernel adds three seconds to the first run ever (`pfcli.core.jit.put`). Rows, `a[k] = b`, do as well,
    but look like numbers here."""
    bad = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and KERNELS & {
                d.id for d in node.decorator_list if isinstance(d, ast.Name)
            }:
                bad += [f"{path.relative_to(PACKAGE)}:{line}" for line in _copies(node)]
    assert not bad
