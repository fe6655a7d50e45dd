"""`surefoot robot check` of a damaged folder: exit code 2 and one sentence that names the file or the field."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from surefoot.lab.robots.export import write_mjcf
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.notes import FILE, SOURCE
from surefoot.robot.reader import load_robot

TOML = "robot.toml"
JUNK = bytes(range(256)) * 4
FLIPS = 8


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robots")
    write_mjcf(load_robot("ragno"), folder / "ragno.xml")
    import_robot(folder / "ragno.xml", folder / "sound")
    return folder / "sound"


@pytest.fixture
def folder(sound, tmp_path):
    return Path(shutil.copytree(sound, tmp_path / "bot"))


def checked(in_process, folder):
    """Return exit code and complaint of a check; a complaint is one sentence without a traceback."""
    code, _, err = in_process("robot", "check", folder)
    assert "internal error" not in err
    assert "Traceback" not in err
    assert len(err.splitlines()) == (0 if code == 0 else 1), err
    return code, err


def test_a_sound_folder_is_accepted(in_process, folder):
    assert checked(in_process, folder)[0] == 0
    assert in_process("robot", "check", folder)[1].endswith(f"next: surefoot run stand --robot {folder}\n")


def test_the_next_command_of_a_folder_with_a_space_can_be_pasted(in_process, sound, tmp_path):
    folder = shutil.copytree(sound, tmp_path / "my bot")
    assert in_process("robot", "check", folder)[1].endswith(f"next: surefoot run stand --robot '{folder}'\n")


@pytest.mark.parametrize("name", [TOML, FILE, SOURCE])
@pytest.mark.parametrize("kind", ["missing", "junk", "empty", "folder", "cut"])
def test_a_file_that_is_none_is_named(in_process, folder, name, kind):
    file = folder / name
    content = {"junk": JUNK, "empty": b"", "cut": file.read_bytes()[:700]}.get(kind)
    file.unlink()
    if kind == "folder":
        file.mkdir()
    elif content is not None:
        file.write_bytes(content)
    code, err = checked(in_process, folder)
    assert code == 2
    assert name in err or "MuJoCo" in err or "is missing" in err


@pytest.mark.parametrize("value", ["nan", "inf", "-1", "1e999", "true", '"heavy"', "[]"])
def test_a_mass_that_is_none_is_named_with_what_came(in_process, folder, value):
    text = (folder / TOML).read_text()
    first = text.index("mass = ")
    (folder / TOML).write_text(f"{text[:first]}mass = {value}\n{text[text.index(chr(10), first) + 1 :]}")
    code, err = checked(in_process, folder)
    assert code == 2
    assert "mass: got" in err


@pytest.mark.parametrize("name", ["trunk", "joints", "shared", "feet", "assumed"])
@pytest.mark.parametrize("value", [None, "x", float("nan")])
def test_notes_of_a_wrong_type_are_named(in_process, folder, name, value):
    notes = json.loads((folder / FILE).read_text())
    (folder / FILE).write_text(json.dumps({**notes, name: value}))
    code, err = checked(in_process, folder)
    assert code == 2
    assert f"{FILE}.{name}" in err or "'x'" in err


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("joints",), {}, f"{FILE}.joints.lf_coxa: is missing"),
        (("feet",), {}, f"{FILE}.feet.lf: is missing"),
        (("shared",), {"other": "none"}, f"{FILE}.shared.other: got 'none'"),
        (("feet", "lf", "spheres"), [], f"{FILE}.feet.lf.spheres: got 0"),
        (("feet", "lf", "body"), "none", "Invalid name 'none'"),
        (("feet", "lf", "centre"), ["geom", 9999, 0], "9999"),
        (("feet", "lf", "centre"), ["wheel", 0, 0], "got 'wheel'"),
        (("feet", "lf", "anchor"), [float("nan")] * 3, "got nan"),
        (("feet", "lf", "anchor"), [0.0, 0.0], f"{FILE}.feet.lf.anchor"),
        (("joints", "lf_coxa"), "none", "Invalid name 'none'"),
        (("trunk",), "lf_coxa", "differs"),
    ],
)
def test_notes_that_do_not_fit_the_robot_are_named(in_process, folder, path, value, part):
    notes = json.loads((folder / FILE).read_text())
    at = notes
    for name in path[:-1]:
        at = at[name]
    at[path[-1]] = value
    (folder / FILE).write_text(json.dumps(notes))
    code, err = checked(in_process, folder)
    assert code == 2
    assert part in err


@pytest.mark.parametrize("name", [TOML, FILE, SOURCE])
def test_flipped_bytes_are_refused_or_harmless(in_process, folder, name):
    random, sound = np.random.default_rng(27), (folder / name).read_bytes()
    codes = set()
    for _ in range(FLIPS):
        content = bytearray(sound)
        for place in random.integers(len(content), size=3):
            content[place] ^= 1 << int(random.integers(8))
        (folder / name).write_bytes(content)
        codes.add(checked(in_process, folder)[0])
    assert codes <= {0, 2}
    assert 2 in codes
