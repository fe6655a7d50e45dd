"""Robot files of unknown origin: no file outside of their folder is opened, and bad ones end in one sentence."""

import resource
import time

import pytest

from surefoot.lab.robots.compare import differences
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.notes import SOURCE
from surefoot.lab.robots.untrusted import MOST_BYTES, MOST_DEPTH, MOST_ELEMENTS, parsed
from surefoot.robot.description import RobotError
from tests.lab.robots.test_import import BAD, MJCF, TRUNK, URDF

SECRET = "ballast"
CHILD = (
    f'<mujoco model="child"><worldbody><body name="{SECRET}"><inertial pos="0 0 0" mass="7" diaginertia=".1 .1 .1"/>'
    "</body></worldbody></mujoco>"
)
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
ATTACH = f'<frame pos="0 0 0"><attach model="m" body="{SECRET}" prefix="z"/></frame>'
ASSETS = {
    "model": ('<model name="m" file="{}"/>', ATTACH, "child.xml"),
    "flexcomp": ("", '<flexcomp name="f" type="mesh" file="{}" dim="2" radius=".01" mass="3"/>', "hull.obj"),
    "hfield": ('<hfield name="h" file="{}" size="1 1 1 1"/>', "", "h.bin"),
    "mesh": ('<mesh name="other" file="{}"/>', "", "hull.obj"),
    "texture": ('<texture name="t" type="cube" fileright="{}"/>', "", "h.png"),
    "skin": ('<skin name="s" file="{}"/>', "", "s.skn"),
    "include": ('<include file="{}"/>', "", "child.xml"),
}
"""By element: what stands among the assets and in the trunk, and the file that it names."""
MIMIC = URDF.replace('<child link="fl_calf"/>', '<child link="fl_calf"/><mimic joint="fl_a"/>')
BOMB = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(12))
BOMB = f'<?xml version="1.0"?><!DOCTYPE mujoco [<!ENTITY e0 "0123456789">{BOMB}]><mujoco model="&e12;"/>'


@pytest.fixture
def outside(tmp_path):
    """A folder beside that of the robot, with files whose reading would show."""
    folder = tmp_path / "outside"
    folder.mkdir()
    for name, text in {"child.xml": CHILD, "hull.obj": MESH, "h.bin": "h", "h.png": "p", "s.skn": "s"}.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def inside(tmp_path, monkeypatch):
    """The folder of a robot file, beside `outside`; it is the working folder too, from which MuJoCo reads."""
    folder = tmp_path / "robot"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def with_file(element, name):
    asset, body, _ = ASSETS[element]
    return MJCF.replace("<asset>", "<asset>" + asset.format(name)).replace(TRUNK, TRUNK + body.format(name))


@pytest.mark.parametrize("way", ["absolute", "leaving", "package"])
@pytest.mark.parametrize("element", ASSETS)
def test_a_file_outside_of_the_folder_is_refused_by_its_element(inside, outside, element, way):
    file = ASSETS[element][2]
    name = {"absolute": f"{outside}/{file}", "leaving": f"../outside/{file}", "package": f"package://../../{file}"}[way]
    (inside / "toy.xml").write_text(with_file(element, name))
    with pytest.raises(RobotError, match=r"allowed is a (path|file) below") as caught:
        import_robot(inside / "toy.xml", inside / "out")
    assert caught.value.field == f"{element}.{'fileright' if element == 'texture' else 'file'}"
    assert SECRET not in str(caught.value)
    assert not (inside / "out").exists()


@pytest.mark.parametrize("element", ["model", "flexcomp", "include"])
def test_a_link_that_leads_out_of_the_folder_is_not_followed(inside, outside, element):
    file = ASSETS[element][2]
    (inside / file).symlink_to(outside / file)
    (inside / "toy.xml").write_text(with_file(element, file))
    with pytest.raises(RobotError, match=f"{element}.file: got '{file}', allowed is"):
        import_robot(inside / "toy.xml", inside / "out")


@pytest.mark.parametrize("element", ["model", "flexcomp", "include"])
def test_the_source_in_a_robot_folder_opens_no_file(inside, outside, element):
    (inside / "toy.xml").write_text(MJCF)
    import_robot(inside / "toy.xml", inside / "out")
    file = inside / "out" / SOURCE
    text = (
        file.read_text().replace('pos="0.01 0 0"', 'pos=".01 0 0"').replace("<asset>", "<asset>" + ASSETS[element][0])
    )
    text = text.replace('<site name="imu"', ASSETS[element][1] + '<site name="imu"')
    for name in (outside / ASSETS[element][2], "child.xml"):
        file.write_text(text.format(name))
        with pytest.raises(RobotError, match=f"{element}.file"):
            differences(inside / "out")


@pytest.mark.parametrize("name", ["/etc/hull.stl", "file:///etc/hull.stl", "package://toy/hull.stl"])
def test_a_mesh_of_a_urdf_elsewhere_is_not_opened_and_no_error(inside, name):
    (inside / "toy.urdf").write_text(URDF.replace("package://toy/a.dae", name))
    import_robot(inside / "toy.urdf", inside / "out")
    assert name not in (inside / "out" / SOURCE).read_text()


def test_an_entity_bomb_costs_neither_time_nor_memory(inside):
    (inside / "toy.xml").write_text(MJCF.replace("<worldbody>", '<include file="bomb.xml"/><worldbody>'))
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    for content in (BOMB, BOMB.replace("<?xml", '<?xml encoding="US-ASCII"').replace(' version="1.0"', "")):
        (inside / "bomb.xml").write_text(content)
        with pytest.raises(RobotError, match="got a DOCTYPE declaration, allowed is XML without"):
            import_robot(inside / "toy.xml", inside / "out")
    (inside / "bomb.xml").write_bytes(b'<?xml version="1.0" encoding="cp037"?>' + BOMB[21:].encode("cp037"))
    with pytest.raises(RobotError, match="got encoding 'cp037', allowed are utf-8"):
        import_robot(inside / "toy.xml", inside / "out")
    assert time.process_time() - start < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 32 * 1024  # KiB


@pytest.mark.parametrize(("content", "words"), [
    ("<a/>".encode("utf-16"), "bytes of zero"), (b"<a>\0</a>", "bytes of zero"),
    (b"<a>" * (MOST_DEPTH + 1) + b"</a>" * (MOST_DEPTH + 1), f"{MOST_DEPTH} levels"),
    (b"<a>" + b"<b/>" * MOST_ELEMENTS + b"</a>", str(MOST_ELEMENTS)),
], ids=["utf-16", "zero", "deep", "many"])  # fmt: skip
def test_text_that_hides_declarations_or_is_too_deep_or_has_too_many_elements_is_refused(content, words):
    with pytest.raises(RobotError, match=words):
        parsed(content)


def test_the_limit_of_bytes_holds_for_a_file_and_all_that_it_includes(inside):
    (inside / "toy.xml").write_text(MJCF + " " * MOST_BYTES)
    with pytest.raises(Exception, match=f"has more than {MOST_BYTES} bytes"):
        import_robot(inside / "toy.xml", inside / "out")
    (inside / "part.xml").write_text("<mujoco/>" + " " * (MOST_BYTES * 3 // 5))
    both = '<include file="part.xml"/><include file="part.xml"/><worldbody>'
    (inside / "toy.xml").write_text(MJCF.replace("<worldbody>", both, 1))
    with pytest.raises(Exception, match="bytes, the most that is read"):
        import_robot(inside / "toy.xml", inside / "out")
    with pytest.raises(RobotError, match=f"allowed are {MOST_BYTES}"):
        parsed(b" " * (MOST_BYTES + 1))


REFUSED = {name: (text, word, ".xml") for name, (text, word) in BAD.items()} | {
    "mimic": (MIMIC, "mimic joint 'fl_b', allowed are joints with a motor", ".urdf"),
    "negative mass of a body": (
        MJCF.replace('mass=".2"', 'mass="-.2"', 1), "inertial.mass: got '-.2' of body 'fl_calf', allowed is 0", ".xml",
    ),
    "negative mass of a link": (
        URDF.replace('value=".2"', 'value="-.2"', 1), "inertial.mass: got '-.2' of link 'fl_calf', allowed is", ".urdf",
    ),
    "a named loop": (
        MJCF.replace("</mujoco>", '<equality><connect name="rod" body1="fl_foot" body2="fr_foot" anchor="0 0 0"/>'
        "</equality></mujoco>"),
        "'connect' constraint 'rod' of 'fl_foot' and 'fr_foot', allowed is a tree without closed loops; what works",
        ".xml",
    ),
    "two roots by name": (BAD["two roots"][0], "got 'trunk', 'b' as roots, allowed is one root; what works", ".xml"),
    "two roots of links": (BAD["two roots of a URDF"][0], "works instead: a copy with a fixed joint from", ".urdf"),
    "script": (MJCF.replace("fl_j0", "&lt;script&gt;"), "joint.name: got '<script>', allowed are letters", ".xml"),
    "bomb": (BOMB, "DOCTYPE", ".xml"),
    "model": (with_file("model", "child.xml"), "model.file: got 'child.xml', allowed is one file", ".xml"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_file_ends_the_command_with_one_sentence_and_no_folder(inside, in_process, name):
    text, part, suffix = REFUSED[name]
    (inside / f"toy{suffix}").write_text(text)
    code, out, err = in_process("robot", "import", f"toy{suffix}", "-o", "out")
    assert (code, out) == (2, "")
    assert part in err
    assert len(err.splitlines()) == 1, err
    assert "Traceback" not in err
    assert "internal error" not in err
    assert [path.name for path in inside.iterdir()] == [f"toy{suffix}"]
