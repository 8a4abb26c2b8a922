"""Inputs of a first notebook: a DataFrame, a path, one trial, arrays, the wrong velocities."""

import numpy as np
import pandas as pd
import pytest
import torch

from contactlearn import ContactModel, diagnose, identify, identify_jointly, laws
from contactlearn.core.errors import ContactLearnError
from contactlearn.data.recordings.track import Recording
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation import synthetic

DROPS = synthetic.load(size=30)
LAW = laws.find("wang_mason").at(0.12, 0.55)


@pytest.mark.parametrize("use", [
    ContactModel(LAW).predict,
    lambda given: identify(LAW, given),
    lambda given: identify_jointly(LAW, {}, given),
    diagnose,
], ids=["predict", "identify", "identify_jointly", "diagnose"])  # fmt: skip
def test_non_impacts_are_refused_with_the_way_to_read_a_table(use):
    with pytest.raises(ContactLearnError, match=r"impacts must be Impacts, got DataFrame; frame\.to_csv.*table\.load"):
        use(pd.DataFrame({"mass": [1.0]}))
    with pytest.raises(ContactLearnError, match=r"must be Impacts, got str; contactlearn\.data\.table\.load"):
        use("drops.csv")


def test_impacts_are_made_of_columns_of_a_frame():
    names = {"r": ("rx", "ry"), "q": ("x", "y", "theta"), "v_pre": ("vx", "vy", "omega"), "v_post": ("a", "b", "c")}
    values = {name: getattr(DROPS, field)[:, k] for field, own in names.items() for k, name in enumerate(own)}
    frame = pd.DataFrame(values | {"mass": DROPS.mass, "inertia": DROPS.inertia})
    made = Impacts(frame["mass"], frame["inertia"], **{field: frame[[*own]] for field, own in names.items()})
    assert all(torch.equal(getattr(made, field), getattr(DROPS, field)) for field in ("mass", "inertia", *names))


def test_one_index_is_one_trial_and_a_loop_ends():
    assert DROPS[3].trial == ("4",)
    assert DROPS[-1].trial == ("30",)
    assert [one.trial[0] for one in DROPS] == list(DROPS.trial)
    with pytest.raises(IndexError):
        DROPS[30]
    with pytest.raises(ContactLearnError, match=r"such as torch\.Generator\(\)\.manual_seed\(0\), got 0"):
        DROPS.split(0.2, 0)
    assert len(DROPS.split(0.2, torch.Generator().manual_seed(0))[1]) == 6
    time = np.arange(300) / 240
    one = Recording(name="a", source="a.csv", time=time, position=np.zeros((300, 2)), angle=time)
    assert repr(one) == "Recording('a', 300 frames in 1.25 s, source='a.csv')"
    with pytest.raises(
        ContactLearnError, match=r"such as impacts\.W and impacts\.v_c, got Tensor \[30, 2, 2\] and .* \[30, 3\]"
    ):
        LAW.impulse(DROPS.W, DROPS.v_pre)
    with pytest.raises(ContactLearnError, match=r"must be tensors, .* got ndarray \[30, 2, 2\]"):
        LAW.impulse(DROPS.W.numpy(), DROPS.v_c.numpy())
