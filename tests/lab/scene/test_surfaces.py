"""Meshes of an imported robot in its pictures, from files that the test makes."""

import json

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.lab.bags.exporting import export
from surefoot.lab.report.robot_drawing import draw_robot
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.scene import surfaces
from surefoot.lab.scene.film import UNITS_PER_M, film_of_recording, frame, header, packed, reel
from surefoot.lab.scene.pages import REPLAY_BAR, page, stage
from surefoot.lab.scene.painter import Painter
from surefoot.lab.scene.primitives import Primitives, surface
from surefoot.lab.scene.shapes import TRUNK, body_of
from surefoot.lab.scene.surfaces import MOST_TRIANGLES, LinkSurface, _few
from surefoot.lab.view.live import LiveFrames
from surefoot.record.recording import RecordingWriter, open_readable, topic_of
from surefoot.record.robots import robot_of
from surefoot.robot.kinematics import forward
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointState
from tests.browser import CHROMIUM, MISSING, Browser
from tests.lab.robots.test_import import MJCF
from tests.lab.scene.protobuf import reader_of
from tests.lab.view.quiet import QuietClient

CORNERS = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])
SIDES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
GEOM = '<geom type="mesh" mesh="hull"/>'
TIP = '<geom name="{n}_tip"'
MESHED = MJCF.replace('file="hull.stl"', 'file="hull.stl" scale="1 -1 .5"').replace(
    GEOM, '<geom type="mesh" mesh="hull" pos=".02 0 .01" euler="10 20 30"/>'
)
MESHED = MESHED.replace(
    TIP.format(n="fl"), f'<geom type="mesh" mesh="hull" pos="0 0 .1" mass="0"/>{TIP.format(n="fl")}'
)
"""A mesh on the trunk, and one on a body that is fixed to the last link of a leg."""


def stl(corners, count=None):
    """Binary STL of triangles (n, 3, 3); `count`: what its head states in place of their number."""
    rows = np.zeros(len(corners), np.dtype([("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("more", "<u2")]))
    rows["at"] = corners
    return bytes(80) + np.uint32(len(corners) if count is None else count).tobytes() + rows.tobytes()


HULL = stl(CORNERS[SIDES])


@pytest.fixture
def toy(tmp_path):
    """Folder of an imported robot with a mesh on its trunk and on a leg; the file of the mesh is `meshes/hull.stl`."""
    (tmp_path / "bot").mkdir()
    (tmp_path / "bot" / "hull.stl").write_bytes(HULL)
    (tmp_path / "bot" / "toy.xml").write_text(MESHED)
    import_robot(tmp_path / "bot" / "toy.xml", tmp_path / "toy")
    return tmp_path / "toy"


def changed(folder, name):
    """Write another name of the mesh's file into the notes of the import."""
    notes = json.loads((folder / "import.json").read_text())
    for mesh in notes["meshes"]:
        mesh["file"] = name
    (folder / "import.json").write_text(json.dumps(notes))


def vertices_of(robot, q):
    """Vertices of all meshes at joint angles q (nj,) rad, base_link, (n, 3) m."""
    body, (rot, pos) = body_of(robot), forward(robot.model, q)
    points = pos[body.link] + np.einsum("nij,nj->ni", rot[body.link], body.local)
    return np.concatenate([mesh.placed(points) for mesh in body.meshes])


def sorted_rows(places):
    return places[np.lexsort(np.round(places, 5).T)]


def test_meshes_are_where_mujoco_has_them_in_every_posture(toy):
    robot, notes = load_robot(toy), json.loads((toy / "import.json").read_text())
    model = mujoco.MjModel.from_xml_string(MESHED, assets={"hull.stl": HULL})
    data, random, trunk = mujoco.MjData(model), np.random.default_rng(3), model.body("trunk").id
    for _ in range(5):
        q = random.uniform(robot.joint_lower, robot.joint_upper)
        for name, angle in zip(robot.joint_names, q, strict=True):
            data.joint(notes["joints"][name]).qpos = angle
        mujoco.mj_kinematics(model, data)
        theirs = []
        for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
            world = data.geom_xpos[geom] + model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T
            theirs.append((world - data.xpos[trunk]) @ data.xmat[trunk].reshape(3, 3))
        assert len(theirs) == 2
        assert sorted_rows(vertices_of(robot, q)) == pytest.approx(sorted_rows(np.concatenate(theirs)), abs=1e-5)


def test_a_link_with_a_mesh_has_no_other_shape_but_its_foot(toy):
    robot = load_robot(toy)
    body, plain = body_of(robot), body_of(load_robot("ragno"))
    assert (plain.meshes, plain.notes, body.notes) == ((), (), ())
    covered = {int(body.link[mesh.frame[0]]) for mesh in body.meshes}
    assert covered == {0, robot.legs[0].foot.link}
    assert not {int(body.link[limb.begin]) for limb in body.limbs} & covered
    assert sum(ball.radius == robot.legs[0].foot.radius for ball in body.balls) == 4
    for mesh in body.meshes:  # the mirrored file has its outside outside again
        at = mesh.vertices[mesh.triangles]
        outward = np.einsum(
            "ij,ij->i", np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), at.mean(1) - at.mean((0, 1))
        )
        assert (outward > 0.0).all()


BAD = {
    "missing": (None, "meshes/none.stl", "cannot be read"),
    "cut": (HULL[:-30], "meshes/hull.stl", "wrong size"),
    "counts": (stl(CORNERS[SIDES], 4_000_000_000), "meshes/hull.stl", "between 1 and 200000"),
    "flat": (stl(np.zeros((4, 3, 3))), "meshes/hull.stl", "vertices"),
    "nan": (stl(np.full((4, 3, 3), np.nan)), "meshes/hull.stl", "not finite"),
    "unit": (stl(1000.0 * CORNERS[SIDES]), "meshes/hull.stl", "as of another unit"),
    "huge": (HULL + bytes(200), "meshes/hull.stl", "has more than 400 bytes"),
    "kind": (HULL, "meshes/hull.dae", "no decoder"),
    "above": (HULL, "../outside.stl", "is not in the robot's folder"),
    "absolute": (HULL, "/etc/passwd", "is not in the robot's folder"),
    "link": (HULL, "meshes/link.stl", "is not in the robot's folder"),
    "folder": (HULL, "meshes", "cannot be read"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_mesh_that_cannot_be_drawn_leaves_the_simple_shapes_and_a_sentence(toy, monkeypatch, name):
    content, file, why = BAD[name]
    if content is not None:
        for each in ("meshes/hull.stl", "meshes/hull.dae", "../outside.stl"):
            (toy / each).write_bytes(content)
    (toy / "meshes" / "link.stl").symlink_to(toy.parent / "outside.stl")
    changed(toy, file)
    monkeypatch.setattr(surfaces, "MOST_READ_BYTES", 400)
    robot = load_robot(toy)
    body = body_of(robot)
    (note,) = body.notes
    assert why in note
    assert note.startswith(f"2 of {len(robot.links)} links of toy are drawn as simple shapes: mesh '")
    assert "\n" not in note
    (toy / "import.json").unlink()
    plain = body_of(load_robot(toy))
    assert (body.meshes, body.limbs, body.balls, body.faces) == ((), plain.limbs, plain.balls, plain.faces)


@pytest.mark.parametrize(
    ("file", "text"), [("import.json", "{"), ("import.json", None), ("source.xml", "<mujoco/>"), ("source.xml", "")]
)
def test_a_damaged_import_leaves_the_simple_shapes_and_a_sentence(toy, file, text):
    (toy / file).write_text(
        (toy / file).read_text().replace('"body": "trunk"', '"body": "none"') if text is None else text
    )
    (note,) = body_of(load_robot(toy)).notes
    assert note.startswith("meshes of toy are not drawn: ")
    assert not body_of(load_robot(toy)).meshes


def test_fine_meshes_become_coarse_and_keep_their_size_and_their_outside():
    u, v = (x.ravel() for x in np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 200), np.linspace(0.0, np.pi, 150)))
    ball = np.column_stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)))
    i = (np.arange(149)[:, None] * 200 + np.arange(199)).ravel()
    fine = np.concatenate((np.column_stack((i, i + 200, i + 1)), np.column_stack((i + 1, i + 200, i + 201))))
    (found,) = _few([LinkSurface(0, ball, fine)], 0.004)
    assert 0.5 * MOST_TRIANGLES < len(found.triangles) <= MOST_TRIANGLES < len(fine)
    at = found.vertices[found.triangles]
    assert np.linalg.norm(found.vertices, axis=1) == pytest.approx(1.0, abs=0.01)
    outward = np.einsum("ij,ij->i", np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), at.mean(axis=1))
    assert (outward >= 0.0).mean() > 0.98
    assert 0.5 * np.linalg.norm(np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), axis=1).sum() == pytest.approx(
        4.0 * np.pi, rel=0.02
    )


@pytest.fixture
def standing(toy):
    """Recording of the robot that stands, as the recorder writes it, with the folder of the robot in its metadata."""
    robot = load_robot(toy)
    path = toy.parent / "stand.mcap"
    topic = topic_of("hw/joints")
    assert topic is not None
    writer = RecordingWriter(path, {"robot": str(toy)}, {}, {"robot.toml": (toy / "robot.toml").read_bytes()})
    for tick in range(3):
        message = JointState(stamp_ns=tick * 10_000_000, seq=tick, tick=tick, epoch=0, position=tuple(robot.neutral))
        writer.write(topic, message, Raw(*encode(message), ""))
    writer.close({})
    return path


def test_pages_have_a_mesh_once_and_four_points_of_it_a_frame(standing, toy):
    recording = open_readable(standing)
    film = film_of_recording(recording, robot_of(recording))
    (frames, vertices, corners, colour), leg = header(film.scene)["meshes"]
    assert (len(frames), len(vertices), len(corners), colour) == (4, 12, 12, TRUNK)
    points = np.array(frame(film.snapshots[-1])["points"]).reshape(-1, 3)
    origin, *axes = points[list(leg[0])]
    placed = origin + np.array(leg[1]).reshape(-1, 3) @ (np.array(axes) - origin) / UNITS_PER_M
    shown = film.snapshots[-1]
    assert placed / UNITS_PER_M == pytest.approx(film.scene.body.meshes[1].placed(shown.points), abs=2e-4)
    assert shown.position[2] == pytest.approx(-min(vertices_of(film.scene.robot, shown.joints)[:, 2]), abs=0.15)
    (toy / "robot.toml").write_text((toy / "robot.toml").read_text().replace("mass = 5.0", "mass = 6.0"))
    assert not body_of(robot_of(recording)).meshes  # another robot is there by now


def test_the_painter_paints_the_mesh(standing):
    recording = open_readable(standing)
    film = film_of_recording(recording, robot_of(recording))
    with_mesh = np.asarray(Painter(film.scene, (320, 180)).paint(film.snapshots[-1], []), dtype=float)
    film.scene.body = film.scene.body._replace(meshes=())
    without = np.asarray(Painter(film.scene, (320, 180)).paint(film.snapshots[-1], []), dtype=float)
    rgb = [int(TRUNK[i : i + 2], 16) for i in (1, 3, 5)]
    near, before = ((np.linalg.norm(each - rgb, axis=2) < 60.0).sum() for each in (with_mesh, without))
    assert near > before + 200


def test_foxglove_and_its_clouds_get_the_triangles(toy):
    pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
    body = body_of(load_robot(toy))
    made = Primitives().parts(body, 0)
    assert (len(made["triangles"]), made["cylinders"], made["spheres"]) == (1, [], [])
    places, colours = surface(body, 0)
    assert len(places) == len(colours) == len(body.meshes[0].vertices) + len(body.meshes[0].triangles)


def test_the_drawing_of_a_robot_shows_the_mesh_and_states_what_it_lacks(toy, in_process):
    draw_robot(load_robot(toy), toy.parent / "mesh.png")
    (toy / "meshes" / "hull.stl").write_bytes(b"")
    code, _, err = in_process("robot", "show", toy, "-o", toy.parent / "plain.png")
    assert code == 0
    assert "links of toy are drawn as simple shapes" in err
    assert (toy.parent / "mesh.png").read_bytes() != (toy.parent / "plain.png").read_bytes()


def test_view_export_and_report_state_what_they_lack(standing, toy):
    (toy / "meshes" / "hull.stl").unlink()
    lacking = "2 of 13 links of toy are drawn as simple shapes"
    recording = open_readable(standing)
    assert any(lacking in note for note in film_of_recording(recording, robot_of(recording)).notes)
    live = LiveFrames(QuietClient(), load_robot(toy), lambda reason: (True, reason))
    ((level, text),) = live._report(0.0)["log"]
    live.close()
    assert (level, text.startswith(lacking)) == ("warning", True)
    pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
    with export(standing, "foxglove", toy.parent / "fox.mcap").open("rb") as opened:
        lines = [
            reader_of(s.data, s.name).FromString(m.data) for s, _, m in make_reader(opened).iter_messages(["/log"])
        ]
    assert [line.name for line in lines if lacking in line.message] == ["meshes"]


@pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
def test_a_page_places_and_paints_the_meshes_as_the_painter_does(standing, tmp_path):
    recording = open_readable(standing)
    film = film_of_recording(recording, robot_of(recording))
    body = (
        f'{stage("replay", REPLAY_BAR)}<script type="text/plain" id="data">{packed({"film": reel(film), "charts": []})}'
    )
    html = page(
        "toy", f'{body}</script><div id="charts"></div>', ("scene.js", "charts.js", "replay.js"), "startReport();"
    )
    (tmp_path / "toy.html").write_text(html)
    with Browser(tmp_path / "profile") as browser:
        browser.go((tmp_path / "toy.html").as_uri())
        browser.wait("document.body?.dataset.ready == '1'")
        view, frame_now = "report.replay.stage.view", "report.replay.frames[0].points"
        placed = json.loads(browser.run(f"JSON.stringify([...{view}.placed({view}.head.meshes[0], {frame_now})])"))
        browser.run(f"window.parts = []; {view}.mesh({view}.head.meshes[0], {frame_now}, parts); 0")
        assert 1 <= browser.run("parts.length") <= 3  # of the four sides of the hull those that face the viewer
        assert not browser.faults
    there = film.scene.body.meshes[0].placed(film.snapshots[0].points)
    assert np.array(placed).reshape(-1, 3) / UNITS_PER_M == pytest.approx(there, abs=2e-4)
