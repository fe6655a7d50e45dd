"""Reading of an untrusted MJCF or URDF file: checks of its XML, and compilation by MuJoCo without meshes."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from surefoot.files import read_regular
from surefoot.robot.description import RobotError
from surefoot.tables import shown

from .untrusted import MOST_BYTES, check_files, check_size, parsed

TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
SMALLEST_INERTIA = 1e-12
"""Least principal inertia of a URDF link, kg m^2; smaller ones are raised to it, since MuJoCo refuses zero."""
BALL = 0.4 * (3.0 / (4000.0 * math.pi)) ** (2 / 3)
"""Inertia of a ball of water (1000 kg/m^3) by its mass to the power 5/3, kg m^2 / kg^(5/3): 0.4 m r^2."""
BALANCED = "inertias that break the triangle inequality"
"""Beginning of the import note on inertias that MuJoCo has balanced (replaced by their mean)."""
MOST_INCLUDES = 50
"""Largest number of files that a robot file may include; more are refused."""
FULL_TURN = 2.0 * math.pi
"""Joint limit that replaces an infinite limit in a robot file, rad."""
NAN = re.compile(r"nan(\(\w*\))?", re.IGNORECASE)
"""Pattern of the words that MuJoCo reads as the number NaN."""
NAMING = ("name", "class", "model")
"""XML attributes of a robot file whose values are names, which `NAMES` must match."""
NAMES = re.compile(r"[\w .:/-]{1,120}")
"""Pattern that the names of bodies, joints and sites must match in full."""


def read_source(path: Path, notes: list[str] | None = None) -> str:
    """Return the XML text of a robot without meshes, with its included files in place.

    Args:
        path: MJCF or URDF file.
        notes: list to which a sentence is added for each number that had to be replaced.

    Raises:
        RobotError: as of `read_tree`, or a mass or an inertia is none.
    """
    return bare_text(read_tree(path), [] if notes is None else notes)


def read_tree(path: Path) -> ElementTree.Element:
    """Return the root of a robot's XML, with its included files in place and its meshes.

    Raises:
        RobotError: the file is no XML, declares an entity, includes a file outside its folder, or has markup in a name.
    """
    content = read_regular(path, MOST_BYTES)
    root, left = parsed(content), MOST_BYTES - len(content)
    folder, count = path.resolve().parent, 0
    while (found := _include(root)) is not None:
        parent, element = found
        name, count = element.get("file", ""), count + 1
        inner = (folder / name).resolve()
        if not inner.is_relative_to(folder):
            raise RobotError("value", "include.file", f"got {shown(name)}, allowed is a file below {folder.name}/")
        if count > MOST_INCLUDES:
            raise RobotError("value", "include.file", f"got more than {MOST_INCLUDES} files, allowed are fewer")
        at = list(parent).index(element)
        content = read_regular(inner, left)
        left -= len(content)
        parent[at : at + 1] = list(parsed(content))
        check_size(root)
    if root.tag not in ("mujoco", "robot"):
        raise RobotError("value", "file", f"got a root element {shown(root.tag)}, allowed are mujoco, robot")
    names = {element.get(key) for element in root.iter() for key in NAMING}
    for element in root.iter():
        _check_numbers(element, names)
        name = element.get("name")
        if element.tag in ("body", "joint", "freejoint", "site", "link", "robot") and name is not None:
            check_name(name, f"{element.tag}.name")
    mimic = next((joint for joint in root.iter("joint") if joint.find("mimic") is not None), None)
    if mimic is not None:
        text = f"got a mimic joint {mimic.get('name')!r}, allowed are joints with a motor; make it fixed in a copy"
        raise RobotError("value", "joint.mimic", text)
    if root.tag == "robot":
        _check_tree(root)
    check_files(root)
    return root


def bare_text(root: ElementTree.Element, notes: list[str]) -> str:
    """Return the XML text of a robot without its meshes, which are removed from `root`.

    Args:
        root: root of the XML, changed in place.
        notes: list to which a sentence is added for each number that is replaced.

    Raises:
        RobotError: a mass or an inertia is none.
    """
    for body in root.iter("body"):
        if body.find("inertial") is None and any(geom.get("mesh") for geom in body.findall("geom")):
            text = "without that of its meshes, which are not read; better: an <inertial> in the file"
            notes.append(f"mass of body {body.get('name')!r}: {text}")
    _without_meshes(root)
    _check_masses(root)
    _repair_inertias(root, notes)
    return ElementTree.tostring(root, encoding="unicode")


def _check_tree(root: ElementTree.Element) -> None:
    """Raise RobotError for a URDF with a link that is the child of two joints, or with more than one root link."""
    children = Counter(child.get("link", "") for child in root.iterfind("joint/child"))
    twice = next((name for name, count in children.items() if count > 1), None)
    if twice is not None:
        text = (
            f"got {shown(twice)} as child of two joints, allowed is a tree without closed loops; remove one in a copy"
        )
        raise RobotError("value", "joint.child", text)
    roots = [name for link in root.findall("link") if (name := link.get("name", "")) not in children]
    if len(roots) > 1:
        cure = f"with a fixed joint from {shown(roots[0])} to {shown(roots[1])}, or without its link"
        text = (
            f"got {', '.join(map(shown, roots[:3]))} as roots, allowed is one root; what works instead: a copy {cure}"
        )
        raise RobotError("value", "link", text)


def _check_numbers(element: ElementTree.Element, names: set[str | None]) -> None:
    """Raise RobotError for NaN, for infinity except in limits, and for unexpanded xacro elements."""
    if "xacro" in element.tag:
        text = "got an element of xacro, allowed is what it becomes: `xacro ROBOT.urdf.xacro -o ROBOT.urdf`"
        raise RobotError("value", "file", text)
    for key, value in element.attrib.items():
        found = 0.0 if value in names or element.tag == "text" else _odd_number(value)
        limit = element.tag in ("limit", "safety_controller") or key.endswith("range")
        if math.isnan(found) or (math.isinf(found) and not limit):
            raise RobotError("value", f"{element.tag}.{key}", f"got {shown(value)}, allowed are finite numbers")


def _odd_number(value: str) -> float:
    """Return NaN or infinity if a text of numbers, separated by white space, contains one, else 0."""
    try:
        numbers = [float(NAN.sub("nan", word)) for word in value.split()]
    except ValueError:  # no list of numbers
        return 0.0
    return next((number for number in numbers if math.isnan(number)), next(filter(math.isinf, numbers), 0.0))


def check_name(name: str, field: str) -> None:
    """Raise RobotError if a name has markup or control characters; `field`: its place in the file, for the error."""
    if not NAMES.fullmatch(name):
        raise RobotError("value", field, f"got {shown(name)}, allowed are letters, digits, space and _ . : / -")


def is_urdf(text: str) -> bool:
    """Return True if a robot's XML text is a URDF, False if it is an MJCF (raises RobotError: it is no such XML)."""
    return parsed(text.encode()).tag == "robot"


def compiled(text: str, balance: bool = False, free: str | None = None) -> tuple[mujoco.MjModel, bool]:
    """Compile a robot's XML without meshes; return the model, and True if inertias were balanced, else False.

    Bodies without a joint are kept, not fused with their parents.

    Args:
        text: XML of an MJCF or URDF.
        balance: True: set inertias that break the triangle inequality to their mean, as MuJoCo's `balanceinertia` does.
        free: name of a root body that gets a free joint if it has none; None = no free joint is added.

    Raises:
        RobotError: MuJoCo cannot read the text or would open a file, or the model is no mechanism of finite numbers.
    """
    root, spec = parsed(text.encode()), None
    check_files(root)
    try:
        spec = mujoco.MjSpec.from_string(text)
        mesh = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
        for geom in [geom for geom in spec.geoms if int(geom.type) in [int(kind) for kind in mesh]]:
            spec.delete(geom)
        for thing in [*spec.skins, *spec.meshes, *spec.hfields]:
            spec.delete(thing)
        if root.tag == "robot":  # a link without inertial has no mass, whatever its shape is
            spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        if free is not None and not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
            trunk = spec.body(free)
            if trunk is None:
                raise RobotError("unknown_name", "trunk", f"got {free!r}, which the file does not have")
            trunk.add_freejoint()
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
        spec.compiler.balanceinertia = spec.compiler.balanceinertia or balance
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        if "balanceinertia" in str(error) and not balance:
            return compiled(text, True, free)
        if spec is not None and "inertia" in str(error):
            _check_inertias(text)
        said = " ".join(str(error).split())[:200]
        allowed = "allowed is a file that MuJoCo compiles, each moving body with mass and inertia above 0"
        raise RobotError("value", "file", f"got {said!r}, {allowed}") from None
    return _finite(model), balance


def _check_inertias(text: str) -> None:
    """Raise RobotError with a stand-in if a moved body states a mass or an inertia that MuJoCo refuses."""
    found: list[tuple[str, float, list[float]]] = []
    for body in mujoco.MjSpec.from_string(text).bodies:
        if body.joints and body.explicitinertial:
            xx, yy, zz, xy, xz, yz = body.fullinertia
            whole = np.diag(body.inertia) if math.isnan(xx) else np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            least = np.linalg.eigvalsh(whole)[0]
            if min(body.mass, least) <= mujoco.mjMINVAL:
                found.append((body.name, body.mass, whole[np.triu_indices(3)].tolist()))
    if not found:
        return
    name, mass, tensor = found[0]
    values = ", ".join(f"{key} {value:g}" for key, value in zip(TENSOR, tensor, strict=True))
    more = f", and such of {', '.join(other for other, _, _ in found[1:])}" if found[1:] else ""
    ball = f"ixx, iyy and izz of {BALL * mass ** (5 / 3):.3g}, as of a ball of water of its mass"
    cure = ball if mass > mujoco.mjMINVAL else "a mass, or a fixed joint"
    got = f"got mass {mass:g}, {values} of {name!r}{more}, allowed are a mass and a least principal inertia above 0"
    raise RobotError("value", "inertial", f"{got}; what works instead: a copy in which {name!r} has {cure}")


def _finite(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model with infinite joint limits set to one turn; raise RobotError for other non-finite numbers."""
    np.nan_to_num(model.jnt_range, copy=False, nan=math.nan, posinf=FULL_TURN, neginf=-FULL_TURN)
    bodies = ("mass", "inertia", "pos", "quat", "ipos", "iquat")
    for name in (*(f"body_{each}" for each in bodies), "jnt_pos", "jnt_axis", "jnt_range", "geom_pos", "site_pos"):
        numbers = getattr(model, name)
        if not np.isfinite(numbers).all():
            at = np.argwhere(~np.isfinite(numbers))[0]
            kind = {"body": model.body, "jnt": model.joint, "geom": model.geom, "site": model.site}[name.split("_")[0]]
            text = f"got {numbers[tuple(at)]} in {name} of {kind(at[0]).name!r}, allowed are finite numbers"
            raise RobotError("value", "file", text)
    return model


def _include(root: ElementTree.Element) -> tuple[ElementTree.Element, ElementTree.Element] | None:
    return next(((parent, child) for parent in root.iter() for child in parent if child.tag == "include"), None)


def _without_meshes(root: ElementTree.Element) -> None:
    """Remove visuals, textures and collision meshes."""
    for parent in root.iter():
        for child in list(parent):
            looks = root.tag == "robot" and child.tag in ("visual", "transmission")
            solid = root.tag == "robot" and child.tag == "collision" and child.find("geometry/mesh") is not None
            painted = root.tag == "mujoco" and parent.tag == "asset" and child.tag == "texture"
            if looks or solid or painted:
                parent.remove(child)
    for element in root.iter("material"):
        element.attrib.pop("texture", None)
    for element in root.iter("compiler"):  # MuJoCo looks for files there
        for key in ("meshdir", "texturedir", "assetdir"):
            element.attrib.pop(key, None)


def _check_masses(root: ElementTree.Element) -> None:
    """Raise RobotError for a negative mass, with the name of its body, link or geom."""
    for body in root.iter():
        for element in (*body.findall("geom"), *body.findall("inertial"), *body.findall("inertial/mass")):
            mass = element.get("value" if element.tag == "mass" else "mass")
            if mass is not None and mass.strip().startswith("-"):
                text = (
                    f"got {shown(mass)} of {body.tag} {shown(body.get('name', 'without a name'))}, allowed is 0 or more"
                )
                raise RobotError("value", "geom.mass" if element.tag == "geom" else "inertial.mass", text)


def _repair_inertias(root: ElementTree.Element, notes: list[str]) -> None:
    """Make the inertias of URDF links that no joint moves positive, as MuJoCo needs; mass and position stay."""
    children = {joint.find("child"): joint.get("type") for joint in root.findall("joint")}
    moved = {child.get("link") for child, kind in children.items() if child is not None and kind != "fixed"}
    for link in root.findall("link"):
        inertial, name = link.find("inertial"), link.get("name")
        tensor, mass = (None, None) if inertial is None else (inertial.find("inertia"), inertial.find("mass"))
        if inertial is None or tensor is None or mass is None or name in moved:
            continue
        try:
            xx, xy, xz, yy, yz, zz = (float(tensor.get(key, "0")) for key in TENSOR)
            weightless = float(mass.get("value", "0")) == 0.0
            whole = np.asarray_chkfinite([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        except ValueError as error:
            raise RobotError("value", f"link {name!r}.inertial", f"{error}, allowed are numbers") from None
        if weightless and not whole.any():
            link.remove(inertial)
        elif np.linalg.eigvalsh(whole)[0] < SMALLEST_INERTIA:
            diagonal = (("ixx", xx), ("iyy", yy), ("izz", zz))
            tensor.attrib.update({key: repr(max(value, SMALLEST_INERTIA)) for key, value in diagonal})
            tensor.attrib.update(ixy="0", ixz="0", iyz="0")
            notes.append(f"inertia of {name}: only its diagonal, the whole is not positive; better: correct the file")
