"""Bad words and files end with exit code 2, one sentence that names them, and without a file that was not there."""

import socket
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from surefoot.errors import Refusal
from surefoot.lab.cli import main as cli
from surefoot.lab.cli import warming
from surefoot.lab.cli.output import fail, refuse_unreachable
from surefoot.lab.cli.progress import Progress
from surefoot.services.stability.config import StabilityConfig
from surefoot.services.stability.programs.contacts import MAX_MU


@pytest.fixture(autouse=True)
def here(monkeypatch, tmp_path):
    """A working folder with a file and a folder in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SUREFOOT_SECURITY", str(tmp_path / "security"))
    (tmp_path / "file.mcap").write_text("hello")
    (tmp_path / "folder").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("why missing.mcap", "missing.mcap: No such file or directory"),
        ("verify missing.mcap", "missing.mcap: No such file or directory"),
        ("report folder", "folder: Is a directory"),
        ("bag import missing.csv --robot ragno", "missing.csv: No such file or directory"),
        ("bag import file.csv --robot ragno -o z.dat", "got 'z.dat', allowed is a file *.mcap"),
        ("bag import file.csv --robot ragno -o file.mcap", "file.mcap exists; allowed is a new file (--out)"),
        ("bag export file.mcap --to csv -o folder", "folder exists; allowed is a new path (--out)"),
        ("estimate file.mcap -o file.csv", "file.csv is a file, allowed is a folder"),
        ("estimate file.mcap --calibrate -o x", "--calibrate only reports, and writes no files"),
        ("footholds learn file.csv -o folder", "folder is a folder, allowed is a file"),
        ("footholds merge ragno ragno -o folder", "folder is a folder, allowed is a file"),
        ("footholds score file.csv -m ragno -o folder", "folder is a folder, allowed is a file"),
        ("bag import file.csv --robot ragno --contact-off 5", "without --contact-on"),
        ("bag import file.csv --robot ragno --contact-on nan", "--contact-on: got nan, allowed are finite"),
        ("bag import file.csv --robot ragno --contact-on -5", "--contact-on, --contact-off: got -5"),
        ("topic hz state/velocity --window 1e999", "--window: got inf, allowed are finite numbers"),
        ("sim push 1 1e999", "surefoot: left: got inf"),
        ("sim step -1", "greater than or equal to 1 (got '-1')"),
        ("sim speed -.5", "greater than or equal to 0 (got '-.5')"),
        ("sim push -5 --unknown", "--unknown"),
        ("sim push --unknown", "No such option: --unknown"),
        ("topic echo state/gait --plot state", "field 'state' holds no numbers; those that do are"),
        ("run flat --seed x", "unable to parse string as an integer (got 'x')"),
        ("run flat --rtf -5", "greater than or equal to 0.01 (got '-5')"),
        ("bag import file.csv --robot ragno --contact-on 1 --contact-off 2", "0 <= off <= on"),
        ("bag import file.csv --robot ragno --contacts /feet", "is a table"),
        ("compare missing folder", "missing: No such file or directory"),
        ("footholds show missing", "cannot be read"),
        ("footholds judge ragno missing", "cannot be read"),
        ("footholds show ragno --picture x.xyz", "known are .png"),
        ("footholds score missing.npz -m ragno -o s.npz", "cannot be read: No such file"),
        ("footholds score file.mcap -m ragno -o s.npz", "is cut off, damaged or of an unknown encoding"),
        ("footholds score file.mcap -m ragno -o s.npz --heading nan", "--heading"),
        ("footholds collect -o s.jsonl --robot missing", "no robot 'missing'"),
        ("footholds collect -o s.jsonl --model missing", "cannot be read"),
        ("map show missing.npz", "cannot be read"),
        ("robot show ragno -o x.xyz", "known are .png"),
        ("robot show ragno -o folder", "is a folder, allowed is a file"),
        ("robot export ragno -o missing/x.xml", "missing/x.xml: No such file or directory"),
        ("robot import package:", "allowed is package:NAME/ROBOT"),
        ("run flat --out file.mcap --force", "is a file, allowed is a folder"),
        ("run flat --rtf 1e999", "--rtf"),
        ("up ragno --record folder", "is a folder, allowed is a file"),
        ("report file.mcap -o file.mcap", "allowed is a file *.html"),
        ("estimate file.mcap --acc-noise -1", "--acc-noise"),
        ("estimate file.mcap --score-from nan", "--score-from"),
        ("whatif file.mcap --set servo=-1", "--set 'servo=-1': got -1, allowed is above 0 to 100;"),
        ("whatif file.mcap --set fault=imu_drop:-1", "=imu_drop:-1': got -1, allowed is above 0 to 3600 s;"),
        ("whatif file.mcap --set fault=nothing:1", "--set 'fault=nothing:1': got fault 'nothing'; allowed are"),
        ("chaos flat --listen tcp/127.0.0.1:7450", "without --zenoh"),
        ("security show", "surefoot security init"),
        ("security init --operator ../x", "got '../x'"),
        ("security init --guest <script>", "got '<script>'"),
        ("security init --operator ann --guest ann", "ann: got operator and guest"),
        ("reproduce osswald --live missing.json", "missing.json: No such file or directory;"),
    ],
)
def test_one_sentence_exit_code_2_and_no_new_file(complaint, here, words, part):
    before = sorted(here.iterdir())
    (here / "file.csv").write_text("")
    err = complaint(*words.split())
    assert part in err
    assert "internal error" not in err
    assert "Errno" not in err
    assert sorted(here.iterdir()) == sorted([*before, here / "file.csv"])
    assert (here / "file.mcap").read_text() == "hello"


@pytest.mark.parametrize(
    "words",
    [
        "report missing.mcap", "why missing.mcap", "verify missing.mcap", "bisect file.mcap missing.mcap",
        "audit missing.mcap", "render missing.mcap -o x.webp", "estimate missing.mcap", "compare folder missing",
        "bag export missing.mcap --to tum", "bag import missing.bag --robot ragno", "map build missing.mcap",
        "fit navigator file.mcap missing.mcap", "footholds gather missing.mcap -o s.jsonl",
        "footholds learn missing.jsonl -o m.json",
    ],
)  # fmt: skip
def test_an_absent_file_is_refused_before_progress_is_reported(complaint, monkeypatch, words):
    monkeypatch.setattr(Progress, "__enter__", lambda _: pytest.fail("the work was begun"))
    found = complaint(*words.split())
    name = next(word for word in words.split() if word.startswith("missing"))
    assert found == f"surefoot: {name}: No such file or directory\n"


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("report file.mcap -o file.csv/r.html", "Not a directory"),
        ("render file.mcap -o file.csv/r.webp", "Not a directory"),
        ("render file.mcap -o missing/r.webp", "No such file or directory"),
        ("bag export file.mcap --to csv -o file.csv/r.csv", "Not a directory"),
        ("bag import file.csv --robot ragno -o file.csv/r.mcap", "Not a directory"),
        ("robot import missing.xml -o file.csv/folder/r", "Not a directory"),
        ("robot show ragno -o file.csv/r.png", "Not a directory"),
        ("robot show ragno -o missing/r.png", "No such file or directory"),
        ("estimate file.mcap -o file.csv/r", "Not a directory"),
        ("footholds learn file.csv -o file.csv/r.json", "Not a directory"),
        ("run stand --out file.csv/r", "Not a directory"),
        ("up ragno --record file.csv/r.mcap", "Not a directory"),
    ],
)
def test_a_path_in_no_folder_is_refused_before_the_work(complaint, here, monkeypatch, words, why):
    (here / "file.csv").write_text("")
    monkeypatch.setattr(Progress, "__enter__", lambda _: pytest.fail("the work was begun"))
    monkeypatch.setattr("surefoot.lab.report.robot_drawing.draw_robot", lambda *_: pytest.fail("the work was begun"))
    assert complaint(*words.split()) == f"surefoot: {words.split()[-1]}: {why}\n"


@pytest.mark.parametrize("path", ["r.html", "folder/r.html", "folder/new/further/r.html"])
def test_a_path_in_a_folder_that_is_there_or_is_made_is_allowed(here, path):
    for place in (Path(path), here / path):
        refuse_unreachable(place, makes_folders=True)
        if "new" not in path:
            refuse_unreachable(place, makes_folders=False)


def test_a_picture_is_whole_or_absent(answer, here, monkeypatch):
    answer("robot", "show", "ragno", "-o", "r.svg")
    assert (here / "r.svg").read_text().startswith("<?xml")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "full")))
    with pytest.raises(SystemExit) as ended:
        cli.main(["robot", "show", "ragno", "-o", "full.png"])
    assert ended.value.code == cli.EXIT_CHECK
    assert not list(here.glob("full*"))


def test_stamps_of_compiled_kernels_are_in_the_users_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert warming.Job("walker", "ragno").stamp.is_relative_to(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert warming.Job("walker", "ragno").stamp.is_absolute()


def test_a_field_with_a_line_break_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert fail(Refusal("invalid", "stability/region has no field 'fric\\ntion'", "fric\ntion")) != 0
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "words", ["param set stability mu -1", "sim push -5 -1e-3", "sim set mass -inf", "sim push -- -5"]
)
def test_a_negative_argument_reaches_its_check(words: str, complaint: Any) -> None:
    code = 2 if "inf" in words else 1
    assert ("finite" if "inf" in words else "no system answers") in complaint(*words.split(), code=code)


def test_a_picture_of_an_unknown_kind_is_refused_before_the_work(complaint: Any) -> None:
    err = complaint("render", "file.mcap", "-o", "x.txt")
    assert err.startswith("surefoot: out: x.txt ends in '.txt'; known are .webp")


def test_a_taken_port_is_reported_before_a_recording_is_read(complaint: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surefoot.lab.cli.view._recorded", lambda file: pytest.fail("the report was begun"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port} of 127.0.0.1 is taken" in complaint("view", "file.mcap", "--port", port, code=1)


def test_a_port_is_free_again_after_a_recording_that_cannot_be_read(complaint: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    for _ in range(2):
        assert "file.mcap" in complaint("view", "file.mcap", "--port", port)


def test_the_friction_of_the_status_has_the_limits_of_a_contact() -> None:
    assert StabilityConfig(mu=MAX_MU).mu == MAX_MU
    for wrong in (-1.0, 1e9):
        with pytest.raises(ValidationError, match="mu"):
            StabilityConfig(mu=wrong)
