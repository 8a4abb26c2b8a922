"""ROS bags of either version and MCAP: the poses of one topic, a recording a file.

PoseStamped, TransformStamped, Odometry and their like: whatever has a header and a pose or a transform.
Lengths are in metres and quaternions have names, by ROS's REP 103.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingImports]  (an extra)
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

from contactlearn.core.errors import DataError
from contactlearn.data.packed import on_disk
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.track import Recording

_KINDS = ("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped", "Odometry")
_NANO = 1e-9


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the one recording of a bag."""
    with AnyReader([on_disk(path)], default_typestore=get_typestore(Stores.LATEST)) as bag:
        found = [one for one in bag.connections if one.msgtype.rpartition("/")[2] in _KINDS]
        topics = sorted({one.topic for one in found})
        if layout.body is not None:
            found = [one for one in found if one.topic == layout.body]
        if not found or len({one.topic for one in found}) > 1:
            raise DataError(f"{path}: holds poses on the topics {', '.join(topics) or 'none'}; state one as data.body")
        rows = [_row(bag.deserialize(raw, one.msgtype)) for one, _, raw in bag.messages(found)]
    yield layout.poses(path, rows, "wxyz")


def _row(message: Any) -> tuple[float, ...]:
    """Time, position and quaternion (w, x, y, z) of a message."""
    stamp = message.header.stamp
    pose = getattr(message, "pose", None) or message.transform
    pose = getattr(pose, "pose", pose)
    place = getattr(pose, "position", None) or pose.translation
    turned = getattr(pose, "orientation", None) or pose.rotation
    return (stamp.sec + _NANO * stamp.nanosec, place.x, place.y, place.z, turned.w, turned.x, turned.y, turned.z)
