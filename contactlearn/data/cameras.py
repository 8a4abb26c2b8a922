"""Columns with the images of a body in two cameras or more, which are no positions until they are triangulated.

cam1_u, cam1_v, cam2_u, cam2_v     left_x_px, left_y_px, right_x_px, right_y_px     u1, v1, u2, v2 (beside times)
"""

import re
from collections.abc import Sequence

_CAMERA = {"cam", "camera", "kamera", "caméra", "view", "ansicht", "vue"}
_SIDES = {"left", "right", "links", "rechts", "gauche", "droite"}
_ACROSS, _DOWN, _AXES = "ux", "vy", "uxvyz"
_UNITS = {"px", "pix", "pixel", "pixels", "img", "image", "raw", "coord", "pos"}
_CLOCK = {"t", "time", "zeit", "frame", "frames", "timestamp", "stamp"}
_WORDS = re.compile(r"[^\W\d_]+|\d+")


def refusal_of_cameras(header: Sequence[str]) -> str:
    """Return why positions cannot be read from columns with the images of several cameras; empty of any others."""
    cameras = images_of_cameras(header)
    if len(cameras) < 2:
        return ""
    (first, (across, down)), *_ = cameras.items()
    return (
        f"has images of cameras {', '.join(cameras)}: calibrate them and triangulate x, y and z first; or, of motion "
        f"across the view, use one, 'data.columns={{time: …, position: [{across}, {down}]}}' data.unit=…, the size "
        f"of a pixel of {first} in m"
    )


def images_of_cameras(header: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the two columns of each camera's image by its name; none where a third coordinate stands beside them."""
    timed = any(_CLOCK.intersection(_words(name)) for name in header)
    found: dict[str, dict[str, str]] = {}
    for name in header:
        rest = [word for word in _words(name) if word not in _UNITS]
        axes = [word for word in rest if word in _AXES]
        of = [word for word in rest if word not in axes]
        if len(axes) != 1 or not of or len(of) > 2:
            continue
        numbered = len(of) == 1 and of[0].isdigit()
        if numbered and not (timed and axes[0] in ("u", "v")):
            continue
        sided = of[0] in _SIDES and all(word.isdigit() for word in of[1:])
        if not (numbered or sided or _CAMERA & {*of}):
            continue
        found.setdefault("".join(of), {})[axes[0]] = name
    if any("z" in axes for axes in found.values()):
        return {}
    images = dict[str, tuple[str, str]]()
    for camera, axes in found.items():
        across, down = ([axes[axis] for axis in pair if axis in axes] for pair in (_ACROSS, _DOWN))
        if across and down:
            images[camera] = across[0], down[0]
    return images


def _words(name: str) -> list[str]:
    """Words and numbers of a name in lower case; letters of axes stand alone in camelCase too."""
    return [word.lower() for word in _WORDS.findall(re.sub(r"(?<=[a-z\d])(?=[A-Z])", "_", name))]
