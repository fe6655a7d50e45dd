"""Files given by name: what is no regular file, too large or no text is refused, and nothing waits or is left open."""

import os
from pathlib import Path

import pytest

from surefoot.files import MAX_FILE_BYTES, FileError, read_regular, read_text
from tests.surefoot.expect import expect_error


def open_files() -> set[str]:
    return set(os.listdir("/proc/self/fd"))


def test_a_file_of_the_most_bytes_is_read_and_one_of_one_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"x" * 100)
    assert read_regular(path, 100) == b"x" * 100
    with expect_error(FileError, "value", field="file", text="more than 99 bytes"):
        read_regular(path, 99)


def test_a_text_of_the_most_bytes_is_read_and_one_of_one_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("x" * MAX_FILE_BYTES)
    assert len(read_text(path, FileError)) == MAX_FILE_BYTES
    path.write_text("x" * (MAX_FILE_BYTES + 1))
    with expect_error(FileError, "value", text=f"has {MAX_FILE_BYTES + 1} bytes, allowed are {MAX_FILE_BYTES}"):
        read_text(path, FileError)


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="lists open files of Linux")
@pytest.mark.parametrize("kind", ["absent", "folder", "pipe", "device"])
def test_what_is_no_regular_file_is_refused_at_once_and_nothing_stays_open(tmp_path: Path, kind: str) -> None:
    path = Path("/dev/zero") if kind == "device" else tmp_path / kind
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    before = open_files()
    code = "value" if kind in ("pipe", "device") else "not_found"
    with expect_error(FileError, code, field="file", text=str(path)):
        read_regular(path, 100)
    with expect_error(FileError, "not_found", field="file", text=str(path)):
        read_text(path, FileError)
    assert open_files() == before


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xff\xfe")
    with expect_error(FileError, "syntax", text="UTF-8"):
        read_text(path, FileError)
