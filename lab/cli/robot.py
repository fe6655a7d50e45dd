"""`surefoot robot list|import|check`."""

from pathlib import Path
from typing import Annotated

import typer

from .output import Json, use_json, write, write_json, write_table

app = typer.Typer(help="Robot descriptions.", no_args_is_help=True)


@app.command("list")
def list_robots(json: Json = False) -> None:
    """List the robots that come with the package."""
    from surefoot.robot.reader import load_robot, robot_names

    use_json(json)
    robots = {name: load_robot(name) for name in robot_names()}
    rows = {
        name: {"kind": robot.kind, "legs": robot.nlegs, "joints": robot.nj, "hash": robot.hash}
        for name, robot in robots.items()
    }
    if json:
        write_json(rows)
    else:
        columns = ("robot", "kind", "legs", "joints", "hash")
        write_table(columns, [(name, *list(row.values())[:3], str(row["hash"])[:12]) for name, row in rows.items()])


@app.command("import")
def import_file(
    file: Annotated[Path, typer.Argument(help="MJCF or URDF file of a robot.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write [the file's name].")] = None,
    json: Json = False,
) -> None:
    """Write a robot folder from an MJCF or URDF file, and report what was found, assumed and missing."""
    from ..robots.folder import differences, import_robot

    use_json(json)
    out = out or Path(file.stem)
    made = import_robot(file, out)
    worst = differences(out)
    if json:
        lists = {"found": made.found, "assumed": made.assumed, "missing": made.missing}
        write_json({"out": str(out), **lists, "differences": worst})
        return
    rows = [(kind, text) for kind in ("found", "assumed", "missing") for text in getattr(made, kind)]
    write_table(("what", "of the robot"), rows)
    write(f"against MuJoCo: {', '.join(f'{key} {value:.1e}' for key, value in worst.items())}")
    write(f"next: surefoot robot check ./{out}")


@app.command()
def check(
    name: Annotated[str, typer.Argument(help="Name of a robot, or path of a folder with a robot.toml.")],
    json: Json = False,
) -> None:
    """Read and validate a robot description and show what was understood."""
    import numpy as np

    from surefoot.robot.description import RobotError
    from surefoot.robot.kinematics import com, foot_positions
    from surefoot.robot.reader import load_robot

    use_json(json)
    robot = load_robot(name)
    feet = foot_positions(robot.model, robot.neutral)
    centre = com(robot.model, robot.neutral)
    size = np.ptp(feet[:, :2], axis=0)
    content = {
        "name": robot.name,
        "kind": robot.kind,
        "hash": robot.hash,
        "joints": robot.joint_names,
        "legs": [leg.name for leg in robot.legs],
        "mass_kg": float(np.sum(robot.model.mass)),
        "neutral_feet_m": feet.tolist(),
        "neutral_com_m": centre.tolist(),
        "foot_box_m": size.tolist(),
    }
    if (Path(name) / "import.json").is_file():
        from ..robots.folder import MOST_DIFFERENCE, differences

        content["differences"] = worst = differences(Path(name))
        if max(worst.values()) > MOST_DIFFERENCE:
            text = f"got {worst}, allowed are {MOST_DIFFERENCE}: robot.toml differs from source.xml"
            raise RobotError("value", "differences", text)
    if json:
        write_json(content)
        return
    write_table(
        ("quantity", "value"),
        [
            ("name, kind", f"{robot.name}, {robot.kind}"),
            ("hash", robot.hash),
            ("legs", " ".join(leg.name for leg in robot.legs)),
            ("joints", f"{robot.nj}: {' '.join(robot.joint_names)}"),
            ("mass", f"{content['mass_kg']:.3f} kg"),
            ("box of the feet, neutral", f"{size[0]:.3f} x {size[1]:.3f} m"),
            ("trunk over the feet, neutral", f"{-feet[:, 2].mean():.3f} m"),
            ("centre of mass, neutral", " ".join(f"{value:+.4f}" for value in centre) + " m"),
        ],
    )
