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
MORE = (".tsv", ".txt", ".npz", ".npy", ".pt", ".mat", ".tsv", ".txt")
"""Where the bit of 32 is set."""
LAYOUTS = (
    Layout(),
    Layout(rate=100.0, recording=None, body="drop"),
    Layout(time="t", position=("a", "b"), angle="c"),
    Layout(markers=(("x", "y"), ("a", "b"))),
)


def read(content: bytes) -> None:
    """Read every recording of a file, and look for the frame of those that are sound."""
    how = content[0] if content else 0
    with file(content[1:], (MORE if how & 32 else SUFFIXES)[how & 7]) as path:
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
    return [*found, b"\x02# poses\n" + tum.encode(), b"\x03" + _motive(time).encode(), *_exports(time), *_extra(flight)]


def _exports(time: np.ndarray) -> list[bytes]:
    """Headers of trackers, and arrays."""
    points = "".join(f"{t}\t1\t0\t{t}\t1\t1\t0\t2\t{t}\n" for t in time)
    qualisys = f"NO_OF_FRAMES\t12\nFREQUENCY\t100\nMARKER_NAMES\ta\tb\tc\nTRAJECTORY_TYPES\tM\tM\tM\n{points}"
    vicon = "Objects\n100\n,,box:box,,,,,,\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n,,,,,,mm,mm,mm\n"
    vicon += "".join(f"{k},0,0,0,0,1,{t},1,0\n" for k, t in enumerate(time)) + "\nDevices\n"
    deeplabcut = "scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n"
    deeplabcut += "".join(f"{k},{t},1,0.9\n" for k, t in enumerate(time))
    sleap = "track,frame_idx,instance.score,a.x,a.y,a.score\n"
    sleap += "".join(f"t0,{k},1,{t},1,0.9\n" for k, t in enumerate(time))
    tracker = "mass A\t\t\nt\tx\ty\n" + "".join(f"{t}\t{t}\t1\n".replace(".", ",") for t in time)
    texts = ((32, qualisys), (0, vicon), (0, deeplabcut), (0, sleap), (33, tracker))
    found = [bytes([how]) + text.encode() for how, text in texts]
    pose = np.column_stack((time, 0 * time, 1 - time, 1 + 0 * time, np.zeros((12, 9))))
    for how, write in ((35, np.save), (34, np.savez)):
        out = io.BytesIO()
        write(out, pose)
        found.append(bytes([how]) + out.getvalue())
    return found


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
    words=[
        *COLUMNS,
        "Format Version",
        "nan",
        "inf",
        "1e308",
        "-1e308",
        '"',
        "\r\n",
        ",",
        "#",
        "\x00",
        "PAR1",
        "NO_OF_FRAMES",
        "Objects",
        "scorer",
        "bodyparts",
        "coords",
        "frame_idx",
    ],
    watched=["rosbags"],
)
