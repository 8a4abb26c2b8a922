"""Packed files: they are read as what they hold, in memory and within bounds, and names in them lead nowhere else."""

import bz2
import gzip
import lzma
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import pytest
import torch
from refusals import refused

from contactlearn.data import packed, table
from contactlearn.data.headers import propose
from contactlearn.data.recordings.readers import Layout, read, recording_files
from contactlearn.simulation import synthetic
from contactlearn.simulation.recordings import simulate, write_recordings

SHAPE = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}
PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


@pytest.fixture
def written(tmp_path) -> Path:
    """A table in the formats that can be written, and as tabs."""
    drops = synthetic.load(size=12)
    for suffix in (".csv", ".parquet"):
        table.save(drops, tmp_path / f"drops{suffix}")
    drops.to_frame().to_csv(tmp_path / "drops.tsv", sep="\t", index=False)
    drops.to_frame().to_excel(tmp_path / "drops.xlsx", index=False)
    drops.to_frame().to_json(tmp_path / "drops.json", orient="records", double_precision=15)
    return tmp_path


def zipped(path: Path, files: dict[str, bytes | Path]) -> Path:
    """An archive of files by their names."""
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name, content in files.items():
            content = content.read_bytes() if isinstance(content, Path) else content
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize("packer", [*PACKERS, ".zip"])
@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".parquet", ".xlsx", ".json"])
def test_a_packed_table_is_the_table(written, packer, suffix):
    plain = written / f"drops{suffix}"
    path = written / f"drops{suffix}{packer}"
    if packer == ".zip":
        junk = {"README.txt": b"drops", "__MACOSX/._drops.csv": b"\0", "figure.png": b"\0"}
        zipped(path, {f"study/drops{suffix}": plain, **junk})
    else:
        path.write_bytes(PACKERS[packer](plain.read_bytes()))
    found, wanted = table.load(path, SHAPE), table.load(plain, SHAPE)
    assert torch.equal(found.v_post, wanted.v_post)
    assert len(table.table_blocks(path, None).pick(torch.ones(12, dtype=torch.bool))) == 12
    proposed, same = propose(path), propose(plain)
    assert (proposed.source, proposed.settings[1:]) == (same.source, same.settings[1:])
    assert proposed.settings[0].value == str(path)


def test_an_archive_of_several_tables_says_how_to_choose(written):
    path = zipped(written / "study.zip", {"b.csv": written / "drops.csv", "a.csv": written / "drops.csv"})
    for use in (table.load, propose):
        with refused([f"{path}: holds 2 tables, a.csv, b.csv; give one, such as {path}/a.csv"]):
            use(path)
    assert len(table.load(path / "b.csv")) == 12
    assert propose(path / "b.csv").source == "table"
    with refused(["holds no file c.csv; it has b.csv, a.csv"]):
        table.load(path / "c.csv")
    with refused(["holds no table, which is a .csv or"]):
        table.load(zipped(written / "none.zip", {"figure.png": b"\0"}))


@pytest.mark.parametrize("packer", [*PACKERS, ".zip"])
def test_packed_recordings_are_the_recordings(tmp_path, packer):
    takes, _ = simulate(3, seed=1)
    folder = tmp_path / "takes"
    folder.mkdir()
    write_recordings(takes, folder)
    files = recording_files(folder)
    if packer == ".zip":
        path = zipped(tmp_path / "takes.zip", {f"takes/{one.name}": one for one in files})
    else:
        files = files[:1]
        path = tmp_path / f"{files[0].name}{packer}"
        path.write_bytes(PACKERS[packer](files[0].read_bytes()))
    for one, plain in zip(recording_files(path), files, strict=True):
        (found,), (wanted,) = read(one, Layout()), read(plain, Layout())
        assert (found.name, found.position.tolist()) == (wanted.name, wanted.position.tolist())
        assert (found.time == wanted.time).all()
    assert propose(path).source == propose(folder).source == "tracks"


@pytest.mark.parametrize("name", ["../drops.csv", "/etc/drops.csv", "a/../../drops.csv"])
def test_a_name_leads_to_nothing_outside(written, name):
    path = zipped(written / "evil.zip", {name: written / "drops.csv"})
    for use in (table.load, propose, recording_files):
        with refused(["which leads out of it; pack it again"]):
            use(path)
    for way in ("../drops.csv", "study/../../drops.csv"):
        with refused(["holds no file"]):
            table.load(zipped(written / "good.zip", {"drops.csv": written / "drops.csv"}) / way)


@pytest.mark.parametrize("packer", [*PACKERS, ".zip"])
def test_what_is_too_large_unpacked_is_refused(tmp_path, monkeypatch, packer):
    monkeypatch.setattr(packed, "LARGEST", 2**20)
    bomb, path = b"0" * (2**20 + 1), tmp_path / f"drops.csv{packer}"
    if packer == ".zip":
        zipped(path, {"drops.csv": bomb})
    else:
        path.write_bytes(PACKERS[packer](bomb))
    for use in (table.load, propose):
        with refused(["takes more than 1 MiB unpacked"]):
            use(path)


@pytest.mark.parametrize("packer", [*PACKERS, ".zip"])
def test_a_damaged_archive_is_one_line(written, packer):
    path = written / f"drops.csv{packer}"
    content = (written / "drops.csv").read_bytes()
    whole = zipped(path, {"drops.csv": content}).read_bytes() if packer == ".zip" else PACKERS[packer](content)
    for part in (whole[: len(whole) // 2], b"x" + whole[1:] if packer != ".zip" else b"x"):
        path.write_bytes(part)
        for use in (table.load, propose):
            with refused(["cannot be unpacked ("]):
                use(path)


def test_a_format_that_is_read_from_disk_only(tmp_path):
    path = zipped(tmp_path / "study.zip", {"drops.db": b"SQLite format 3\0"})
    with refused([".db cannot be read while it is packed; unpack it first"]):
        table.load(path)
