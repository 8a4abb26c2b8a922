"""Tables of impacts: the first byte chooses format, shape, names, units and leniency, the rest is the file."""

from contactlearn.data import table
from contactlearn.simulation import synthetic
from fuzz.target import Target, file

SHAPES = (
    None,
    {"kind": "ellipse", "semi_axes": [0.035, 0.025]},
    {"kind": "disc", "radius": 0.02},
    {"kind": "polygon", "vertices": [[0.03, 0.0], [-0.015, 0.02], [-0.015, -0.02]]},
)
NAMES = (None, {"vx": "speed_x", "inertia": None})
UNITS = ({}, {"length": "mm", "angle": "deg", "time": "ms", "mass": "g", "rotation": "clockwise"})


def read(content: bytes) -> None:
    """Read a table as a setting would have it."""
    how = content[0] if content else 0
    shape = SHAPES[how >> 1 & 3]
    with file(content[1:], ".parquet" if how & 1 else ".csv") as path:
        table.read(
            path,
            shape={"body": shape, "oak": SHAPES[1]} if how & 128 else shape,
            columns=NAMES[how >> 3 & 1],
            units=UNITS[how >> 4 & 1],
            validate=not how & 32,
            drop_incomplete=bool(how & 64),
        )


def seeds() -> list[bytes]:
    """Tables as the program writes them, in both formats and a few variants."""
    found = []
    for how in (0, 1, 2, 3, 32, 33, 64, 65, 97, 18, 132, 133):
        drops = synthetic.load(size=2, seed=how)
        drops = drops.replace(object=("body", "oak")) if how & 128 else drops
        suffix = ".parquet" if how & 1 else ".csv"
        with file(b"", suffix) as path:
            path.unlink()
            found.append(bytes([how]) + table.save(drops, path).read_bytes())
    head = "mass,rx,ry,x,y,theta,vx,vy,omega,vx_post,vy_post,omega_post,time,order,cov_vx_vx,cov_vx_vy\n"
    found.append(b"\x02" + head.encode() + b"1,0,-1,0,1,0,1,-1,0,1,1,0,0,1,1,0\n")
    found.append(b"\x40" + head.encode() + b"1,,-1,0,1,nan,1,-1,0,1,1e999,0,0,1,1,0\n")
    found.append(b"\x00mass;inertia\n1;2\n")
    found.append(b"\x00\xef\xbb\xbf" + b'"mass","in""ertia"\r\n"1","2"\r\n')
    return found


TARGET = Target(
    read, seeds,
    words=[
        *table.COLUMNS, "nan", "inf", "-1e308", "1e309", '"', "\r\n", ",", ";", "\x00", "1_0", "٣", "PAR1", "speed_x",
    ],
)  # fmt: skip
