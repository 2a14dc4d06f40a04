"""Argument types of kernels as JSON, so that a list of them can be kept and compiled before they are first called."""

import importlib
from typing import Any

from numba import types

_NAMED = (types.NamedTuple, types.NamedUniTuple)
_TUPLES = (types.Tuple, types.UniTuple)


def to_json(kind: Any) -> Any:
    """A numba type as text, list or mapping. Raises TypeError for one that no argument of a kernel has."""
    if isinstance(kind, types.Array):
        return {"array": to_json(kind.dtype), "ndim": kind.ndim, "layout": kind.layout, "readonly": not kind.mutable}
    if isinstance(kind, _NAMED):
        cls = kind.instance_class
        return {"named": f"{cls.__module__}:{cls.__qualname__}", "of": [to_json(t) for t in kind.types]}
    if isinstance(kind, _TUPLES):
        return [to_json(t) for t in kind.types]
    if isinstance(kind, types.Omitted):
        return {"omitted": kind.value}
    name = "boolean" if kind == types.boolean else str(kind)
    if kind == types.npy_rng:
        return "npy_rng"
    if getattr(types, name, None) == kind:
        return name
    raise TypeError(f"{kind}: no type that can be kept")


def from_json(data: Any) -> Any:
    """The numba type again. Raises whatever a list that is not of this version of pfcli makes of it."""
    if isinstance(data, str):
        return getattr(types, data)
    if isinstance(data, list):
        return types.Tuple([from_json(t) for t in data])
    if "omitted" in data:
        return types.Omitted(data["omitted"])
    if "array" in data:
        return types.Array(from_json(data["array"]), data["ndim"], data["layout"], readonly=data["readonly"])
    module, name = data["named"].split(":")
    cls = getattr(importlib.import_module(module), name)
    members = [from_json(t) for t in data["of"]]
    if members and all(t == members[0] for t in members):
        return types.NamedUniTuple(members[0], len(members), cls)
    return types.NamedTuple(members, cls)
