"""Tables on the output: whole at any width, blocks of lines where columns do not fit, plain for pipes and programs."""

import fcntl
import os
import pty
import random
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from surefoot.lab.cli.table import table_lines

COLUMNS = ("parameter", "value", "default", "set", "unit and meaning")
ROOT = Path(__file__).resolve().parents[3]
WORDS = ("gain", "m/s^2,", "of", "the", "inertial", "unit", "0.003", "accelerometer", "a")


def rows(seed, count=6):
    draw = random.Random(seed)
    texts = [" ".join(draw.choices(WORDS, k=draw.randint(0, 12))) for _ in range(count)]
    return [(f"name_{number}", str(draw.random()), "0.0", "", text) for number, text in enumerate(texts)]


def words(lines):
    return sorted(word for line in lines for word in line.split())


@pytest.mark.parametrize("width", range(20, 141, 4))
@pytest.mark.parametrize("seed", range(3))
def test_no_line_is_wider_than_the_terminal_and_nothing_is_lost(seed, width):
    table = rows(seed)
    lines = list(table_lines(COLUMNS, table, (1, 2), width))
    longest = max(len(word) for row in table for word in " ".join(row).split())
    assert max(map(len, lines)) <= max(width, len("unit and meaning: ") + longest)
    shown = words(lines)
    for word in set(words(cell for row in table for cell in row)):
        assert shown.count(word) >= words(cell for row in table for cell in row).count(word)


def test_columns_that_fit_are_aligned_and_others_become_blocks():
    table = [("walker", 12, "state/velocity silent for 2 s"), ("recorder", 7, "")]
    assert list(table_lines(("service", "pid", "remarks"), table, (1,), 80)) == [
        "service   pid  remarks",
        "--------------------------------------------",
        "walker     12  state/velocity silent for 2 s",
        "recorder    7",
    ]
    assert list(table_lines(("service", "pid", "remarks"), table, (1,), 24)) == [
        "service: walker",
        "pid: 12",
        "remarks: state/velocity",
        "  silent for 2 s",
        "",
        "service: recorder",
        "pid: 7",
    ]


def test_cells_are_wrapped_before_rows_become_blocks():
    lines = list(table_lines(("scenario", "what happens"), [("push", "Ragno walks 1 m and is pushed twice")], (), 40))
    assert lines[2:] == ["push      Ragno walks 1 m and is pushed", "          twice"]


def test_a_row_of_a_pipe_is_one_line():
    table = rows(5)
    assert len(list(table_lines(COLUMNS, table))) == 2 + len(table)


def test_numbers_by_name_are_written_as_text():
    (*_, line) = table_lines(["quantity", "value"], [["choice", {"r2": 0.43521891, "kind": "planes", "cells": 3}]])
    assert line == "choice    r2 0.4352, kind planes, cells 3"


def test_styles_are_written_for_terminals_only():
    row = [(("FAIL", "bold red"), "port")]
    assert "\x1b" not in "".join(table_lines(("", "what"), row, (), 40))
    assert "\x1b[31m\x1b[1mFAIL\x1b[0m  port" in list(table_lines(("", "what"), row, (), 40, coloured=True))


def on_a_terminal(columns, *words, **environment):
    """Return what a command writes to a terminal of so many columns."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    command = [sys.executable, "-m", "surefoot.lab.cli.entry", *words]
    process = subprocess.Popen(command, stdout=slave, stderr=slave, env={**os.environ, **environment})
    os.close(slave)
    written = b""
    while piece := _read(master):
        written += piece
    os.close(master)
    assert process.wait(60) == 0
    return written.decode().replace("\r\n", "\n")


def _read(master):
    try:
        return os.read(master, 65536)
    except OSError:  # the other end is closed
        return b""


def test_a_word_longer_than_the_line_follows_its_name():
    assert list(table_lines(("quantity", "value"), [("hash", "f" * 30)], width=20)) == [
        "quantity: hash",
        "value:",
        "  " + "f" * 30,
    ]


def test_a_table_of_five_columns_in_a_terminal_of_40(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    out = on_a_terminal(40, "topic", "info", "state/velocity", NO_COLOR="1")
    assert "\x1b" not in out
    table = out.split("VelocityEstimate\n")[-1]
    assert max(len(line) for line in table.splitlines() if " " in line.strip()) <= 40
    assert "field: velocity\ntype: [number, number, number]\ndefault: required\n" in table
    assert "\x1b[1mfield\x1b[0m" in on_a_terminal(200, "topic", "info", "state/velocity", TERM="xterm", NO_COLOR="")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_a_character_gets_another(tmp_path, encoding):
    (tmp_path / "scenarios").mkdir()
    text = (ROOT / "scenarios/stand.toml").read_text(encoding="utf-8").replace("Ragno", "B\u00f6ck\u2192")
    (tmp_path / "scenarios/lean.toml").write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "surefoot.lab.cli.entry", "list"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"B?ck?, or another" in done.stdout.replace(b"\xf6", b"?")
