"""The published .mat: any bytes before its checksum, and any contents behind it.

The first byte chooses.  Bytes with the right checksum are not tried at large: SciPy's own parser can end the process on
some of them, which is why the checksum stands before it.
"""

import hashlib
import io
import zlib

import numpy as np
from scipy.io import savemat

from contactlearn.data import ellipse_drops
from fuzz.target import Target, file

FIELDS = {
    "states": [[0.3, 0.03, 0.0, 0.5, -2.5, 0.0, 0.3, 0.03, 0.0, 0.3, 1.2, 1.0]],
    "n": [[0.0, 1.0, 0.001]],
    "d": [[1.0, 0.0, 0.034]],
    "flags": np.zeros((1, 6), np.uint8),
}


KINDS = ("<f8", "<f4", "<i2", "|u1", "<c16", "<U3", "O", "|b1")


def read(content: bytes) -> None:
    """Read bytes as they are, or a file of the fields that they describe as if it were the published one."""
    bare = not content or not content[0] & 1
    whole = content[1:] if bare else _written(content[1:])
    published = ellipse_drops.SHA256
    with file(whole, ".mat") as path:
        try:
            ellipse_drops.SHA256 = published if bare else hashlib.sha256(whole).hexdigest()
            ellipse_drops.load(path.rename(path.with_name("ellipse_uniform.mat")).parent, flagged=True)
        finally:
            ellipse_drops.SHA256 = published


def _written(content: bytes) -> bytes:
    """A file whose fields have the kinds, shapes and values that bytes say: four bytes, then the values, for each."""
    fields: dict[str, np.ndarray] = {}
    for name, part in zip([*FIELDS, "more"], content.split(b"|"), strict=False):
        kind, rows, columns, fill = (*part[:4], 1, 1, 1, 1)[:4]
        value = np.array(FIELDS.get(name, 1.0))
        if kind != ord("p"):
            numbers = np.frombuffer(part[4 : 4 + (len(part) - 4) // 8 * 8] or bytes([fill] * 8), "<f8")
            with np.errstate(all="ignore"):
                value = np.resize(numbers, (rows % 16, columns % 16)).astype(KINDS[kind % len(KINDS)])
        fields[name] = value
    array = np.empty((1, 1 + zlib.crc32(content) % 3), dtype=[(name, object) for name in fields])
    for name, value in fields.items():
        for drop in array[0]:
            drop[name] = value
    out = io.BytesIO()
    savemat(out, {"bounce_array": array if fields else np.eye(3)})
    return out.getvalue()


def seeds() -> list[bytes]:
    """A file of the published form, and fields as published but for one."""
    whole = [b"p", b"p", b"p", b"p"]
    found = [b"\x00" + _written(b"|".join(whole))]
    for place in range(4):
        for other in (b"\x00\x01\x0c\x00" + bytes(96), b"\x02\x03\x01\x05", b"\x06\x01\x06\x00", b""):
            found.append(b"\x01" + b"|".join([*whole[:place], other, *whole[place + 1 :]]))
    return found


TARGET = Target(read, seeds, words=["p|", "|p", "||", "\x00\x01\x0c\x00"])
