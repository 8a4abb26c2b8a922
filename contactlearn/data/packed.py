"""Files that are packed: drops.csv.gz, .bz2 and .xz, and the files in a .zip, which is read as if it were a folder.

A packed file is called `study.zip/drops.csv`, or `drops.csv.gz/drops.csv`.  It is unpacked in memory, up to `LARGEST`
bytes, and never on disk; its name only finds it in the archive.
"""

import bz2
import gzip
import lzma
import zlib
from collections.abc import Collection
from functools import lru_cache
from io import BytesIO, TextIOWrapper
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, TextIO
from zipfile import BadZipFile, ZipFile

from contactlearn.core.errors import DataError

LARGEST = 2**29
"""Bytes of a file when it is unpacked, at most."""
_STREAMS = {".gz": gzip.GzipFile, ".bz2": bz2.BZ2File, ".xz": lzma.LZMAFile}
ARCHIVES = (".zip", *_STREAMS)
"""Suffixes of packed files."""
UNREAD = (".7z", ".tar", ".tgz", ".rar", ".zst")
"""Suffixes of archives that are not read."""
_BESIDE = ("readme", "license", "__macosx", ".")  # beginnings of names that are no data
_CHUNK = 2**20  # bytes that are unpacked at a time
_SHOWN = 5  # names of files in an error
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, BadZipFile, RuntimeError, NotImplementedError, ValueError)


def is_archive(path: Path) -> bool:
    """Return whether a file is packed."""
    return path.suffix.lower() in ARCHIVES and path.is_file()


def exists(path: Path) -> bool:
    """Return whether there is such a file or folder, or such a file in an archive."""
    return path.exists() or _archive_of(path) is not None


def is_single(path: Path) -> bool:
    """Return whether it is one file, which is not packed or a file in an archive."""
    return (path.is_file() and not is_archive(path)) or _archive_of(path) is not None


def files_in(archive: Path, suffixes: Collection[str]) -> list[Path]:
    """Return the files in an archive that have one of some suffixes, by name.

    Raises:
        DataError: the archive is damaged, or a name in it leads out of it.
    """
    if archive.suffix.lower() in _STREAMS:
        names = [archive.stem]
    else:
        try:
            with ZipFile(archive) as content:
                names = sorted({*content.namelist()})
        except _DAMAGED as error:
            raise _damaged(archive, error) from None
    plain = [PurePosixPath(name) for name in names if not name.endswith("/")]
    for name in plain:
        if name.is_absolute() or ".." in name.parts or not str(name).isprintable():
            raise DataError(f"{archive}: has a file with the name {str(name)!r}, which leads out of it; pack it again")
    own = [name for name in plain if not any(part.lower().startswith(_BESIDE) for part in name.parts)]
    return [archive / name for name in own if name.suffix.lower() in suffixes]


def only_file(path: Path, suffixes: Collection[str], what: str) -> Path:
    """Return the only such file in an archive; another path as it is.

    Raises:
        DataError: there is none, or more than one.
    """
    if not is_archive(path):
        return path
    found = files_in(path, suffixes)
    if not found:
        raise DataError(f"{path}: holds no {what}, which is a {' or '.join(suffixes)} file")
    if len(found) > 1:
        raise DataError(f"{path}: {several(path, found, what)}")
    return found[0]


def several(path: Path, found: Collection[Path], what: str) -> str:
    """Return how to choose one of several files in a folder or an archive."""
    names = [str(one.relative_to(path)) for one in found]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    counted, choose = (f"1 {what}", "give it:") if len(names) == 1 else (f"{len(names)} {what}s", "give one, such as")
    return f"holds {counted}, {', '.join(names[:_SHOWN])}{more}; {choose} {next(iter(found))}"


def opened_bytes(path: Path) -> BinaryIO:
    """Open a file, packed or not."""
    return path.open("rb") if _archive_of(path) is None else BytesIO(_content(path))


def opened_text(path: Path, *, encoding: str, errors: str | None = None, newline: str | None = None) -> TextIO:
    """Open a text, packed or not."""
    if _archive_of(path) is None:
        return path.open(encoding=encoding, errors=errors, newline=newline)
    return TextIOWrapper(opened_bytes(path), encoding=encoding, errors=errors, newline=newline)


def for_library(path: Path) -> Path | BinaryIO:
    """Return what a library reads: a file by its path, a packed one as its content."""
    return path if _archive_of(path) is None else opened_bytes(path)


def on_disk(path: Path) -> Path:
    """Return the path of a file for a library that reads nothing else.

    Raises:
        DataError: it is packed.
    """
    if _archive_of(path) is not None:
        raise DataError(f"{path}: {path.suffix} cannot be read while it is packed; unpack it first")
    return path


def size_of(path: Path) -> int:
    """Return the number of bytes of a file when it is unpacked."""
    return path.stat().st_size if _archive_of(path) is None else len(_content(path))


def _archive_of(path: Path) -> Path | None:
    """The archive that a file is in; None of a file that is not packed."""
    return next((one for one in path.parents if one.suffix.lower() in ARCHIVES and one.is_file()), None)


def _content(path: Path) -> bytes:
    archive = _archive_of(path)
    assert archive is not None
    about = archive.stat()
    return _unpacked(archive, path.relative_to(archive).as_posix(), about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=1)
def _unpacked(archive: Path, name: str, changed: int, size: int) -> bytes:
    """The content of a packed file, which readers open several times."""
    del changed, size  # of the archive: another one is unpacked again
    try:
        if stream := _STREAMS.get(archive.suffix.lower()):
            if name != archive.stem:
                raise DataError(f"{archive}: holds {archive.stem}, and no {name}")
            with stream(archive) as file:
                return _bounded(archive / name, file)
        with ZipFile(archive) as content:
            if name not in content.namelist():
                raise DataError(f"{archive}: holds no file {name}; it has {', '.join(content.namelist()[:_SHOWN])}")
            with content.open(name) as file:
                return _bounded(archive / name, file)
    except DataError:
        raise
    except _DAMAGED as error:
        raise _damaged(archive, error) from None


def _bounded(path: Path, file: Any) -> bytes:
    found = BytesIO()
    while chunk := file.read(_CHUNK):
        found.write(chunk)
        if found.tell() > LARGEST:
            raise DataError(f"{path}: takes more than {LARGEST >> 20} MiB unpacked; unpack it, or write Parquet")
    return found.getvalue()


def _damaged(archive: Path, error: BaseException) -> DataError:
    why = " ".join(str(error).split()) or type(error).__name__
    return DataError(f"{archive}: cannot be unpacked ({why}); unpack it with the program that packed it")
