"""Arrow's columns from numpy's arrays and back, by their memory.

pyarrow's own ways ask for pandas first, whose import takes a quarter of a second of every command that reads a file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.quoting import as_text


def to_array(values: NDArray[Any]) -> Any:
    """`pyarrow.Array` of numbers, yes and no, or text (n,); what pyarrow makes of other values."""
    import pyarrow as pa

    if values.dtype.kind in "iuf" and values.dtype.isnative and values.dtype.itemsize > 1:
        held = np.ascontiguousarray(values)
        return pa.Array.from_buffers(pa.from_numpy_dtype(held.dtype), len(held), [None, pa.py_buffer(held)])
    if values.dtype == bool:
        bits = pa.py_buffer(np.packbits(values, bitorder="little"))
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, bits])
    if values.dtype.kind == "U" or (values.dtype == object and all(type(value) is str for value in values)):
        try:
            texts = [text.encode() for text in values.tolist()]
        except UnicodeEncodeError:
            texts = [as_text(text).encode() for text in values.tolist()]
        ends = np.cumsum([0, *map(len, texts)])
        if ends[-1] <= np.iinfo(np.int32).max:
            offsets, whole = pa.py_buffer(ends.astype(np.int32)), pa.py_buffer(b"".join(texts))
            return pa.Array.from_buffers(pa.string(), len(texts), [None, offsets, whole])
    return pa.array(values)


def to_numpy(column: Any) -> NDArray[Any]:
    """Values of a `pyarrow.ChunkedArray`, as its own `to_numpy` gives them: a number that is missing is NaN."""
    import pyarrow as pa

    kind = column.type
    whole, broken = pa.types.is_integer(kind), kind in (pa.float32(), pa.float64())
    if not (whole or broken):
        return np.asarray(column.to_numpy())
    if column.null_count:
        import pyarrow.compute as pc

        kind = pa.float64() if whole else kind
        column = pc.fill_null(column.cast(kind), pa.scalar(np.nan, kind))
    dtype = np.dtype(kind.to_pandas_dtype())
    parts = [
        np.frombuffer(chunk.buffers()[1], dtype, len(chunk), chunk.offset * dtype.itemsize)
        for chunk in column.chunks
        if len(chunk)
    ]
    return parts[0] if len(parts) == 1 else np.concatenate([np.empty(0, dtype), *parts])
