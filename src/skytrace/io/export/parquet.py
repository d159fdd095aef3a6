"""Parquet: the columns of the CSV for pandas, polars, DuckDB and R. Needs pyarrow, which is an extra."""

from __future__ import annotations

import io
from datetime import UTC, datetime

import numpy as np

from skytrace.errors import InputError
from skytrace.io.export.columns import columns, remarks
from skytrace.io.export.content import ExportRun, Format


def write_parquet(run: ExportRun) -> bytes:
    """The bytes of a Parquet file; what is not known is null, `time_utc` a timestamp in UTC.

    What the CSV says in its `#` lines stands in the schema's metadata, under "skytrace.KEY". Raises InputError where
    pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "parquet", "needs the package pyarrow: pip install 'skytrace[parquet]', or export to csv"
        ) from None
    arrays = {name: _array(pyarrow, name, values) for name, values in columns(run).items()}
    metadata = {f"skytrace.{key.replace(' ', '_')}": text for key, text in remarks(run).items()}
    table = pyarrow.table(arrays).replace_schema_metadata(metadata)
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _array(pyarrow, name: str, values):
    if name == "time_utc":
        instants = [datetime.fromisoformat(text).astimezone(UTC) for text in values]
        return pyarrow.array(instants, pyarrow.timestamp("us", "UTC"))
    if values.dtype.kind == "i":
        return pyarrow.array(values, pyarrow.int32())
    return pyarrow.array(values, mask=~np.isfinite(values))


FORMAT = Format(
    "parquet", ".parquet", "the columns of csv in binary, for pandas and DuckDB", write_parquet, gaps="allowed"
)
