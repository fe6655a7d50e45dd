"""Meshes of an imported robot: copied for drawing from at or below the folder of the source, and recorded."""

import json

import pytest

from surefoot.lab.robots import meshes
from surefoot.lab.robots.compare import MOST_DIFFERENCE, differences
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.notes import read_notes
from surefoot.robot.reader import load_robot
from tests.lab.robots.test_import import MJCF, URDF

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
GEOM = '<geom type="mesh" mesh="hull"/>'
PLACED = MJCF.replace("hull.stl", "hull.obj").replace(
    GEOM, f'<frame pos="0 0 .1"><geom type="mesh" mesh="hull" pos=".2 0 0" euler="0 0 90"/></frame>{GEOM}'
)
VISUAL = '<visual><origin xyz="0 .1 0" rpy="0 0 1.5707963267949"/><geometry><mesh filename="{}" scale="2 2 2"/>'


@pytest.fixture
def toy(tmp_path):
    """Import a text from a folder with meshes; return the notes of the import."""
    for folder in ("bot", "bot/meshes", "bot/toy"):
        (tmp_path / folder).mkdir()
    for file in ("bot/hull.obj", "bot/meshes/hull.obj", "bot/toy/a.obj", "outside.obj", "bot/secret.txt"):
        (tmp_path / file).write_text(OBJ)
    (tmp_path / "bot" / "link.obj").symlink_to(tmp_path / "outside.obj")

    def run(text, suffix=".xml", out="out"):
        (tmp_path / "bot" / f"bot{suffix}").write_text(text)
        import_robot(tmp_path / "bot" / f"bot{suffix}", tmp_path / out)
        return read_notes(tmp_path / out)

    return run


def copies(folder):
    return sorted(path.name for path in (folder / "meshes").iterdir()) if (folder / "meshes").is_dir() else []


def test_meshes_of_an_mjcf_are_copied_with_their_places(toy, tmp_path):
    notes = toy(PLACED)
    assert copies(tmp_path / "out") == ["hull.obj"]
    turned, straight = notes.meshes
    assert (turned.file, turned.body, straight.body) == ("meshes/hull.obj", "trunk", "trunk")
    assert list(turned.position) == pytest.approx([0.2, 0, 0.1])
    assert list(turned.quat_wxyz) == pytest.approx([0.5**0.5, 0, 0, 0.5**0.5])
    assert list(straight.position) == pytest.approx([0, 0, 0])
    assert list(straight.scale) == [1, 1, 1]
    assert not [text for text in notes.missing if "mesh" in text]


def test_the_folder_of_meshes_of_an_mjcf_is_followed(toy, tmp_path):
    assert toy(PLACED.replace('autolimits="true"', 'autolimits="true" meshdir="meshes"')).meshes
    notes = toy(PLACED.replace('autolimits="true"', 'autolimits="true" meshdir=".."'), out="two")
    assert not notes.meshes
    assert [text for text in notes.missing if "is not below the folder" in text]
    assert not copies(tmp_path / "two")


@pytest.mark.parametrize("name", ["package://toy/a.obj", "package://any/hull.obj", "hull.obj", "meshes/hull.obj"])
def test_meshes_of_a_urdf_are_copied_with_their_places(toy, tmp_path, name):
    text = URDF.replace('<visual><geometry><mesh filename="package://toy/a.dae"/>', VISUAL.format(name))
    (mesh,) = toy(text, ".urdf").meshes
    assert (tmp_path / "out" / mesh.file).read_text() == OBJ
    assert (mesh.body, list(mesh.position), list(mesh.scale)) == ("body", [0, 0.1, 0], [2, 2, 2])
    assert list(mesh.quat_wxyz) == pytest.approx([0.5**0.5, 0, 0, 0.5**0.5])


@pytest.mark.parametrize("name", ["link.obj", "none.obj", "secret.txt", "file:///etc/a.obj", "{out}/outside.obj"])
def test_what_is_outside_or_missing_or_no_mesh_is_a_note(toy, tmp_path, name):
    name = name.format(out=tmp_path)
    text = URDF.replace('<visual><geometry><mesh filename="package://toy/a.dae"/>', VISUAL.format(name))
    notes = toy(text, ".urdf")
    assert (notes.meshes, copies(tmp_path / "out")) == ([], [])
    assert [text for text in notes.missing if "is not below the folder" in text]


def test_number_and_size_of_copies_are_limited(toy, tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MOST_MESH_BYTES", 10)
    assert [text for text in toy(PLACED).missing if "more than 10 bytes" in text]
    monkeypatch.setattr(meshes, "MOST_FILES", 0)
    assert [text for text in toy(PLACED, out="two").missing if "more than the 0 files" in text]
    assert not copies(tmp_path / "out") + copies(tmp_path / "two")


def test_hash_and_physics_are_those_without_meshes(toy, tmp_path):
    toy(PLACED)
    (tmp_path / "bot" / "hull.obj").unlink()
    (tmp_path / "other").mkdir()
    toy(PLACED, out="other/out")
    assert load_robot(tmp_path / "out").hash == load_robot(tmp_path / "other" / "out").hash
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE
    notes = json.loads((tmp_path / "out" / "import.json").read_text())
    del notes["meshes"]
    (tmp_path / "out" / "import.json").write_text(json.dumps(notes))
    assert not read_notes(tmp_path / "out").meshes  # of a folder that an older version wrote
