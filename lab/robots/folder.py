"""Import of an MJCF or URDF file into a robot folder: description, source XML and notes of the import."""

import json
import shutil
import tempfile
from copy import deepcopy
from pathlib import Path
from typing import Any

from surefoot.robot.description import RobotError
from surefoot.robot.reader import ROBOT_FILE, described

from .meshes import copied_meshes
from .source import BALANCED, bare_text, check_name, compiled, read_tree
from .stance import can_stand, gait_numbers
from .write import Imported, assume_rotors, imported, plain_name, stand_on, toml_text


def import_robot(file: Path, out: Path, imu: str | None = None) -> Imported:
    """Import a robot file into a new folder with robot.toml, source.xml (without meshes), import.json and meshes/.

    Args:
        file: MJCF or URDF file.
        out: folder to write.
        imu: site or body of the trunk at which the inertial unit is, or `x,y,z` in m in the trunk's frame;
            None = what is called imu, else the trunk's frame.

    Raises:
        RobotError: the file describes no legged robot or has no such place, or the folder `out` exists.
    """
    if file.suffix not in (".xml", ".urdf", ".mjcf"):
        raise RobotError("value", "file", f"got {file.name!r}, allowed are *.xml, *.mjcf and *.urdf")
    if out.exists():
        raise RobotError("value", "out", f"got {out.name!r}, which exists; allowed is a new folder")
    check_name(file.stem, "file")
    notes: list[str] = []
    root = read_tree(file)
    whole = deepcopy(root)
    text = bare_text(root, notes)
    model, balanced = compiled(text)
    name = plain_name(out.name)
    made = imported(model, name if name[:1].isalpha() else f"robot_{name}".rstrip("_"), imu)
    made.assumed += notes
    if balanced:
        made.assumed.append(f"{BALANCED}: replaced by their mean")
    out.parent.mkdir(parents=True, exist_ok=True)
    trial = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        header = f"Imported from {file.name}; what is assumed stands in import.json."
        _write(trial, made, header)
        stand_on(made, described(trial / ROBOT_FILE))
        assume_rotors(made)
        _write(trial, made, header)
        robot = described(trial / ROBOT_FILE)
        if can_stand(robot):
            made.tables["gait"] |= gait_numbers(robot)
        if len(made.tables["gait"]) > 1:
            made.assumed.append("gait: from the lengths of the legs; better: [gait] after walks in the simulator")
            _write(trial, made, header)
        (trial / "source.xml").write_text(text, encoding="utf-8")
        meshes, left_out = copied_meshes(whole, file, trial)
        made.missing += left_out
        record: dict[str, Any] = {
            k: getattr(made, k) for k in ("trunk", "joints", "shared", "feet", "found", "assumed", "missing")
        }
        (trial / "import.json").write_text(json.dumps(record | {"meshes": meshes}, indent=1), encoding="utf-8")
        trial.chmod(0o755)
        trial.rename(out)
    finally:
        shutil.rmtree(trial, ignore_errors=True)
    return made


def _write(folder: Path, made: Imported, header: str) -> None:
    (folder / "robot.toml").write_text(toml_text(made.tables, header), encoding="utf-8")
