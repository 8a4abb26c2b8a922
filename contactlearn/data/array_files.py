"""Files of arrays: NumPy (.npy, .npz), PyTorch (.pt) and MATLAB (.mat).

Arrays alone are read, never objects, so that no file runs code.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from contactlearn.core.errors import DataError


def loaded(path: Path) -> Any:
    """Return the arrays of a file by name, those of a structure in a mapping of their own, or its only array.

    Raises:
        DataError: it is of a version of MATLAB that is HDF5.
    """
    if path.suffix.lower() == ".pt":
        return torch.load(path, map_location="cpu", weights_only=True)
    if path.suffix.lower() == ".mat":
        from scipy.io import loadmat

        try:
            return {name: one for name, one in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
        except NotImplementedError:
            raise DataError(f"{path}: is of MATLAB's version 7.3; save it with -v7, or rename it .h5") from None
    found = np.load(path, allow_pickle=False)
    return {name: found[name] for name in found.files} if isinstance(found, np.lib.npyio.NpzFile) else found
