"""Recordings of poses: the first byte chooses the format and the layout, the rest is the file.

HDF5, C3D, ROS bags and MCAP are read where their libraries are installed; otherwise the documented error comes out.
"""

import io

import numpy as np
import pandas as pd

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.conventions import Conventions, find_frame, find_gravity
from contactlearn.data.recordings.readers import Layout, read as read_recordings
from contactlearn.data.recordings.track import Recording
from fuzz.target import Target, file

SUFFIXES = (".csv", ".parquet", ".tum", ".csv", ".h5", ".c3d", ".mcap", ".bag")
LAYOUTS = (
    Layout(),
    Layout(rate=100.0, recording=None, body="drop"),
    Layout(time="t", position=("a", "b"), angle="c"),
    Layout(markers=(("x", "y"), ("a", "b"))),
)


def read(content: bytes) -> None:
    """Read every recording of a file, and look for the frame of those that are sound."""
    how = content[0] if content else 0
    with file(content[1:], SUFFIXES[how & 7]) as path:
        found = [*read_recordings(path, LAYOUTS[how >> 3 & 3])]
    sound = [one for one in found if isinstance(one, Recording)]
    assert all(isinstance(one, Recording | DataError) for one in found)
    if sound and how & 64:
        find_frame(sound, find_gravity(sound), Conventions(unit="m", up="y"))


def seeds() -> list[bytes]:
    """A short flight in each format that can be written here."""
    time = np.arange(12) / 100
    flight = pd.DataFrame({"time": time, "x": time, "y": 1 - 4.9 * time**2, "theta": 2 * time})
    space = flight.assign(z=0.0, qw=1.0, qx=0.0, qy=0.0, qz=0.0).drop(columns="theta")
    named = pd.concat([flight.assign(recording=name) for name in "ab"])
    tum = "".join(f"{t} {t} 1 0 0 0 0 1\n" for t in time)
    bare = flight.rename(columns={"time": "t", "x": "a", "y": "b", "theta": "c"}).assign(x=0.1, y=time)
    tables = ((64, flight), (64, space), (0, named), (16, bare), (88, bare), (8, flight.drop(columns="time")))
    found = [bytes([how]) + table.to_csv(index=False).encode() for how, table in tables]
    for table in (flight, named):
        out = io.BytesIO()
        table.to_parquet(out, index=False)
        found.append(b"\x01" + out.getvalue())
    return [*found, b"\x02# poses\n" + tum.encode(), b"\x03" + _motive(time).encode(), *_extra(flight)]


def _motive(time: np.ndarray) -> str:
    about = "Format Version,1.23,Export Frame Rate,100.0,Rotation Type,Quaternion,Length Units,Meters"
    kinds = ["", "Type", *["Rigid Body"] * 7]
    names, ids = ["", "Name", *["drop"] * 7], ["", "ID", *["1"] * 7]
    measured = ["", "", *["Rotation"] * 4, *["Position"] * 3]
    letters = ["Frame", "Time (Seconds)", *"XYZWXYZ"]
    rows = [[str(k), str(t), "0", "0", "0", "1", str(t), "1", "0"] for k, t in enumerate(time)]
    return "\n".join([about, *(",".join(row) for row in (kinds, names, ids, measured, letters, *rows))]) + "\n"


def _extra(flight: pd.DataFrame) -> list[bytes]:
    """Files of libraries that may not be installed."""
    found = [b"\x05\x02\x50", b"\x06\x89MCAP0\r\n", b"\x07#ROSBAG V2.0\n"]
    try:
        import h5py
    except ModuleNotFoundError:
        return found
    with file(b"", ".h5") as path:
        with h5py.File(path, "w") as out:
            for name in ("time", "x", "y", "theta"):
                out[name] = flight[name].to_numpy()
        found.append(b"\x04" + path.read_bytes())
    return found


COLUMNS = ["time", "recording", "theta", "qw", "qx", "qy", "qz", "Frame", "Rigid Body", "Position", "Rotation"]
TARGET = Target(
    read,
    seeds,
    words=[*COLUMNS, "Format Version", "nan", "inf", "1e308", "-1e308", '"', "\r\n", ",", "#", "\x00", "PAR1"],
    watched=["rosbags"],
)
