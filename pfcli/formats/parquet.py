"""Parquet tables with units in the field metadata and what determines them in the file metadata."""

import json
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pfcli.errors import LogError, reason
from pfcli.formats.atomic import output_file

_UNITS = (
    ("_ns", "ns"),
    ("_m2", "m^2"),
    ("_rad2", "rad^2"),
    ("_mrad", "m rad"),
    ("_rad", "rad"),
    ("_m", "m"),
    ("_s", "s"),
)


def unit_of(name: str) -> str:
    """Unit of a column, from the suffix of its name."""
    return next((unit for suffix, unit in _UNITS if name.endswith(suffix)), "1")


def table(columns: Mapping[str, Any], provenance: Mapping[str, object]) -> pa.Table:
    """Columns (arrays of equal length) as a table: units in the fields' metadata, `provenance` in that of the table."""
    fields, arrays = [], []
    for name, values in columns.items():
        array = values if isinstance(values, pa.Array) else pa.array(values)
        fields.append(pa.field(name, array.type, metadata={"unit": unit_of(name)}))
        arrays.append(array)
    schema = pa.schema(fields, metadata={"pfcli": json.dumps(provenance, sort_keys=True)})
    return pa.Table.from_arrays(arrays, schema=schema)


def write(path: Path, columns: Mapping[str, Any], provenance: Mapping[str, object]) -> None:
    """Write columns (arrays of equal length) with `provenance` as the file metadata `pfcli`."""
    pq.write_table(table(columns, provenance), path, compression="zstd", version="2.6")


_KINDS = {"text": pa.string(), "int": pa.int64(), "float": pa.float64()}


@contextmanager
def rows_writer(path: Path, kinds: Mapping[str, str]) -> Iterator[Callable[[Sequence[Mapping[str, Any]]], None]]:
    """What writes rows, some at a time, into a table with columns of these kinds (text, int, float); a row may lack some. The
    file appears when the block ends without an error. Raises OutputError."""
    schema = pa.schema([pa.field(name, _KINDS[kind], metadata={"unit": unit_of(name)}) for name, kind in kinds.items()])
    with (
        output_file(path) as partial,
        pq.ParquetWriter(partial, schema, compression="zstd", version="2.6") as out,
    ):

        def write_rows(rows: Sequence[Mapping[str, Any]]) -> None:
            out.write_batch(pa.RecordBatch.from_pylist([dict(row) for row in rows], schema))

        yield write_rows


def columns_of(rows: Sequence[Any], kind: type) -> dict[str, Any]:
    """Columns of NamedTuple rows; the annotations of `kind` are the schema."""
    hints = typing.get_type_hints(kind)
    found: dict[str, Any] = {}
    for k, (name, hint) in enumerate(hints.items()):
        optional = isinstance(hint, types.UnionType)
        base = next(t for t in typing.get_args(hint) if t is not type(None)) if optional else hint
        dtype = {int: pa.int64(), float: pa.float64(), str: pa.string(), bool: pa.bool_()}[base]
        found[name] = pa.array([row[k] for row in rows], dtype)
    return found


def rows(path: Path) -> Iterator[dict[str, Any]]:
    """Rows of a table, None where one has no value, some thousand in memory at a time."""
    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(4096):
            yield from batch.to_pylist()


def read(path: Path) -> dict[str, Any]:
    """Columns of a table as numpy arrays (strings as lists)."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise LogError(f"{path}: cannot be read as Parquet ({reason(error)})") from None
    return {
        name: column.to_pylist() if pa.types.is_string(column.type) else np.asarray(column)
        for name, column in zip(table.column_names, table.columns, strict=True)
    }


def provenance(path: Path) -> dict[str, Any]:
    """The file metadata `pfcli` of a table."""
    metadata = pq.read_schema(path).metadata or {}
    found: dict[str, Any] = json.loads(metadata.get(b"pfcli", b"{}"))
    return found
