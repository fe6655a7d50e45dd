"""Folder of an imported robot, and its comparison with MuJoCo's own kinematics of the file."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from surefoot.robot.description import RobotError
from surefoot.robot.kinematics import com, foot_positions
from surefoot.robot.reader import load_robot

from .anatomy import pose
from .source import check_name, compiled, read_source
from .stance import can_stand, gait_numbers
from .write import Imported, imported, plain_name, stand_on, toml_text

POSTURES = 20
"""Number of seeded postures at which a robot is compared."""
MOST_DIFFERENCE = 1e-9  # kg and m, largest allowed difference from MuJoCo: rounding is below 1e-12


def import_robot(file: Path, out: Path) -> Imported:
    """Write the folder of a robot: robot.toml, source.xml (without meshes) and import.json; all of it or nothing.

    Raises:
        RobotError: the file is no robot, or the folder exists.
    """
    if file.suffix not in (".xml", ".urdf", ".mjcf"):
        raise RobotError("value", "file", f"got {file.name!r}, allowed are *.xml, *.mjcf and *.urdf")
    if out.exists():
        raise RobotError("value", "out", f"got {out.name!r}, which exists; allowed is a new folder")
    check_name(file.stem, "file")
    notes: list[str] = []
    text = read_source(file, notes)
    model, balanced = compiled(text)
    name = plain_name(out.name)
    made = imported(model, name if name[:1].isalpha() else f"robot_{name}".rstrip("_"))
    made.assumed += notes
    if balanced:
        made.assumed.append("inertias that break the triangle inequality: replaced by their mean")
    out.parent.mkdir(parents=True, exist_ok=True)
    trial = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        header = f"Imported from {file.name}; what is assumed stands in import.json."
        _write(trial, made, header)
        stand_on(made, load_robot(trial))
        _write(trial, made, header)
        robot = load_robot(trial)
        if can_stand(robot):
            made.tables["gait"] |= gait_numbers(robot)
            made.assumed.append("gait: from the lengths of the legs; better: [gait] after walks in the simulator")
            _write(trial, made, header)
        (trial / "source.xml").write_text(text, encoding="utf-8")
        record = {k: getattr(made, k) for k in ("trunk", "joints", "feet", "found", "assumed", "missing")}
        (trial / "import.json").write_text(json.dumps(record, indent=1), encoding="utf-8")
        trial.chmod(0o755)
        trial.rename(out)
    finally:
        shutil.rmtree(trial, ignore_errors=True)
    return made


def _write(folder: Path, made: Imported, header: str) -> None:
    (folder / "robot.toml").write_text(toml_text(made.tables, header), encoding="utf-8")


def differences(folder: Path) -> dict[str, float]:
    """Largest differences of mass (kg), centre of mass (m) and feet (m) from MuJoCo over `POSTURES` postures."""
    robot = load_robot(folder)
    notes: dict[str, Any] = json.loads((folder / "import.json").read_text(encoding="utf-8"))
    model, _ = compiled(read_source(folder / "source.xml"))
    data, trunk = mujoco.MjData(model), model.body(notes["trunk"]).id
    ids = [model.joint(notes["joints"][name]).id for name in robot.joint_names]
    mass = float(model.body_subtreemass[trunk])
    worst = {"mass_kg": abs(robot.mass - mass), "com_m": 0.0, "feet_m": 0.0}
    random = np.random.default_rng(26)
    for _ in range(POSTURES):
        q = random.uniform(robot.joint_lower, robot.joint_upper)
        angles = np.zeros(model.njnt)
        angles[ids] = q
        pose(model, data, angles)
        rot, origin = data.xmat[trunk].reshape(3, 3), data.xpos[trunk]
        whole = data.subtree_com[trunk]
        worst["com_m"] = max(worst["com_m"], float(np.abs(rot.T @ (whole - origin) - com(robot.model, q)).max()))
        feet = foot_positions(robot.model, q)
        for leg, ours in zip(robot.legs, feet, strict=True):
            note = notes["feet"][leg.name]
            body = model.body(note["body"]).id
            arm = data.xmat[body].reshape(3, 3) @ leg.foot.position
            theirs = rot.T @ (data.xanchor[note["joint"]] + arm - origin)
            worst["feet_m"] = max(worst["feet_m"], float(np.abs(ours - theirs).max()))
    return worst
