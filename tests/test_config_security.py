"""A file that somebody shared is data: what it names is not imported or called unless the command line names it too."""

import json
import sys
import time
from pathlib import Path

import pytest

from contactlearn.cli import hydra_main
from contactlearn.cli.config_files import CONFIGS, with_diagnosed_model
from contactlearn.cli.config_security import SharedFolder
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import TrainSettings
from contactlearn.cli.sweeps.identity import code_version
from contactlearn.core.errors import ContactLearnError
from contactlearn.laws import find

SMALL = ["model=[]", "data.size=30", "train.size=10", "train.repetitions=2", "laws=[whittaker]"]
MODULE = """
from pathlib import Path
from contactlearn.effects import Effect, columns
from contactlearn.effects.base import parameter
Path(__file__).with_name("imported").touch()
def touch(path): Path(path).touch()
"""
LINE = "is only taken from the command line"
FOREIGN = {
    "a law": ("law: {{_target_: brought.Law}}", "law._target_=brought.Law comes from a file"),
    "an effect": ("effect: {{mine: {{_target_: brought.Mine}}}}",
        "effect.mine._target_=brought.Mine comes from a file"),
    "by reference": ("variant: brought.Mine\neffect: {{mine: {{_target_: '${{variant}}'}}}}", "comes from a file"),
    "in a text": ("effect: {{mine: '${{oc.decode:\"{{_target_: brought.Mine}}\"}}'}}", "comes from a file"),
    "a source": ("data: {{_target_: brought.touch, path: {0}}}", "comes from a file"),
    "through a source": ("data: {{_target_: contactlearn.data.table.os.mkdir, path: {0}}}",
        "must be a source under contactlearn.data"),
    "within data": ("data: {{shape: {{_target_: os.mkdir, path: {0}}}}}", "comes from a file"),
    "a body": ("transfer: {{sizes: [5], seeds: 1, bodies: {{b: {{_target_: brought.touch, path: {0}}}}}}}",
        "comes from a file"),
    "a callback": ("hydra: {{callbacks: {{x: {{_target_: os.mkdir, path: {0}}}}}}}", LINE),
    "a launcher": ("hydra: {{launcher: {{_target_: brought.Launcher}}}}", "no plugin of Hydra's"),
    "a function beside a launcher": (
        "hydra: {{launcher: {{_target_: hydra._internal.core_plugins.basic_launcher.configure_log}}}}",
        "no plugin of Hydra's"),
    "a launcher by reference": ("hydra: {{launcher: '${{law}}'}}\nlaw: {{_target_: brought.Launcher}}", LINE),
    "a shell": ("hydra: {{launcher: {{setup: ['touch {0}']}}}}", LINE),
    "a line of a script": ('hydra: {{launcher: {{partition: "a\\ntouch {0}"}}}}', LINE),
    "words of jobs": ("hydra: {{sweeper: {{params: {{+hydra.callbacks.x._target_: os.mkdir}}}}}}", LINE),
    "a class in words of jobs": ("hydra: {{sweeper: {{params: {{law: '{{_target_: brought.Law}}'}}}}}}", LINE),
    "a log": ("hydra: {{job_logging: {{handlers: {{x: {{(): os.mkdir, path: {0}}}}}}}}}", LINE),
    "a log of Hydra's": ("hydra: {{hydra_logging: {{handlers: {{x: {{class: brought.touch, path: {0}}}}}}}}}", LINE),
    "an object": ("hydra: {{job_logging: {{root: {{level: 'ext://brought.touch'}}}}}}", LINE),
    "an environment": ("hydra: {{job: {{env_set: {{PYTHONPATH: /tmp}}}}}}", LINE),
    "a package to search": ("hydra: {{searchpath: ['pkg://brought']}}", LINE),
    "all of Hydra's": ("hydra: '${{law}}'", "hydra holds Hydra's own settings, and cannot be"),
    "a file in Hydra's place": ("defaults: [/experiment/harmless@hydra.callbacks.x]", "goes into Hydra's settings"),
}  # fmt: skip


@pytest.fixture
def shared(tmp_path, monkeypatch) -> Path:
    """A folder of somebody else's, with a module that leaves a trace when it is imported, from which Python imports."""
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "harmless.yaml").write_text("_target_: os.mkdir\n")
    (tmp_path / "brought.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "brought", raising=False)
    return tmp_path


@pytest.mark.parametrize("several", [False, True], ids=["run", "sweep"])
@pytest.mark.parametrize(("text", "message"), FOREIGN.values(), ids=FOREIGN)
def test_classes_named_by_a_shared_experiment_are_not_run(text, message, several, shared, monkeypatch, capsys):
    content = text.format(shared / "called")
    (shared / "experiment" / "theirs.yaml").write_text(f"# @package _global_\n{content}\n")
    words = ["--config-dir", str(shared), "experiment=theirs", *SMALL, *(["-m"] if several else [])]
    monkeypatch.setattr(sys, "argv", ["evaluate.py", *words])
    with pytest.raises(SystemExit):
        hydra_main.evaluate()
    printed = capsys.readouterr()
    assert message in printed.err
    assert "Traceback" not in printed.err + printed.out
    assert not {"imported", "called"} & {path.name for path in shared.iterdir()}


def refused(words, monkeypatch, capsys):
    """The one line that a command ends with."""
    monkeypatch.setattr(sys, "argv", ["evaluate.py", *words])
    with pytest.raises(SystemExit, match="2"):
        hydra_main.evaluate()
    printed = capsys.readouterr()
    assert len(printed.err.splitlines()) == 1
    return printed.err


@pytest.mark.parametrize("flag", ["--config-dir", "--config-path"])
@pytest.mark.parametrize("package", ["hydra", "hydra.callbacks.x", "_group_"])
def test_a_file_cannot_be_put_where_hydra_looks_for_classes(flag, package, shared, monkeypatch, capsys):
    group = "hydra/callbacks" if package == "_group_" else "experiment"
    (shared / group).mkdir(exist_ok=True, parents=True)
    content = {"hydra": "callbacks: {x: {_target_: os.mkdir, path: called}}"}.get(package, "_target_: os.mkdir")
    (shared / group / "theirs.yaml").write_text(f"# @package {package}\n{content}\n")
    printed = refused([flag, str(shared), f"+{group}=theirs"], monkeypatch, capsys)
    assert LINE in printed
    word = "+experiment@hydra.callbacks.x=theirs"
    assert "would take configuration files unread" in refused([flag, str(shared), word], monkeypatch, capsys)


BOMBS = {
    "aliases": "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9) if k else '1'}]\n" for k in range(12)),
    "references": "".join(f"a{k}: '{f'${{a{k - 1}}}' * 9 if k else '1'}'\n" for k in range(12)),
    "itself": "a: &a [*a]\n",
    "depth": "[" * 20_000,
    "size": "a: 1 #" + "x" * 2**20,
}


@pytest.mark.parametrize("bomb", BOMBS)
@pytest.mark.parametrize("flag", ["--config-dir=.", "--config-path=.", None])
def test_files_that_grow_without_a_bound_are_refused_at_once(bomb, flag, shared, monkeypatch, capsys):
    start = time.monotonic()
    file = shared / ("experiment/theirs.yaml" if flag else "theirs.yaml")
    file.write_text(BOMBS[bomb])
    printed = refused([flag, "experiment=theirs"] if flag else ["data=theirs"], monkeypatch, capsys)
    assert "theirs.yaml: " in printed
    assert time.monotonic() - start < 5


def test_a_pickled_configuration_is_not_read(shared, monkeypatch, capsys):
    assert "would unpickle a file" in refused(["--experimental-rerun", "config.pickle"], monkeypatch, capsys)
    assert "use --config-dir" in refused(["hydra.searchpath=[pkg://brought]"], monkeypatch, capsys)
    assert not (shared / "imported").exists()


@pytest.mark.parametrize("word", [
    "+effect.mine._target_=brought.Mine",
    "+effect.mine={_target_: brought.Mine, form: a}",
    "law._target_='brought.Law'",
])  # fmt: skip
def test_classes_named_on_the_command_line_are_composed(word):
    assert "brought." in str(compose("evaluate", [word]))


def test_the_name_must_be_whole_and_that_of_a_class():
    with pytest.raises(ContactLearnError, match="comes from a file"):
        compose("evaluate", ["+effect.mine._target_=${variant}", "variant=brought.Mine"])


def test_results_that_name_a_module_do_not_import_it(shared):
    """Fields of done.json, such as those of a shared folder of results, are looked up and nothing more."""
    (shared / "brought.py").unlink()
    (shared / "brought").mkdir()
    for name in ("__init__", "inner"):
        (shared / "brought" / f"{name}.py").write_text(MODULE)
    known, unknown = code_version(("brought.inner",)), code_version(("brought.other",))
    assert known.rpartition("=")[2] != unknown.rpartition("=")[2] == "unknown"
    assert not (shared / "brought" / "imported").exists()


def diagnosed(folder: Path, use: str, law: str | None = "mirtich") -> str:
    """The word for the model of a diagnosis whose file has this command and this law."""
    (folder / "diagnosis.json").write_text(json.dumps({"use": use, "diagnosis": {"law": law}}))
    return f"model={folder}"


def test_the_model_of_a_diagnosis_is_its_data_law_and_effects(tmp_path):
    """And nothing else that its file says: no folder to write to, no code of Hydra's."""
    said = (
        "contactlearn evaluate data=mystery data.seed=7 law=mirtich 'effect=[side_drag]' effect.side_drag.form=linear"
    )
    word = diagnosed(tmp_path, f"{said} hydra.run.dir=/x hydra/launcher=joblib +hydra.callbacks.x=1 seed=3 'model=[]'")
    data, model = ["data=mystery", "data.seed=7"], ["law=mirtich", "effect=[side_drag]", "effect.side_drag.form=linear"]
    assert with_diagnosed_model([word, "test=0.5"], "train") == [*data, *model, "model=analytical", "test=0.5"]
    assert with_diagnosed_model([word], "evaluate") == [*data, *model, "model=[]"]
    others = ["data=synthetic", "model=x1_wrench"]
    assert with_diagnosed_model([word, *others], "train") == [*model, *others]
    settings = TrainSettings.from_config(compose("train", [word, "data.seed=8"]))
    assert (settings.law, [*settings.effects], settings.recipe) == (find("mirtich"), ["side_drag"], None)
    assert settings.data.options["seed"] == 8
    assert with_diagnosed_model(["model=x1_wrench,x2_impulse", "-m"], "train") == ["model=x1_wrench,x2_impulse", "-m"]


def test_a_class_in_the_file_of_a_diagnosis_is_not_imported(shared):
    word, own = diagnosed(shared, "contactlearn evaluate +effect.mine._target_=brought.Mine"), "+effect.mine._target_="
    with pytest.raises(ContactLearnError, match=rf"add \{own}brought.Mine to it, if you trust that class"):
        compose("train", [word])
    assert not (shared / "imported").exists()
    assert with_diagnosed_model([word, f"{own}brought.Mine"], "evaluate") == ["model=[]", f"{own}brought.Mine"]


def test_data_of_a_diagnosis_that_are_no_choice_here_are_named_with_the_run_and_the_remedy(tmp_path, monkeypatch):
    """Such as data=mine for mine.yaml of another folder; words of the command take their place."""
    word = diagnosed(tmp_path, "contactlearn evaluate data=mine law=mirtich")
    lacking = rf"^{word} was diagnosed with data=mine, which is missing here: unknown data 'mine'.*add data=… to the"
    with pytest.raises(ContactLearnError, match=lacking):
        compose("evaluate", [word])
    assert with_diagnosed_model([word, "data=synthetic"], "train")[0] == "law=mirtich"
    (tmp_path / "mine.yaml").write_text("defaults: [table]\n")
    monkeypatch.chdir(tmp_path)
    assert with_diagnosed_model([word], "train")[0] == "data=mine"


@pytest.mark.parametrize(("content", "message"), [
    (None, "there is no diagnosis"), ("{", "there is no diagnosis"), ("[]", "there is no diagnosis"),
    ('{"use": 1, "diagnosis": {"law": "mirtich"}}', "there is no diagnosis"),
    ('{"use": "", "diagnosis": {"law": null}}', "its data were refused, so it has no model"),
])  # fmt: skip
def test_a_model_that_is_no_diagnosis_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "diagnosis.json").write_text(content)
    with pytest.raises(ContactLearnError, match=message):
        compose("evaluate", [f"model={tmp_path}"])


def test_each_composition_has_a_shipped_file_of_its_own():
    """It is parsed once; Hydra takes the defaults list out of what it gets."""
    source = SharedFolder("main", f"{SharedFolder.scheme()}://{CONFIGS}")
    first, second = (source.load_config("train") for _ in range(2))
    del first.config["defaults"]
    first.header["package"] = "elsewhere"
    third = source.load_config("train")
    assert second.config == third.config
    assert "defaults" in third.config
    assert third.header["package"] is None


def test_a_shipped_file_that_changes_is_read_again(tmp_path):
    source = SharedFolder("main", f"{SharedFolder.scheme()}://{tmp_path}")
    for seed in (3, 1234):
        (tmp_path / "train.yaml").write_text(f"seed: {seed}\n")
        assert source.load_config("train").config == {"seed": seed}
