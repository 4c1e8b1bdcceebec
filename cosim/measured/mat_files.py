"""Workspaces of MATLAB: MAT v5 by SciPy, v7.3 by h5py."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cosim.measured.columns import Column, DataTable, listed
from driveline.quantities import InputError

_Contents = np.ndarray | Mapping[str, Any]  # of a variable of a workspace: numbers, or the fields of a struct


def read_mat(path: Path) -> DataTable:
    import scipy.io

    try:
        arrays = {name: values for name, values in scipy.io.loadmat(path).items() if not name.startswith("__")}
    except NotImplementedError:
        return _read_mat_hdf5(path)
    except Exception as error:  # scipy raises many kinds for a damaged file
        raise InputError(f"{path} is not a readable MAT file: {_in_short(error)}") from error
    return _from_arrays(path, {name: _opened(values) for name, values in arrays.items()})


def _opened(values: np.ndarray) -> _Contents:
    """A struct of MAT v5 as its fields, all else as it is."""
    if values.dtype.names and values.size == 1:
        return {name: values[name].flat[0] for name in values.dtype.names}
    return values


def _read_mat_hdf5(path: Path) -> DataTable:
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path}: MAT files of version 7.3 need the package h5py, pip install "
                         "'driveline-cosim[measured]'") from error

    def holds_numbers(node: h5py.Dataset) -> bool:
        # a text is stored as the numbers of its letters, an object (datetime, string) as that of its place elsewhere
        return (node.attrs.get("MATLAB_class") not in (b"char", "char") and "MATLAB_object_decode" not in node.attrs
                and "MATLAB_empty" not in node.attrs)  # of an empty array its shape is stored

    def vectors(group: h5py.Group) -> dict[str, np.ndarray]:
        return {name: node[()] for name, node in group.items()
                if isinstance(node, h5py.Dataset) and holds_numbers(node)}

    try:
        with h5py.File(path) as file:
            arrays: dict[str, _Contents] = {
                name: vectors(node) for name, node in file.items()
                if isinstance(node, h5py.Group) and not name.startswith("#")}  # MATLAB's own store of cells
            arrays |= vectors(file)
    except Exception as error:  # of many kinds for a damaged file
        raise InputError(f"{path} is not a readable MAT file: {_in_short(error)}") from error
    return _from_arrays(path, arrays)


def _from_arrays(path: Path, contents: Mapping[str, _Contents]) -> DataTable:
    """The vectors among the variables of a workspace, or, where there is none but one struct, among its fields."""
    structs = {name: of for name, of in contents.items() if isinstance(of, Mapping)}
    vectors = _vectors(contents)
    if not vectors and len(structs) == 1:
        vectors = _vectors(*structs.values())
    if not vectors:
        there = listed([f"a struct {name} with {listed(list(of)) or 'nothing'}" if isinstance(of, Mapping) else
                         f"{name} ({'x'.join(map(str, of.shape))})" for name, of in contents.items()])
        raise InputError(f"{path} holds no vectors of numbers{there and f', but {there}'}: variables that are vectors "
                         "are needed, or one struct whose fields are")

    def read(name: str, _: int | None) -> Column:
        values = vectors[name]
        if _is_complex(values):
            raise InputError(f"{path}: column '{name}' holds complex numbers: real ones are needed")
        return Column(np.asarray(values, dtype=np.float64))

    return DataTable(path, list(vectors), read)


def _vectors(contents: Mapping[str, _Contents]) -> dict[str, np.ndarray]:
    return {name: np.ravel(values) for name, values in contents.items() if isinstance(values, np.ndarray)
            and values.size == max(values.shape, default=0) and values.size > 1
            and (np.issubdtype(values.dtype, np.number) or _is_complex(values))}


def _is_complex(values: np.ndarray) -> bool:
    """Also as MAT v7.3 writes complex numbers, in two fields."""
    return np.iscomplexobj(values) or values.dtype.names == ("real", "imag")


def _in_short(error: Exception) -> str:
    """What an error says, without the bytes of a damaged file that stand in it."""
    words = "".join(letter if letter.isprintable() else " " for letter in str(error))
    return words if len(words) <= 200 else f"{words[:200]}..."
