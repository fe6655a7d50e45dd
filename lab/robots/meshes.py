"""Mesh files of an imported robot, copied for drawing; physics does not use them."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
from copy import deepcopy
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from surefoot.errors import SurefootError
from surefoot.files import read_regular
from surefoot.tables import shown

from .anatomy import floats
from .untrusted import check_files

FOLDER = "meshes"
"""Name of the folder in a robot folder that has its meshes."""
SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".glb")
MOST_FILES, MOST_MESH_BYTES = 200, 256 * 1024 * 1024
"""`MOST_FILES`: largest number of mesh files that are copied; `MOST_MESH_BYTES`: their largest size together, bytes."""


def copied_meshes(root: ElementTree.Element, source: Path, out: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Copy the meshes that a robot file refers to, from at or below its folder, into `meshes/` of a robot folder.

    Args:
        root: robot file with its included files in place, with its meshes.
        source: path of the file.
        out: robot folder.

    Returns:
        For each place of a copied mesh: file in the robot folder, body in the source, position (3) m, quat_wxyz and
        scale (3) in the body's frame; and notes on meshes that are not copied.
    """
    folder, left, notes = source.resolve().parent, MOST_MESH_BYTES, list[str]()
    (out / FOLDER).mkdir()
    names: dict[str, str] = {}
    refused: set[str] = set()
    found = []
    try:
        places = _of_urdf(root) if root.tag == "robot" else _of_mjcf(root)
    except (SurefootError, ValueError, mujoco.FatalError) as error:
        places = []
        notes.append(f"meshes for drawing: their places cannot be read ({' '.join(str(error).split())[:120]})")
    for name, place in places:
        if name not in names and name not in refused:
            path = _inside(name, folder)
            why = "is not below the folder of the file" if path is None else ""
            why = f"is more than the {MOST_FILES} files that are copied" if len(names) >= MOST_FILES else why
            if path is not None and not why:
                try:
                    content = read_regular(path, left)
                    left -= len(content)
                    taken = path.name in {Path(each).name for each in names.values()}
                    names[name] = f"{FOLDER}/{len(names)}_{path.name}" if taken else f"{FOLDER}/{path.name}"
                    (out / names[name]).write_bytes(content)
                except SurefootError:
                    why = f"is unreadable, or more than {MOST_MESH_BYTES} bytes with those before it"
            if why:
                refused.add(name)
                notes.append(f"mesh of {shown(name)}: {why}, so it is not copied; physics does not need it")
        if name in names:
            found.append({"file": names[name], **place})
    if not names:
        (out / FOLDER).rmdir()
    return found, notes


def _inside(name: str, folder: Path) -> Path | None:
    """Return the path of a mesh at or below a folder; None if it has none there, or the ending of no mesh."""
    package = name.startswith("package://")
    plain = name.removeprefix("package://").removeprefix("file://")
    for each in (plain, plain.partition("/")[2]) if package else (plain,):
        path = (folder / each).resolve()
        if path.suffix.lower() in SUFFIXES and path.is_relative_to(folder) and path.is_file():
            return path
    return None


def _of_urdf(root: ElementTree.Element) -> list[tuple[str, dict[str, Any]]]:
    found = []
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            mesh, origin = visual.find("geometry/mesh"), visual.find("origin")
            if mesh is not None:
                at = {} if origin is None else origin.attrib
                quat = np.zeros(4)
                mujoco.mju_euler2Quat(quat, _three(at.get("rpy", "0 0 0")), "XYZ")
                position, scale = _three(at.get("xyz", "0 0 0")), _three(mesh.get("scale", "1 1 1"))
                found.append((mesh.get("filename", ""), _place(link.get("name", ""), position, quat, scale)))
    return found


def _of_mjcf(root: ElementTree.Element) -> list[tuple[str, dict[str, Any]]]:
    """Return file and place of each mesh, as MuJoCo has them for small spheres in the place of the meshes."""
    root, below = deepcopy(root), ""
    for element in root.iter("compiler"):
        assets = element.attrib.pop("assetdir", None)
        below = element.attrib.pop("meshdir", None) or assets or below
        element.attrib.pop("texturedir", None)
    check_files(root)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    files = {mesh.name or Path(mesh.file).stem: (mesh.file, np.array(mesh.scale)) for mesh in spec.meshes}
    shapes = []
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and geom.meshname in files:
            shapes.append((geom, geom.meshname, geom.parent.name))
            geom.type, geom.size, geom.meshname, geom.mass = mujoco.mjtGeom.mjGEOM_SPHERE, [1e-3, 0, 0], "", 0.0
        elif geom.type in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD):
            spec.delete(geom)
    for thing in [*spec.skins, *spec.meshes, *spec.hfields, *spec.materials, *spec.textures]:
        spec.delete(thing)
    for geom in spec.geoms:
        geom.material = ""
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    spec.compiler.balanceinertia = True
    model = spec.compile()
    return [
        (str(Path(below) / files[name][0]), _place(body, model.geom_pos[g.id], model.geom_quat[g.id], files[name][1]))
        for g, name, body in shapes
    ]


def _place(body: str, position: Any, quat: Any, scale: Any) -> dict[str, Any]:
    return {"body": body, "position": floats(position), "quat_wxyz": floats(quat), "scale": floats(scale)}


def _three(text: str) -> Any:
    """Return three numbers of a text (raises ValueError: it has others)."""
    numbers = np.asarray_chkfinite([float(word) for word in text.split()])
    if numbers.shape != (3,):
        raise ValueError(f"got {text[:60]!r}, allowed are three numbers")
    return numbers
