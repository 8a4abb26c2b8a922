"""Files of arrays: NumPy (.npy, .npz), PyTorch (.pt), MATLAB (.mat), and tables in HDF5.

Arrays alone are read, never objects, so that no file runs code.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from contactlearn.core.errors import ContactLearnError, DataError, install_hint
from contactlearn.data.packed import for_library

HDF5 = (".h5", ".hdf5")


def loaded(path: Path) -> Any:
    """Return the arrays of a file by name, those of a structure in a mapping of their own, or its only array.

    Raises:
        DataError: it is of a version of MATLAB that is HDF5.
    """
    if path.suffix.lower() == ".pt":
        return torch.load(for_library(path), map_location="cpu", weights_only=True)
    if path.suffix.lower() == ".mat":
        from scipy.io import loadmat

        try:
            return {
                name: one
                for name, one in loadmat(for_library(path), simplify_cells=True).items()
                if not name.startswith("__")
            }
        except NotImplementedError:
            raise DataError(f"{path}: is of MATLAB's version 7.3; save it with -v7, or rename it .h5") from None
    found = np.load(for_library(path), allow_pickle=False)
    return {name: found[name] for name in found.files} if isinstance(found, np.lib.npyio.NpzFile) else found


def tables_in_hdf5(path: Path) -> dict[str, Any]:
    """Return groups as mappings and data sets of numbers as arrays, with their units behind their names.

    Raises:
        ContactLearnError: the library that reads the format is not installed.
    """
    try:
        import h5py  # pyright: ignore[reportMissingImports]  (an extra)
    except ModuleNotFoundError:
        hint = install_hint("tracks")
        raise ContactLearnError(f"{path}: files with suffix {path.suffix} need h5py: {hint}") from None

    def content(group: Any) -> dict[str, Any]:
        found = dict[str, Any]()
        for name, one in group.items():
            unit = next((one.attrs[key] for key in ("units", "unit", "Units", "Unit") if key in one.attrs), "")
            unit = unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
            if isinstance(one, h5py.Group):
                found[name] = content(one)
            elif one.dtype.names:
                found |= {field: one[field] for field in one.dtype.names}
            elif one.dtype.kind in "fiu":
                found[f"{name} [{unit}]" if unit else name] = one[()]
        return found

    with h5py.File(for_library(path), "r") as file:
        return content(file)
