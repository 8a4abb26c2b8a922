"""Checkpoints: predictions survive a round trip, and no file is believed more than it deserves."""

import copy
import json
import os
import pickle
import resource
import time
import zipfile
from contextlib import nullcontext
from pathlib import Path

import pytest
import refusals
import torch
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.effects import EffectId, find_effect
from contactlearn.inference.learning.recipe import TARGETS, Recipe, learn
from contactlearn.laws import Law, find
from contactlearn.models import checkpoint, regressor
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.gp.sparse import SparseGPs
from contactlearn.simulation import synthetic

ROUNDING = 1e-12
"""Relative to the largest value: the same arithmetic, though perhaps in another memory layout."""

PROVENANCE = {"recipe": {"law": None, "size": 15}, "data": "sha256 Ω", "versions": ["2.13", 1.5, True]}
IMPACTS = synthetic.load(size=80)
ROWS = torch.stack([torch.randperm(80, generator=torch.Generator().manual_seed(seed))[:15] for seed in range(3)])
SUBSETS = {"one subset": ROWS[0], "three subsets": ROWS}


def law(rows: Tensor) -> Law:
    """With a (μ, ε) for each subset."""
    mu = 0.1 + 0.02 * torch.arange(3, dtype=torch.float64)[:, None]
    mu = mu if rows.ndim == 2 else mu[0]
    return find("wang_mason").at(mu, torch.full_like(mu, 0.5))


def assert_same(a: ContactModel, b: ContactModel) -> None:
    a, b = a.predict(IMPACTS), b.predict(IMPACTS)
    for name in ("v_post", "wrench", "covariance"):
        mine, theirs = getattr(a, name), getattr(b, name)
        assert (mine is None) == (theirs is None)
        if mine is not None:
            assert mine.shape == theirs.shape
            assert (mine - theirs).abs().max() <= ROUNDING * mine.abs().max()


def round_trip(model: ContactModel, folder: Path) -> ContactModel:
    path = checkpoint.save(model, folder / "new" / "folder" / "model.pt", provenance=PROVENANCE)
    assert [entry.name for entry in path.parent.iterdir()] == ["model.pt"]
    loaded = checkpoint.load(str(path))
    assert loaded.provenance == PROVENANCE
    assert_same(loaded, model)
    return loaded


@pytest.mark.parametrize("rows", SUBSETS.values(), ids=SUBSETS)
@pytest.mark.parametrize("target", TARGETS)
def test_learned_models_come_back(tmp_path, target, rows):
    model = learn(IMPACTS, Recipe("x1", target, find("wang_mason")), rows=rows, base=law(rows))
    loaded = round_trip(model, tmp_path)
    mine, theirs = (each.parameters or each.residual for each in (model, loaded))
    assert (loaded.target, type(theirs.gps), theirs.status) == (model.target, type(mine.gps), None)
    assert not theirs.gps.training
    for a, b in zip(mine.leave_one_out(), theirs.leave_one_out(), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-9)
    state = theirs.gps.state_dict()
    assert state.keys() == mine.gps.state_dict().keys()
    assert all(torch.equal(value, state[name]) for name, value in mine.gps.state_dict().items())


@pytest.mark.parametrize("target", ["wrench", "parameters_likelihood"])
def test_sparse_processes_come_back(tmp_path, monkeypatch, target):
    monkeypatch.setattr(regressor, "EXACT_LIMIT", 10)
    loaded = round_trip(learn(IMPACTS, Recipe("x2", target, find("wang_mason")), rows=ROWS, base=law(ROWS)), tmp_path)
    assert isinstance((loaded.parameters or loaded.residual).gps, SparseGPs)


@pytest.mark.parametrize("space", ["state", "x2_polar"])
def test_purely_learned_models_come_back(tmp_path, space):
    loaded = round_trip(learn(IMPACTS, Recipe(space, "impulse"), rows=ROWS), tmp_path)
    assert loaded.base is None
    assert loaded.residual.inputs.scale.isinf().any() == (space == "state")  # its mass never changes


def test_purely_learned_models_and_models_on_models_come_back(tmp_path):
    base = learn(IMPACTS, Recipe("x1", "parameters_likelihood", find("wang_mason")), rows=ROWS, base=law(ROWS))
    middle = learn(IMPACTS, Recipe("x2", "impulse"), rows=ROWS, base=base)
    loaded = round_trip(learn(IMPACTS, Recipe("state", "velocity"), rows=ROWS, base=middle), tmp_path)
    assert loaded.base.base.base.name == "wang_mason"
    noise = torch.eye(3, dtype=torch.float64).expand(10_000, 3, 3).clone()[7]
    path = checkpoint.save(ContactModel(LAWS["numbers"], noise=noise), tmp_path / "model.pt", provenance=PROVENANCE)
    assert path.stat().st_size < 10_000
    contents = torch.load(path, weights_only=True)
    assert json.loads(contents["description"])["provenance"] == PROVENANCE
    tensors = contents["tensors"]
    assert set(tensors) == {"model.noise", "model.base.mu", "model.base.eps", "model.base.e_t"}
    assert torch.equal(tensors["model.noise"], noise)


LAWS = {
    "numbers": find("chatterjee_ruina", e_t=0.3).at(0.1, 0.55),
    "whole numbers": find("mirtich").at(0, 1),
    "variant": find("whittaker", "fazeli2017").at(torch.tensor(0.2, dtype=torch.float64), 0.5),
    "sweep": find("drumwright_shell").at(torch.linspace(0, 1, 7, dtype=torch.float64)[:, None], 0.3),
}


@pytest.mark.parametrize("alone", LAWS.values(), ids=LAWS)
def test_laws_alone_come_back(tmp_path, alone):
    loaded = round_trip(ContactModel(alone), tmp_path)
    assert (loaded.base.name, loaded.base.variant) == (alone.name, alone.variant)
    assert (loaded.residual, loaded.parameters, loaded.noise) == (None, None, None)


def test_laws_of_older_files_and_no_impulse_come_back(tmp_path):
    path = checkpoint.save(ContactModel(LAWS["sweep"]), tmp_path / "model.pt", provenance=PROVENANCE)

    def older(description, tensors):
        description["model"]["base"]["e_t"] = []
        tensors["model.base.e_t"] = torch.zeros((), dtype=torch.float64)

    loaded = checkpoint.load(changed(tmp_path / "older.pt", path, older))
    assert loaded.base.options == {}
    assert torch.equal(loaded.base.mu, LAWS["sweep"].mu)
    assert round_trip(ContactModel(), tmp_path) == ContactModel()


@pytest.mark.parametrize("fault", [OSError("disk full"), RuntimeError("disk full"), KeyboardInterrupt()], ids=repr)
def test_a_failed_save_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, fault):
    path = checkpoint.save(ContactModel(), tmp_path / "model.pt", provenance={})
    before = path.read_bytes()

    def fail(contents, part):
        part.write(b"half a")
        raise fault

    monkeypatch.setattr(torch, "save", fail)
    with pytest.raises(KeyboardInterrupt if isinstance(fault, KeyboardInterrupt) else DataError):
        checkpoint.save(ContactModel(LAWS["numbers"]), path, provenance={})
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_full_disk_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "atomic_write", lambda path: nullcontext(Path("/dev/full")))
    with pytest.raises(DataError, match=r"model\.pt: cannot be written: No space left on device$"):
        checkpoint.save(ContactModel(LAWS["numbers"]), tmp_path / "model.pt", provenance={})


def test_what_cannot_be_saved_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"model\.pkl: a checkpoint is a \.pt file, got suffix '\.pkl'"):
        checkpoint.save(ContactModel(), tmp_path / "model.pkl", provenance={})
    with pytest.raises(TypeError, match="JSON"):
        checkpoint.save(ContactModel(), tmp_path / "model.pt", provenance={"data": IMPACTS})
    assert not list(tmp_path.iterdir())
    (tmp_path / "folder.pt").mkdir()
    with pytest.raises(DataError, match=r"folder\.pt: cannot be written"):
        checkpoint.save(ContactModel(), tmp_path / "folder.pt", provenance={})
    refused(tmp_path / "model.pt", "no such file; check the path")
    refused(tmp_path, "cannot be read", "directory")


def refused(path: Path, *fragments: str) -> None:
    with refusals.refused((str(path), *fragments)):
        checkpoint.load(path)


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path):
        self.folder = str(folder)

    def __reduce__(self):
        return os.mkdir, (self.folder,)


@pytest.mark.parametrize("place", ["pickle", "old file", "whole", "provenance", "tensor"])
def test_nothing_is_executed(tmp_path, place):
    path, crater = tmp_path / "model.pt", tmp_path / "crater"
    bomb = Bomb(crater)
    if place == "pickle":
        path.write_bytes(pickle.dumps(bomb))
    elif place == "old file":
        torch.save(bomb, path, _use_new_zipfile_serialization=False)
    elif place == "whole":
        torch.save(bomb, path)
    else:
        checkpoint.save(ContactModel(LAWS["numbers"]), path, provenance={})
        contents = torch.load(path, weights_only=True)
        contents["tensors"]["model.base.mu"] = bomb if place == "tensor" else contents["tensors"]["model.base.mu"]
        torch.save(contents | ({"provenance": bomb} if place == "provenance" else {}), path)
    refused(path, "is not a checkpoint", "more than tensors and text" if zipfile.is_zipfile(path) else "not a zip file")
    assert not crater.exists()
    pickle.loads(pickle.dumps(bomb))  # it would have gone off
    assert crater.exists()


FOREIGN = {
    "empty": b"", "text": b"epoch,loss\n1,0.3\n", "random": bytes(range(256)) * 9,
    "empty zip": b"PK\x05\x06" + bytes(18),
}  # fmt: skip


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN)
def test_foreign_files_are_refused(tmp_path, content):
    path = tmp_path / "model.pt"
    path.write_bytes(content)
    refused(path, "is not a checkpoint", "save the model again")


@pytest.mark.parametrize("content", [{}, [], torch.ones(3), {"description": 1, "tensors": {}}, None], ids=repr)
def test_foreign_torch_files_are_refused(tmp_path, content):
    path = tmp_path / "model.pt"
    torch.save(content, path)
    refused(path, "is not a checkpoint", "save the model again")


@pytest.fixture(scope="module")
def learned(tmp_path_factory) -> Path:
    """A file with a part of every kind."""
    model = learn(IMPACTS, Recipe("x2", "parameters_likelihood", find("wang_mason")), rows=ROWS, base=law(ROWS))
    model = learn(IMPACTS, Recipe("state", "wrench"), rows=ROWS, base=model)
    return checkpoint.save(model, tmp_path_factory.mktemp("learned") / "model.pt", provenance=PROVENANCE)


def test_truncated_and_changed_files_are_refused_or_harmless(tmp_path, learned):
    whole, path = learned.read_bytes(), tmp_path / "model.pt"
    for length in (3, 100, len(whole) // 2, len(whole) - 200, len(whole) - 1):
        path.write_bytes(whole[:length])
        refused(path, "not all of one", "copy the file again")
    model, outcomes = checkpoint.load(learned), set()
    for position in range(40, len(whole), len(whole) // 100):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 16]) + whole[position + 1 :])
        try:
            assert_same(checkpoint.load(path), model)
            outcomes.add("harmless")  # such as a time stamp, or filling between tensors
        except DataError:
            outcomes.add("refused")
    assert "refused" in outcomes
    path = changed(tmp_path / "model.pt", learned, lambda description, tensors: None)
    assert_same(checkpoint.load(path), checkpoint.load(learned))


def changed(path: Path, learned: Path, change) -> Path:
    """A copy of the file whose description and tensors `change` has changed."""
    contents = torch.load(learned, weights_only=True)
    description = json.loads(contents["description"])
    change(description, contents["tensors"])
    torch.save(contents | {"description": json.dumps(description)}, path)
    return path


def put(name: str, value):
    return lambda description, tensors: tensors.update({name: value(tensors[name])})


def first(value: float):
    """Of a tensor with one value changed."""
    return lambda tensor: torch.cat((torch.tensor([value], dtype=torch.float64), tensor.flatten()[1:])).view_as(tensor)


def describe(*keys: str, **values):
    def change(description, tensors):
        for key in keys:
            description = description[key]
        description.update(values)

    return change


MEAN, NOISE = "model.residual.inputs.mean", "model.noise"
LENGTH = "model.residual.gps.covar_module.base_kernel.raw_lengthscale"
UPGRADE = "upgrade contactlearn"
BAD = {
    "newer": (describe(format=4), ["format 4", "newest known is 3", UPGRADE]),
    "format as text": (describe(format="1"), ["is not a checkpoint"]),
    "no model": (lambda description, tensors: description.pop("model"), ["is not a checkpoint", "model"]),
    "no provenance": (lambda description, tensors: description.pop("provenance"), ["provenance"]),
    "law": (describe("model", "base", "base", name="wang_masson"),
        ["unknown law", "did you mean 'wang_mason'", UPGRADE]),
    "variant": (describe("model", "base", "base", variant="new"), ["unknown variant 'new'", UPGRADE]),
    "space": (describe("model", "residual", space="x9"), ["unknown feature space 'x9'", "known: state", UPGRADE]),
    "other space": (describe("model", "residual", space="x1"), [MEAN, "11 columns", "x1 has 5"]),
    "target": (describe("model", target="torque"), ["unknown target 'torque'", "velocity", UPGRADE]),
    "kind": (describe("model", "residual", "gps", kind="DeepGPs"), ["is not a checkpoint", "DeepGPs", UPGRADE]),
    "field": (describe("model", friction=None), ["is not a checkpoint", "friction"]),
    "number": (describe("model", noise=0.3), ["is not a checkpoint"]),
    "missing": (lambda description, tensors: tensors.pop(LENGTH), [f"lacks the tensor {LENGTH}"]),
    "extra": (lambda description, tensors: tensors.update(more=torch.ones(1)), ["no part", "tensor more"]),
    "shape": (put(NOISE, lambda tensor: tensor[0]), [NOISE, "shape (3, 3, 3)", "got", "(3, 3)"]),
    "transposed": (put("model.residual.gps.x", lambda tensor: tensor.mT), ["gps.x", "(3, 15, 11)", "(3, 11, 15)"]),
    "single": (put(MEAN, lambda tensor: tensor.float()), [MEAN, "float64", "float32"]),
    "text": (put(MEAN, str), ["is not a checkpoint"]),
    "infinite": (put(NOISE, first(-torch.inf)), [NOISE, "finite", "-inf"]),
}  # fmt: skip


@pytest.mark.parametrize(("change", "fragments"), BAD.values(), ids=BAD)
def test_changed_files_are_refused(tmp_path, learned, change, fragments):
    refused(changed(tmp_path / "model.pt", learned, change), *fragments)


@pytest.mark.parametrize("fault", ["missing", "longer", "nan"])
def test_every_tensor_is_checked(tmp_path, learned, fault):
    faults = {
        "missing": lambda tensors, name: tensors.pop(name),
        "longer": lambda tensors, name: tensors.update({name: torch.stack([tensors[name]] * 2)}),
        "nan": lambda tensors, name: tensors.update({name: tensors[name] * torch.nan}),
    }
    for name in torch.load(learned, weights_only=True)["tensors"]:
        said = (name, "finite", "nan") if fault == "nan" else (name,)
        refused(changed(tmp_path / "model.pt", learned, lambda _, t, name=name: faults[fault](t, name)), *said)


@pytest.mark.parametrize("form", ["after", "during"])
def test_the_form_of_an_effect_comes_back(tmp_path, form):
    """Also from files of format 1, which have it among the options."""
    drops = synthetic.load(size=20)
    effects = {"spin_damping": find_effect("spin_damping", form)().at([0.2])}
    model = ContactModel(find("wang_mason").at(0.12, 0.55), effects=effects)
    path = checkpoint.save(model, tmp_path / "model.pt", provenance={})

    def older(description, tensors):
        description["format"] = 1
        effect = description["model"]["effects"]["spin_damping"]
        effect["options"]["form"] = effect.pop("form")

    for each in (path, changed(tmp_path / "older.pt", path, older)):
        loaded = checkpoint.load(each)
        assert loaded.effects["spin_damping"].id == EffectId("spin_damping", form)
        assert torch.equal(loaded.predict(drops).v_post, model.predict(drops).v_post)


def bomb(kind: str, path: Path) -> Path:
    """A small file that would take much memory or time."""
    if kind == "compressed":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for part in ("model/data.pkl", "model/data/0"):
                with archive.open(part, "w", force_zip64=True) as file:
                    for _ in range(100):
                        file.write(bytes(2**20))
    elif kind == "overlapping":  # one part under many names
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("model/data.pkl", bytes(2**16))
            archive.filelist += [copy.copy(archive.filelist[0]) for _ in range(2**14)]
    else:  # one number that is said to be a large matrix
        checkpoint.save(ContactModel(LAWS["numbers"]), path, provenance={})
        wide = torch.zeros(1, dtype=torch.float64).expand(2**14, 2**13)
        changed(path, path, put("model.base.mu", lambda tensor: wide))
    return path


@pytest.mark.parametrize("kind", ["compressed", "overlapping", "expanded"])
def test_bombs_are_refused_before_they_go_off(tmp_path, kind):
    path = bomb(kind, tmp_path / "model.pt")
    assert path.stat().st_size < 2**22
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    refused(path, "is compressed" if kind != "expanded" else "has tensors of 10737418", "copy the file again")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 2**10  # KiB
    assert time.process_time() - start < 2
