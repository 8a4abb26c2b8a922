"""Write one long CSV file of simulated recordings, to measure time and memory of the impacts command.

    python benchmarks/speed/long_file.py long.csv --gigabytes 10
    /usr/bin/time -v python -m contactlearn impacts long.csv -o impacts.parquet mass=0.0364 unit=m workers=2 \
        'shape={kind: ellipse, semi_axes: [0.035, 0.025]}'

Two hundred recordings of 500 frames are repeated under new names, so that writing costs little and holds no more.
"""

import argparse
from pathlib import Path

import pandas as pd

from contactlearn.data.recordings.track import Recording
from contactlearn.simulation.recordings import simulate

_NAME = "@" * 8


def text(recording: Recording) -> str:
    """Rows of a recording, with a name that can be replaced."""
    x, y = recording.position.T
    table = pd.DataFrame({"recording": _NAME, "time": recording.time, "x": x, "y": y, "theta": recording.angle})
    return table.to_csv(index=False, header=False, float_format="%.6f")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--gigabytes", type=float, default=10.0)
    options = parser.parse_args()
    bodies, count = [text(recording) for recording in simulate(200, seed=5)[0]], 0
    with options.path.open("w", encoding="ascii") as file:
        size = file.write("recording,time,x,y,theta\n")
        while size < 1e9 * options.gigabytes:
            size += file.write(bodies[count % len(bodies)].replace(_NAME, f"r{count:07d}"))
            count += 1
    print(f"{count} recordings, {size / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
