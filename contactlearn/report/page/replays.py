"""The page of predicted trajectories beside recorded ones: replay.html."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torch import Tensor
from torch.nn.functional import pad

from contactlearn.inference.evaluation.replay import Replay, ReplayErrors
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.replays import replay_figure
from contactlearn.report.page.page import compressed, render, save
from contactlearn.report.page.recordings import spread
from contactlearn.report.page.trials import digits
from contactlearn.report.text.replays import replay_cells

_MAX_RECORDINGS = 60  # recordings on a page
_PATHS = 12  # of a fan


def write_replay_page(path: Path, replays: Sequence[Replay], errors: Mapping[str, ReplayErrors], said: str) -> Path:
    """Write the page, whole or not at all.

    Args:
        path: of the page.
        replays: recordings and their predictions.
        errors: of each model.
        said: which recordings these are.
    """
    return save(path, render(of_replays(replays, errors, said), "replay.html.j2", scripts=("replay.js",)))


def of_replays(replays: Sequence[Replay], errors: Mapping[str, ReplayErrors], said: str) -> dict[str, Any]:
    """Return everything that the page says and draws; `block` holds the trajectories, lengths in mm, angles in rad."""
    shown = spread(replays, _MAX_RECORDINGS)
    tracks = [
        {
            "name": one.recording,
            "time": digits(one.time.tolist(), 5),
            "fan": [
                [digits((1e3 * path[:, : len(one.noise)]).T.tolist(), 5) for path in fan[:_PATHS]]
                for fan in one.fans.values()
            ],
            "poses": [_poses(one.recorded), *map(_poses, one.predicted.values())],
        }
        for one in shown
    ]
    packed = json.dumps(tracks, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return {
        "title": "Predicted and recorded trajectories",
        "trials": None,
        "recordings": [one.recording for one in shown],
        "models": [*errors],
        "fans": [[*errors].index(name) for name in shown[0].fans],
        "outline": digits((1e3 * shown[0].shape.outline(61)).T.tolist(), 5),  # None in its gaps
        "figures": {"errors": digits(as_plotly(replay_figure(replays)))},
        "block": compressed(packed.encode(errors="replace")),
        "_said": said,
        "_rows": [(name, *replay_cells(one)) for name, one in errors.items()],
        "_limits": "" if len(shown) == len(replays) else f"{len(shown)} of {len(replays)}, evenly spread, are shown.",
    }


def _poses(poses: Tensor) -> list[list[float]]:
    d = 2 if poses.shape[1] == 3 else 3
    return digits((poses * pad(poses.new_full((d,), 1e3), (0, poses.shape[1] - d), value=1.0)).T.tolist(), 6)
