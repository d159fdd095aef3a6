"""Checks that every frozen type and public function applies to the arrays it is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def frozen_array(
    values: ArrayLike, shape: tuple[int | None, ...], name: str, dtype: type = np.float64, finite: bool = True
) -> NDArray:
    """Copy `values` into a read-only array of `shape` (None: any length).

    Raises ValueError naming the expected and the given shape, or the first value that is not finite.
    """
    array = np.array(values, dtype=dtype)
    if array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True)):
        expected = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
    if finite and array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{name}: contains values that are not finite")
    array.setflags(write=False)
    return array
