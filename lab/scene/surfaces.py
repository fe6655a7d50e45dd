"""Surfaces of an imported robot's links, for drawing: its mesh files, read by MuJoCo and made coarse."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.files import read_regular
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.reader import RobotInFolder
from surefoot.tables import shown

from ..robots.notes import FILE, SOURCE, ImportNotes, MeshNote, read_notes, read_text

MOST_TRIANGLES = 4000
"""Largest number of triangles that are drawn of a robot; finer meshes are made coarser, since each picture sorts all of
them and a report carries them."""
MOST_READ_BYTES, MOST_PLACES = 64 * 1024 * 1024, 500
"""`MOST_READ_BYTES`: largest size of the mesh files of a robot that are read for drawing, together, bytes;
`MOST_PLACES`: largest number of places of meshes on a robot."""
LARGEST = 10.0
"""Largest coordinate of a mesh in its link's frame, in extents of the robot; larger ones are of another unit."""
FINEST, COARSER = 0.004, 1.4
"""`FINEST`: smallest edge of the cubes whose vertices are drawn as one, in extents of the robot; `COARSER`: factor by
which it grows until there are few enough triangles."""
INDEX_BITS = 21  # of an integer of 64 bits, for one of three cube or vertex numbers


class LinkSurface(NamedTuple):
    """Triangles that cover a link.

    Attributes:
        link: index of the link.
        vertices: (n, 3) m, frame of the link.
        triangles: (m, 3) indices of vertices, counter-clockwise seen from outside.
    """

    link: int
    vertices: Array
    triangles: NDArray[np.int64]


def surfaces_of(robot: Robot, extent: float) -> tuple[list[LinkSurface], tuple[str, ...]]:
    """Return the surfaces of the links whose meshes can all be read, and a sentence on the other links, if any.

    Args:
        robot: robot description; one that was not imported with meshes has no surfaces.
        extent: size of the robot, m.
    """
    folder = robot.folder if isinstance(robot, RobotInFolder) else None
    if folder is None or not (folder / FILE).is_file():
        return [], ()
    lost: dict[int, str] = {}
    try:
        notes = read_notes(folder)
        found = _placed(robot, notes, folder, extent, lost) if notes.meshes else []
    except SurefootError as error:
        return [], (f"meshes of {robot.name} are not drawn: {error}",)
    except KeyError as error:  # MuJoCo's: a name that the source does not have
        why = str(error.args[0]).partition(". ")[0][:120]
        return [], (f"meshes of {robot.name} are not drawn: {FILE} and {SOURCE} differ ({why})",)
    whole = [each for each in found if each.link not in lost]
    why = next(iter(lost.values()), "")
    text = f"{len(lost)} of {len(robot.links)} links of {robot.name} are drawn as simple shapes: mesh {why}"
    return _few(whole, FINEST * extent), (text,) if lost else ()


def _placed(robot: Robot, notes: ImportNotes, folder: Path, extent: float, lost: dict[int, str]) -> list[LinkSurface]:
    """Return the meshes in the frames of their links; a link with a mesh that cannot be drawn is put into `lost`.

    Raises:
        SurefootError: the source of the robot cannot be read, or there are too many places.
        KeyError: the source has no such body or joint.
    """
    if len(notes.meshes) > MOST_PLACES:
        raise SurefootError("value", f"got {len(notes.meshes)} places, allowed are {MOST_PLACES}", "meshes")
    found, left, frames = list[LinkSurface](), MOST_READ_BYTES, _Frames(robot, notes, read_text(folder, SOURCE))
    decoded: dict[str, tuple[Array, NDArray[np.int64]] | SurefootError] = {}
    for note in notes.meshes:
        link, turn, shift = frames.of(note)
        if note.file not in decoded:
            try:
                content = _content(folder, note.file, left)
                left -= len(content)
                decoded[note.file] = _decoded(content, Path(note.file).suffix.lower())
            except SurefootError as error:
                decoded[note.file] = error
        mesh = decoded[note.file]
        if isinstance(mesh, SurefootError):
            lost.setdefault(link, f"{shown(note.file)} {mesh.message}")
            continue
        scale = np.array(note.scale)
        vertices = (mesh[0] * scale) @ turn.T + shift
        size = float(np.abs(vertices).max())
        if not size <= LARGEST * extent:
            lost.setdefault(link, f"{shown(note.file)} reaches {size:.3g} m from its link, as of another unit")
        else:
            found.append(LinkSurface(link, vertices, mesh[1][:, ::-1] if np.prod(scale) < 0.0 else mesh[1]))
    return found


def _content(folder: Path, name: str, most_bytes: int) -> bytes:
    """Return the content of a file in a robot folder (raises SurefootError: it is elsewhere, missing or too large)."""
    try:
        path = (folder / name).resolve()
    except (ValueError, OSError, RuntimeError):  # a byte of zero, a circle of links
        raise SurefootError("value", "is no name of a file", "file") from None
    if not path.is_relative_to(folder.resolve()):
        raise SurefootError("value", "is not in the robot's folder", "file")
    return read_regular(path, most_bytes)


def _decoded(content: bytes, suffix: str) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices (n, 3) and triangles (m, 3) of a mesh file (raises SurefootError: MuJoCo cannot read it)."""
    import mujoco

    spec, name = mujoco.MjSpec(), f"mesh{suffix}"
    spec.assets = {name: content}  # of this alone, so that no file is opened
    mesh = spec.add_mesh(name="mesh", file=name)
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # of a volume it needs a closed surface
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        why = " ".join(str(error).partition("Element")[0].split()).removeprefix("Error: ")[:120]
        raise SurefootError("malformed", f"cannot be read ({why})", "file") from None
    turn = matrix_from_quat(model.mesh_quat[0])
    return model.mesh_pos[0] + model.mesh_vert.astype(float) @ turn.T, model.mesh_face.astype(np.int64)


class _Frames:
    """Frames of the links of an imported robot in those of the bodies of its source (raises KeyError: no such name)."""

    def __init__(self, robot: Robot, notes: ImportNotes, text: str) -> None:
        from ..robots.source import compiled

        self._model: Any = compiled(text)[0]
        self._links: dict[int, tuple[int, Array]] = {self._model.body(notes.trunk).id: (0, np.zeros(3))}
        for joint in robot.joints:
            self._add(notes.joints[joint.name], joint.link)
        followers = [i for i, link in enumerate(robot.links) if link.joint >= 0 and robot.joints[link.joint].link != i]
        for name, ours in notes.shared.items():  # one motor for several links
            own = next((i for i in followers if robot.joints[robot.links[i].joint].name == ours), None)
            if own is None:
                raise KeyError(f"{name!r} shares no motor here")
            followers.remove(own)
            self._add(name, own)

    def _add(self, joint: str, link: int) -> None:
        number = self._model.joint(joint).id
        self._links[int(self._model.jnt_bodyid[number])] = link, self._model.jnt_pos[number]

    def of(self, note: MeshNote) -> tuple[int, Array, Array]:
        """Return link, rotation (3, 3) and position (3,) m, link frame, of a mesh on the link or a body fixed to it."""
        model, body = self._model, int(self._model.body(note.body).id)
        turn, shift = matrix_from_quat(np.array(note.quat_wxyz)), np.array(note.position)
        while body not in self._links:
            if body == 0:
                raise KeyError(f"{note.body!r} is not on the trunk or a limb")
            up = matrix_from_quat(model.body_quat[body])
            turn, shift = up @ turn, model.body_pos[body] + up @ shift
            body = int(model.body_parentid[body])
        link, anchor = self._links[body]
        return link, turn, shift - anchor


def _few(found: list[LinkSurface], cell: float) -> list[LinkSurface]:
    """Return surfaces with `MOST_TRIANGLES` triangles together at most; `cell`: edge of the cubes to begin with, m."""
    while True:
        found = [coarse for each in found if len((coarse := _coarse(each, cell)).triangles)]
        if sum(len(each.triangles) for each in found) <= MOST_TRIANGLES:
            return found
        cell *= COARSER


def _coarse(surface: LinkSurface, cell: float) -> LinkSurface:
    """Return a surface whose vertices in the same cube of edge `cell`, m, are one, their mean; each triangle once."""
    place = np.floor(surface.vertices / cell).astype(np.int64)
    _, index = np.unique(_packed(place - place.min(axis=0)), return_inverse=True)
    means = [np.bincount(index, surface.vertices[:, i]) / np.bincount(index) for i in range(3)]
    corners = index[surface.triangles]
    first = corners.argmin(axis=1)[:, None]
    corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)  # the smallest first, the sense stays
    corners = corners[(corners[:, 0] < corners[:, 1]) & (corners[:, 0] < corners[:, 2])]
    corners = corners[corners[:, 1] != corners[:, 2]]
    _, once = np.unique(_packed(corners), return_index=True)
    used, numbers = np.unique(corners[np.sort(once)], return_inverse=True)
    return LinkSurface(surface.link, np.column_stack(means)[used], numbers.reshape(-1, 3))


def _packed(three: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number for each row of three numbers from 0 to 2 ** `INDEX_BITS` - 1, (n,)."""
    return (three[:, 0] << 2 * INDEX_BITS) | (three[:, 1] << INDEX_BITS) | three[:, 2]
