"""Model files: the first byte says whether the rest is a file, the pickle in one, or the description of one.

A file's checksums stop nearly every change of a byte, so its pickle and its description are put into a sound file.
"""

import io
import json
import zipfile

import torch

from contactlearn import laws
from contactlearn.effects import find_effect
from contactlearn.effects.formula import formula
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic
from fuzz.target import Target, file

FILE, PICKLE, DESCRIPTION = range(3)
DROPS = synthetic.load(size=6)
LAW = laws.find("wang_mason").at(0.2, 0.5)


def _models() -> list[ContactModel]:
    mine = formula(parameters={"c": [-1, 1]}, tau="-c*rx*Pn")
    effects = {"spin_damping": find_effect("spin_damping", "during")().at([0.2]), "mine": mine}
    learned = learn(DROPS, Recipe("x2", "impulse", LAW), rows=torch.arange(6), base=LAW)
    return [ContactModel(LAW), ContactModel(laws.find("chatterjee_ruina", e_t=0.3), effects=effects), learned]


def _saved(model: ContactModel) -> bytes:
    with file(b"", ".pt") as path:
        return checkpoint.save(model, path, provenance={"data": "Ω"}).read_bytes()


SAVED = [_saved(model) for model in _models()]
TENSORS = [torch.load(io.BytesIO(content), weights_only=True)["tensors"] for content in SAVED]


def read(content: bytes) -> None:
    """Load a checkpoint that is, or is made of, these bytes; what is loaded must predict."""
    kind, model = (content[0] % 3, content[0] // 3 % len(SAVED)) if content else (FILE, 0)
    whole = content[1:]
    if kind == PICKLE:
        whole = _with_pickle(SAVED[model], whole)
    elif kind == DESCRIPTION:
        out = io.BytesIO()
        torch.save({"description": whole.decode("utf-8", "replace"), "tensors": TENSORS[model]}, out)
        whole = out.getvalue()
    with file(whole, ".pt") as path:
        checkpoint.load(path)


def _with_pickle(saved: bytes, pickled: bytes) -> bytes:
    """A file with another pickle in it, and the right checksums."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, pickled if name.endswith("data.pkl") else old.read(name))
    return out.getvalue()


def seeds() -> list[bytes]:
    """Whole files, pickles and descriptions of a law, a law with effects, and a learned model."""
    found = []
    for place, saved in enumerate(SAVED):
        with zipfile.ZipFile(io.BytesIO(saved)) as archive:
            pickled = archive.read(next(name for name in archive.namelist() if name.endswith("data.pkl")))
        description = torch.load(io.BytesIO(saved), weights_only=True)["description"]
        parts = {FILE: saved if place == 0 else b"", PICKLE: pickled, DESCRIPTION: json.dumps(json.loads(description))}
        for kind, part in parts.items():
            found.append(bytes([kind + 3 * place]) + (part.encode() if isinstance(part, str) else part))
    return found


KINDS = ["ContactModel", "Regressor", "Standardisation", "ExactGPs", "SparseGPs", "Law", "effect", "effects"]
TARGET = Target(
    read, seeds,
    words=[
        *KINDS, '"kind": ', "null", "1e999", "[[[[", "cos\nsystem\n", "ctorch._utils\n_rebuild_tensor_v2\n",
        "\x80\x02", ".",
    ],
    watched=["torch._weights_only_unpickler"],
)  # fmt: skip
