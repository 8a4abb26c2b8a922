"""The setting `device`: one clear line where there is no GPU, or where its memory runs out."""

import pytest
import torch
from commands import run

from contactlearn.core import devices
from contactlearn.core.devices import moved
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import find
from contactlearn.simulation import synthetic

SMALL = ("data.size=32", "train.size=10", "train.repetitions=2", "bootstrap=20", "model=analytical")


def test_what_is_there_already_is_not_copied():
    drops = synthetic.load(size=40)
    law = find("wang_mason").at(0.1, 0.5)
    model = learn(drops, Recipe("x1", "wrench", law), rows=torch.arange(30), base=law)
    for thing in (drops, model, {"a": (model, [drops.mass])}, law, "text", None):
        assert moved(thing, "cpu") is thing


def test_a_gpu_that_is_not_there_is_one_clear_line(monkeypatch, tmp_path):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.version, "cuda", None)
    for command in ("train.py", "evaluate.py"):
        printed = run(command, "device=cuda", f"hydra.run.dir={tmp_path / 'a'}", status=2)
        assert printed == (
            f"error: device=cuda needs a GPU, and PyTorch {torch.__version__}, built for the CPU alone, sees none; "
            "install one for CUDA, see pytorch.org, or use device=cpu\n"
        )
    assert not (tmp_path / "a").exists()
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    with pytest.raises(ContactLearnError, match=r"built for 13.0, sees none; look at the driver"):
        devices.find("cuda")
    assert devices.find("auto") == torch.device("cpu")


def test_a_full_gpu_is_one_clear_line(monkeypatch, tmp_path):
    def full(*_, **__):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")

    monkeypatch.setattr(bounds, "irb", full)
    printed = run("train.py", *SMALL, f"hydra.run.dir={tmp_path / 'a'}", status=2)
    assert printed.splitlines()[-1] == "error: the GPU's memory ran out; use fewer trials, or device=cpu"


def test_auto_takes_the_gpu_that_is_there(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert [devices.find(name).type for name in devices.NAMES] == ["cuda", "cpu", "cuda"]
    with pytest.raises(UnknownNameError, match="unknown device 'cudaa', did you mean 'cuda'"):
        devices.find("cudaa")
    assert "unknown device 'gpu'" in run("train.py", "device=gpu", status=2)


def test_processes_side_by_side_are_for_the_cpu(monkeypatch):
    monkeypatch.setattr(devices, "find", lambda name: torch.device("cuda"))
    printed = run("evaluate.py", "device=cuda", "workers=2", status=2)
    assert printed == "error: workers=2 is for the CPU; with device=cuda use workers=1\n"


@pytest.mark.parametrize("word", ["device=cuda", "+device=cuda"])
def test_what_stays_on_the_cpu_has_no_such_setting(word):
    printed = run("diagnose.py", word, status=2)
    start = "error: device is a setting of train and evaluate only"
    assert printed == f"{start}; --settings lists those of this command\n"
