"""The words of a command line: paths as shells give them, flags in any order, and what Hydra's users try."""

import json
import os
import re
import shlex
from pathlib import Path

import pytest
from commands import run
from omegaconf import OmegaConf

from contactlearn.cli.command_line import parse_command_line, parse_override, quoted, quoted_path
from contactlearn.cli.hydra_main import completed, compose
from contactlearn.core.errors import ContactLearnError
from contactlearn.data import table
from contactlearn.results.folder import read_result
from contactlearn.simulation import synthetic

SMALL = ("data.size=80", "train.size=10", "train.repetitions=2", "bootstrap=20", "model=analytical")
SHAPE = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
NAMES = [
    "a&b.csv", "Kügel.csv", "数据.csv", "😀.csv", "d(1).csv", "a=b.csv", "a,b.csv", "a b.csv", "it's.csv", 'q"q.csv',
    "[x].csv", "{x}.csv", "a$b.csv", "a${b}.csv", "a\\b.csv", "a;b#c.csv", "-a.csv", "!*?.csv", "a:b.csv", "a\tb.csv",
    " a .csv", "50%.csv", "a+b|c.csv", "'quoted'.csv", "a\\'b.csv", "2026", "null.csv", "~x.csv",
]  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory which is the home folder too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("name", NAMES)
def test_a_path_is_what_the_shell_gives(name, here):
    Path(name).write_text("")
    for given, path in (
        (name, name),
        (f"./{name}", f"./{name}"),
        (f"~/{name}", f"{here}/{name}"),
        (f"{here}/{name}",) * 2,
    ):
        words = completed(["data=table", f"checkpoint={given}", f"data.path={given}"], "evaluate")
        for word in words[1:3]:  # as a composition reads them
            assert OmegaConf.create([parse_override(word).value()])[0] == path
    cfg = compose("evaluate", ["data=table", f"checkpoint=~/{name}", f"data.path={name}"])
    assert (cfg.checkpoint, cfg.data.path) == (f"{here}/{name}", name)
    assert compose("train", ["data=table", f"data.path={quoted_path(name)}"]).data.path == name


def test_letters_of_any_language_need_no_quotes():
    given = 'data.columns={object: Körper, mass: "Masse [g]", vx: größe x}'
    (word,) = quoted([given])
    assert word == 'data.columns={object: "Körper", mass: "Masse [g]", vx: "größe x"}'
    assert parse_override(word).value() == {"object": "Körper", "mass": "Masse [g]", "vx": "größe x"}
    assert quoted(["data.covariates=[Bediener, Härte]"]) == ['data.covariates=[Bediener, "Härte"]']
    assert parse_command_line(["--", "train.size=10"]).words == ("train.size=10",)


def test_a_path_that_is_not_there_is_named_whole(here):
    assert compose("train", ["data=table", "data.path=~/nö where.csv"]).data.path == f"{here}/nö where.csv"
    assert compose("train", ["data=table", "data.path='a b.csv'"]).data.path == "a b.csv"
    assert compose("train", ["data=table", "data.path=${variant}.csv"]).data.path == "textbook.csv"
    assert compose("evaluate", ["data=table", "checkpoint=[a b.pt,é.pt]"]).checkpoint == ["a b.pt", "é.pt"]


def test_paths_are_swept_over_unless_a_file_has_a_comma(here):
    for name in ("a&b.csv", "ü.csv"):
        table.save(synthetic.load(size=60, seed=len(name)), name)
    words = ("-m", *SMALL[1:], "data=table", SHAPE, "hydra.sweep.dir=a sweep, of two")
    assert "2 finished" in run("train.py", *words, "data.path=a&b.csv,ü.csv", cwd=here)
    with pytest.raises(ContactLearnError, match="has several values: add -m to run each"):
        quoted(["data.path=a&b.csv,ü.csv"])
    Path("a&b.csv").rename("a,b.csv")
    assert "1 finished" in run("train.py", *words, "data.path=a,b.csv", cwd=here)


def test_a_run_of_any_name_is_a_model_and_a_checkpoint(here):
    folder = "out, [é] (1)"
    printed = run("train.py", *SMALL, f"hydra.run.dir={folder}", cwd=here)
    judged = re.search(r"^next: contactlearn evaluate (.*)$", printed, re.MULTILINE)
    words = [word for word in shlex.split(judged[1]) if not word.startswith("data")]
    words += ["data=synthetic", "data.size=40", "bootstrap=20", "train.repetitions=2"]
    words += ["train.size=10", "laws=[whittaker]", "figures.repetitions=1", "hydra.run.dir=judged"]
    run("evaluate.py", *words, cwd=here)
    (judged,) = read_result(here / "judged" / "results.json").trained.values()
    assert judged.path == f"{folder}/model.pt"
    Path(folder, "diagnosis.json").write_text(
        json.dumps({"use": "contactlearn evaluate law=mirtich", "diagnosis": {"law": "mirtich"}})
    )
    for word in (f"model={folder}", f"model={here / folder}", f"model=~/{folder}"):
        assert "Mirtich" in compose("train", [word]).law._target_


def test_flags_and_folders_come_in_any_order(here):
    Path("my cfg/experiment").mkdir(parents=True)
    Path("my cfg/experiment/mine.yaml").write_text("# @package _global_\nseed: 5\n")
    for words in (
        ("train.size=10", "-m", "--config-dir", "~/my cfg", "experiment=mine"),
        ("--config-dir=my cfg", "train.size=10", "experiment=mine", "--multirun"),
        ("-cp", "my cfg", "train.size=10", "experiment=mine", "hydra.mode=MULTIRUN"),
    ):
        line = parse_command_line(words)
        assert line.several
        assert str(here / "my cfg") in line.folders
        assert set(line.words) >= {"train.size=10", "experiment=mine"}
        printed = run("train.py", *words, *SMALL[0:1], *SMALL[2:], "hydra.sweep.dir=s", cwd=here)
        assert "1 finished" in printed
    assert len(list(here.glob("s/*/done.json"))) == 1


def test_a_choice_needs_no_plus(here):
    assert compose("train", ["+law=mirtich"]) == compose("train", ["law=mirtich"])


@pytest.mark.parametrize(("words", "message"), [
    (["train.size=10,20"], "train.size=10,20 has several values: add -m to run each"),
    (["law=mirtich,whittaker"], "law=mirtich,whittaker has several values: add -m to run each"),
    (["law=glob(*mason*)"], "law=wang_mason,wang_mason_newton has several values: add -m to run each"),
    (["law=glob(xx*)"], "law=glob(xx*) matches no law; known: anitescu_potra_newton"),
    (["seed=glob(1*)"], "glob(…) takes choices, of data, effect, experiment, law, model; seed has none"),
    (["data=würfe"], "no file würfe.yaml is in this folder; NAME.yaml has the letters a to z, digits and _"),
    (["+x=1"], "unknown setting 'x'"),
    (["++x=1"], "unknown setting 'x'"),
    (["x"], "'x' is no setting; settings are written key=value"),
    (["drops.csv"], "'drops.csv' is no setting; say data=table data.path=drops.csv"),
    (["data.path=[a.csv,b.csv]"], "a path is that of one file or folder; join several tables into one"),
    (["effect=[side_drag"], "effect=[side_drag has more [ than ]"),
    (["effect=side_drag,"], "effect=side_drag, ends in a comma: write a list as 'effect=[…,…]'"),
    (["~law"], "every command needs law; choose another with law=…"),
    (["~train.size"], "train.size cannot be taken out"),
    (["data.seed=ü"], "seed must be an integer, at least 0, got 'ü'"),
    (["data.seed={a (b}"], "stands in double quotes"),
    (["data.seed=${nope}"], "Interpolation key 'nope' not found"),
    (["--data", "mystery"], "unknown flag '--data'; settings are written data=VALUE"),
    (["--data=mystery"], "unknown flag '--data=mystery'; settings are written data=mystery"),
    (["--multirn"], "unknown flag '--multirn', did you mean '--multirun'?"),
    (["-m", "--cfg", "job"], "--cfg shows something and runs nothing"),
    (["--config-dir", "nowhere"], "no such folder of configuration files"),
    (["-m", "hydra/sweeper=optuna"], "no hydra/sweeper 'optuna' is installed; there are basic"),
    (["law@x=mirtich"], "Could not override 'law@x'. Did you mean to override law?"),
])  # fmt: skip
def test_what_cannot_be_meant_is_one_line(words, message, here):
    printed = run("train.py", *words, cwd=here, status=2)
    assert message in printed
    assert len(printed.splitlines()) == 1
    assert not list(here.iterdir())


@pytest.mark.parametrize(("words", "shown"), [
    (["--cfg", "job", "--package", "train"], "repetitions: 100"),
    (["--info", "defaults"], "law/wang_mason"),
    (["--info", "train.size=10"], "Config search path"),
    (["--hydra-help", "train.size=10"], "hydra/launcher"),
    (["-sc", "install=bash"], "hydra_bash_completion"),
])  # fmt: skip
def test_what_hydra_shows(words, shown, here, capfd):
    assert shown in run("train.py", *words, cwd=here) + capfd.readouterr().out
    assert not list(here.iterdir())


def test_words_complete(here, monkeypatch):
    monkeypatch.setenv("COMP_LINE", "python train.py law=mirt")
    monkeypatch.setenv("COMP_POINT", "24")
    assert run("train.py", "-sc", "query=bash", cwd=here).strip() == "law=mirtich"


def test_a_part_without_choices(here):
    assert compose("train", ["effect=[spin_damping]", "~effect"]).effect == {}
    assert compose("evaluate", ["~model"]).model == {}


@pytest.mark.parametrize("several", [False, True])
def test_commands_printed_after_hydra_changed_the_folder_work(several, here):
    """Paths mean what they mean where the user stands, those of the data too."""
    table.save(synthetic.load(size=60), "drops.csv")
    words = [*SMALL[1:], "data=table", "data.path=drops.csv", SHAPE, "hydra.job.chdir=true", *["-m"] * several]
    printed = run("train.py", *words, cwd=here)
    folder = re.search(r"^results: (.*)$", printed, re.MULTILINE)[1]
    assert Path(folder).is_dir()
    assert os.getcwd() == str(here)
    judged = re.search(r"^next: contactlearn evaluate (checkpoint=.*?) data=.*$", printed, re.MULTILINE)[1]
    assert "data.path=drops.csv" in printed.rpartition("next: ")[2]
    model = compose("evaluate", [*shlex.split(judged), "data=synthetic"]).checkpoint
    assert Path(model) == Path(folder) / "model.pt"
    assert Path(model).is_file()
    if several:
        shown = re.search(r"^compare: contactlearn report (.*)$", printed, re.MULTILINE)[1]
        assert "report: " in run("contactlearn", "report", *shlex.split(shown), cwd=here)


def test_an_error_after_hydra_changed_the_folder_is_that_of_the_settings(here):
    """The folder of a run that fails before it computed anything is gone by then."""
    words = [*SMALL[1:], "+effect.push._target_=contactlearn.laws.mirtich.Mirtich", "hydra.job.chdir=true"]
    assert "must be a subclass of contactlearn.effects.Effect" in run("train.py", *words, cwd=here, status=2)


@pytest.mark.parametrize("words", [("export", "there.csv"), ("results", ".", "-o", "there.csv")])
def test_a_file_is_replaced_by_force_alone(words, here):
    run("train.py", *SMALL, "hydra.run.dir=a", cwd=here)
    Path("there.csv").write_text("mine")
    refused = run("contactlearn", *words, cwd=here, status=2)
    assert refused == "error: there.csv is there already and is not replaced; choose another name, or add --force\n"
    assert Path("there.csv").read_text() == "mine"
    run("contactlearn", *words, "--force", cwd=here)
    assert Path("there.csv").read_text() != "mine"


@pytest.mark.parametrize("to", ["numpy", "json", "mujoco"])
def test_an_export_replaces_nothing(to, here):
    run("train.py", *SMALL, "hydra.run.dir=a", cwd=here)
    run("contactlearn", "export", "a", "--to", to, "data=synthetic", "data.size=20", cwd=here)
    (file,) = here.glob("impact.*")
    before = file.read_bytes()
    file.write_bytes(b"mine")
    words = ("contactlearn", "export", "a", "--to", to, "data=synthetic", "data.size=20")
    assert "is not replaced" in run(*words, cwd=here, status=2)
    assert file.read_bytes() == b"mine"
    run(*words, "--force", cwd=here)
    assert file.read_bytes() == before
