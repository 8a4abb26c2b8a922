"""Named corrections: each undoes a corruption that is made here by hand, and the commands apply them."""

import pytest
import torch
from corruptions import CORRUPTIONS, CORRUPTIONS_AND_UNITS, MEANINGS, corrupt

from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.moments import torque
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE
from contactlearn.simulation import synthetic

ROUNDING = 1e-15  # relative: one multiplication and one division


@pytest.fixture(scope="module")
def drops() -> Impacts:
    return synthetic.load(size=60, seed=4).replace(time=torch.arange(60) * 30.0)


INVOLUTIONS = [name for name in CORRUPTIONS if name.startswith(("mirrored", "contact", "swapped"))]


def assert_equal(a: Impacts, b: Impacts) -> None:
    for name in PLANE.components:
        torch.testing.assert_close(getattr(a, name), getattr(b, name), rtol=ROUNDING, atol=0, msg=name)


@pytest.mark.parametrize("name", CORRUPTIONS_AND_UNITS)
def test_correction_undoes_the_corruption(drops, name):
    corrupted = corrupt(drops, name)
    assert any(not torch.equal(getattr(corrupted, field), getattr(drops, field)) for field in PLANE.components)
    corrected = correct(corrupted, [name])
    assert_equal(corrected, drops)
    assert corrected.source == f"{drops.source} (corrected: {name})"
    assert not corrected.validate


@pytest.mark.parametrize("name", INVOLUTIONS)
def test_mirrors_and_swaps_undo_themselves(drops, name):
    assert_equal(correct(drops.replace(validate=False), [name, name]), drops)


def test_corrections_are_pure_and_complete(drops):
    before = drops.fingerprint()
    planar = {name for name, one in CORRECTIONS.items() if PLANE in one.spaces}  # test_audit_in_space.py has the others
    for name in planar - {"inclined_floor"}:  # there is none
        correct(drops.replace(validate=False), [name])
    assert drops.fingerprint() == before
    others = {
        "inertia_scaled",
        "drop_incomplete",
        "drop_duplicates",
        "drop_outliers",
        "drop_saturated",
        "ordered_by_time",
    }
    others |= {
        "named_by_mass",
        "contact_from_shape",
        "averaged_vx",
        "averaged_vy",
        "averaged_omega",
        "rig",
        "traced_shape",
    }  # test_spread.py, test_rig.py, …
    others |= {"inclined_floor", "moving_floor", "spin_from_moments", "normal_alone"}  # test_audit.py
    others |= {"velocity_of_point"}  # test_audit_in_space.py
    others |= {f"{unit}_shape" for unit in ("millimetres", "centimetres", "inches", "feet", "doubled")}
    assert planar == {*CORRUPTIONS_AND_UNITS, *MEANINGS} | others
    assert all(correction.description for correction in CORRECTIONS.values())
    for name in planar - {"ordered_by_time", "inclined_floor"}:
        assert correct(drops.replace(q_post=None, validate=False), [name]).q_post is None


@pytest.mark.parametrize("factor", [1e-3, 0.4, 2.5, 1e6])
def test_inertia_comes_from_the_moment_balance(drops, factor):
    corrected = correct(drops.replace(inertia=drops.inertia * factor), ["inertia_scaled"])
    assert (corrected.inertia / drops.inertia).tolist() == pytest.approx([1.0] * len(drops), rel=0.02)  # the noise
    assert torque(corrected).inertia_factor.item() == pytest.approx(1, rel=1e-12)


def test_inertia_comes_from_a_positive_balance(drops):
    with pytest.raises(DataError, match=r"no positive moment of inertia .* correct the signs first"):
        correct(corrupt(drops, "mirrored_theta"), ["inertia_scaled"])
    with pytest.raises(DataError, match="none of 60 trials would be left"):
        correct(corrupt(drops, "mirrored_y"), ["drop_outliers"])


def test_duplicates_keep_the_first_and_order_follows_time(drops):
    rows = torch.tensor([0, 1, 0, 2, 1, 0, 3])
    values = {name: getattr(drops, name)[rows] for name in PLANE.components}
    twice = Impacts(**values, trial=tuple("abcdefg"))
    assert correct(twice, ["drop_duplicates"]).trial == ("a", "b", "d", "g")
    assert correct(drops, ["drop_duplicates"]).trial == drops.trial
    mixed = drops.replace(time=drops.time.flip(0))
    assert correct(mixed, ["ordered_by_time"]).order.tolist() == list(range(60, 0, -1))
    with pytest.raises(DataError, match="no column time"):
        correct(drops.replace(time=None), ["ordered_by_time"])


def test_outliers_are_dropped_and_only_they(drops):
    omega, vy, mass = drops.v_post.clone(), drops.v_pre.clone(), drops.mass.clone()
    omega[7, 2] += 300
    vy[11, 1] *= -1  # comes from below
    mass[13] *= 10
    bad = drops.replace(v_post=omega, v_pre=vy, mass=mass, validate=False)
    kept = correct(bad, ["drop_outliers"])
    assert set(drops.trial) - set(kept.trial) == {"8", "12", "14"}
    assert kept.replace(validate=True).validate
    assert correct(drops, ["drop_outliers"]).trial == drops.trial


def test_names(drops):
    assert correct(drops, []) is drops
    with pytest.raises(UnknownNameError, match=r"unknown correction 'mirror_x', did you mean 'mirrored_x'"):
        correct(drops, ["mirror_x"])
    with pytest.raises(DataError, match=r"must be a list of names, such as \[mirrored_x\]"):
        correct(drops, "mirrored_x")
    with pytest.raises(DataError, match="approach the floor"):  # validated in full
        correct(drops, ["mirrored_y"])
    corrected = load_data(SourceSettings.from_values({**FIVE, "correct": ["mirrored_x"]})).impacts
    assert_equal(corrected, corrupt(synthetic.load(size=5), "mirrored_x"))
    assert corrected.source.endswith("(corrected: mirrored_x)")
    with pytest.raises(UnknownNameError, match="did you mean 'mirrored_x'"):
        load_data(SourceSettings.from_values({**FIVE, "correct": ["miror_x"]}))
    with pytest.raises(ContactLearnError, match=r"such as \[mirrored_x\]"):
        SourceSettings.from_values({**FIVE, "correct": "mirrored_x"})
    assert (
        load_data(SourceSettings.from_values({**FIVE, "correct": None})).impacts.source
        == "synthetic drops (wang_mason, seed 0)"
    )


FIVE = {"_target_": "contactlearn.simulation.synthetic.load", "size": 5}


def config(path, **changes):
    values = {"_target_": "contactlearn.data.table.load", "path": str(path), "shape": None, **changes}
    return SourceSettings.from_values(values)


@pytest.mark.parametrize("name", ["swapped_pre_post", "mirrored_y", "swapped_axes"])
def test_a_table_that_would_be_refused_is_corrected(tmp_path, drops, name):
    corrupted = corrupt(drops, name)
    path = table.save(corrupted, tmp_path / "drops.csv")
    with pytest.raises(DataError, match="approach the floor"):
        load_data(config(path))
    corrected = load_data(config(path, correct=[name])).impacts
    assert_equal(corrected, drops)
    assert (corrected.validate, corrected.source) == (True, f"{path} (corrected: {name})")
    read = load_data(config(path, correct=[]), validate=False).impacts
    assert not read.validate
    assert read.fingerprint() == corrupted.fingerprint()
    with pytest.raises(DataError, match="approach the floor"):  # a correction that does not do
        load_data(config(path, correct=["grams"]))


@pytest.mark.parametrize("named", [True, False], ids=["names", "no names"])
def test_rows_with_empty_cells_are_left_out_on_request(tmp_path, named):
    """They are counted and named; the others keep their places in the sequence."""
    drops = synthetic.load(size=40, shape={"kind": "disc", "radius": 0.03})
    path = table.save(drops.replace(trial=tuple(f"drop {i}" for i in range(1, 41))), tmp_path / "drops.csv")
    header, *lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    rows[2][header.split(",").index("vx_post")] = ""
    rows[7][header.split(",").index("mass")] = "NaN"
    kept = [k for k, name in enumerate(header.split(",")) if named or name not in ("trial", "order")]
    path.write_text("".join(",".join(row[k] for k in kept) + "\n" for row in (header.split(","), *rows)))
    with pytest.raises(DataError, match=r"row 8 .line 9., column mass: .* data.correct=.drop_incomplete. does"):
        load_data(config(path))
    impacts = load_data(config(path, correct=["drop_incomplete"])).impacts
    left_out = ("drop 3", "drop 8") if named else ("3", "8")
    assert impacts.incomplete == left_out
    assert len(impacts) == 38
    assert impacts.order.tolist() == [k for k in range(1, 41) if k not in (3, 8)]
    assert impacts.trial[2] == ("drop 4" if named else "4")
    note = next(finding for finding in audit(impacts) if finding.name == "incomplete_trials")
    assert (note.value("trials"), note.value("names"), note.mistake) == (2, ", ".join(left_out), False)
    assert "2 of 40 trials" in note.sentence


def test_a_cell_that_is_no_number_is_an_error_or_left_out(tmp_path):
    path = table.save(synthetic.load(size=12), tmp_path / "drops.csv")
    header, *lines = path.read_text().splitlines()
    words = lines[0].split(",")
    words[header.split(",").index("mass")] = "heavy"
    path.write_text("\n".join([header, ",".join(words), *lines[1:]]))
    with pytest.raises(DataError, match="column mass: must be a finite number in kg; got 'heavy'"):
        load_data(config(path))
    assert len(load_data(config(path, correct=["drop_incomplete"])).impacts) == 11
    path.write_text("\n".join([header, "x" + "," * header.count(","), "y" + "," * header.count(",")]))
    with pytest.raises(DataError, match="each of 2 rows has an empty cell"):
        load_data(config(path, correct=["drop_incomplete"]))
