"""Commands `surefoot bag import|export`: convert ROS bags and tables to recordings, and recordings to other formats."""

import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.bag import app as bag
from ..cli.completion import beginning, robots
from ..cli.output import (
    Json,
    notify,
    refuse_existing,
    refuse_unreachable,
    use_json,
    write,
    write_answer,
    write_json,
    write_table,
)
from ..cli.progress import Progress
from .formats import ENDINGS, check_format, check_out, check_rate

if TYPE_CHECKING:
    from .raw import RawLog
    from .ros import BagTopics

app = typer.Typer()
app.add_typer(bag)
OFF_SHARE = 0.6
"""Default force below which a foot counts as lifted, as a share of the force from which on it counts as standing."""


def _formats(incomplete: str) -> list[str]:
    """Return the names of export formats that begin with `incomplete`, for shell completion."""
    return beginning(ENDINGS, incomplete)


@bag.command("import")
def import_log(
    log: Annotated[Path, typer.Argument(help="ROS 1 or 2 bag, MCAP, CSV or NPZ; docs/logs.md.")],
    robot: Annotated[str, typer.Option(help="Robot description: a name, or a folder.", autocompletion=robots)],
    imu: Annotated[str, typer.Option(help="Topic of a sensor_msgs/Imu.")] = "/imu/data",
    joints: Annotated[str, typer.Option(help="Topic of a sensor_msgs/JointState.")] = "/joint_states",
    contacts: Annotated[str | None, typer.Option(help="TOPIC[.FIELD[a:b]] of foot forces or flags.")] = None,
    feet: Annotated[str | None, typer.Option(help="Legs in the order of the contacts: FR,FL,RR,RL.")] = None,
    joint_names: Annotated[str | None, typer.Option(help="Names of the positions, in their order.")] = None,
    imu_frame: Annotated[str, typer.Option(help="imu or base_link, where the log does not state it.")] = "",
    contact_on: Annotated[float | None, typer.Option(help="Force from which a foot stands, N.")] = None,
    contact_off: Annotated[float | None, typer.Option(help="Force below which it stands no more, N.")] = None,
    clock: Annotated[str, typer.Option(help="header or record: which stamps count.")] = "header",
    sort: Annotated[bool, typer.Option("--sort", help="Put rows into the order of their stamps.")] = False,
    calibration: Annotated[Path | None, typer.Option(help="TOML file to write for drivers: zero, scale.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Recording to write [the log's name].")] = None,
    json: Json = False,
) -> None:
    """Make a recording of another program's log, with estimates and margins as if the services had run on the robot."""
    from surefoot.errors import SurefootError
    from surefoot.record.fields import FieldPath
    from surefoot.robot.reader import load_robot

    from .fit import fitted, save_calibration
    from .importing import check_out, record
    from .raw import TABLES
    from .ros import BagTopics

    use_json(json)
    if clock not in ("header", "record"):
        raise SurefootError("invalid", f"--clock: got {clock!r}, allowed are header and record", "clock")
    description, stated = load_robot(robot), _thresholds(contact_on, contact_off)
    if calibration is not None:
        refuse_existing(calibration, force=True)
    wanted = BagTopics(
        imu, joints, None if contacts is None else FieldPath.of(contacts), _words(joint_names), _words(feet),
        clock == "record", sort,
    )  # fmt: skip
    if wanted.contacts is not None and log.suffix.lower() in TABLES:
        got = wanted.contacts.topic
        raise SurefootError("invalid", f"got {got!r}; {log.name} is a table, whose columns are read", "contacts")
    path = out or Path(f"{log.resolve().stem}.mcap")
    check_out(path)
    refuse_unreachable(path, makes_folders=True)
    with Progress(f"{log.name} to {path.name}", reads=[log]) as progress:
        made = fitted(_read(log, wanted), description, stated, imu_frame)
        player = record(made, robot, path, progress.at)
    refused = dict(player.intake.refused)
    files = [str(path)]
    if calibration is not None and made.contact is None:
        made.notes.append(f"{calibration} is not written: the log has no foot forces that could be calibrated")
    elif calibration is not None and made.contact is not None:
        files.append(str(save_calibration(calibration, made.contact)))
    seconds = 1e-9 * float(made.imu.stamp_ns[-1] - made.imu.stamp_ns[0])
    facts = {"seconds": seconds, "inertial_rows": len(made.imu.stamp_ns), "joint_rows": len(made.joints.stamp_ns)}
    if json:
        write_json({**facts, "refused": refused, "notes": made.notes, "files": files})
        return
    rows = [(key.replace("_", " "), f"{value:.6g}") for key, value in facts.items()]
    _show([*rows, *((f"refused: {key}", str(n)) for key, n in refused.items())], made.notes, files)


def _show(rows: list[tuple[str, str]], notes: list[str], files: list[str]) -> None:
    """Print what was imported as a table of quantities and values, its notes and files; the first is the recording."""
    write_table(("quantity", "value"), rows)
    for note in notes:
        write(f"note  {note}")
    for each in files:
        write(f"file  {each}")
    write(f"next: surefoot report {quote(files[0])}, surefoot estimate {quote(files[0])}")


def _read(log: Path, wanted: "BagTopics") -> "RawLog":
    """Return the raw log of a bag or table, with the names of joints and feet from the options, if given."""
    from .raw import TABLES, log_of_table
    from .ros import log_of_bag

    raw = log_of_table(log, wanted.sort) if log.suffix.lower() in TABLES else log_of_bag(log, wanted)
    raw.joint_names, raw.feet_names = wanted.joint_names or raw.joint_names, wanted.feet or raw.feet_names
    return raw


def _thresholds(on: float | None, off: float | None) -> tuple[float, float] | None:
    """Return the foot forces (from which a foot stands, below which it is lifted), N; None if `on` is not given."""
    from surefoot.errors import SurefootError

    if on is None:
        if off is not None:
            raise SurefootError(
                "invalid", f"--contact-off: got {off:g} without --contact-on, allowed are both", "contact-off"
            )
        return None
    low = OFF_SHARE * on if off is None else off
    if not 0.0 <= low <= on < math.inf or on == 0.0:
        raise SurefootError(
            "invalid",
            f"--contact-on, --contact-off: got {on:g} and {low:g} N, allowed is 0 <= off <= on, above 0",
            "contact-on",
        )
    return on, low


def _words(text: str | None) -> tuple[str, ...]:
    return () if text is None else tuple(word.strip() for word in text.split(",") if word.strip())


@bag.command("export")
def export_recording(
    file: Annotated[Path, typer.Argument(help="Recording (MCAP).")],
    to: Annotated[str, typer.Option(help="rosbag2, csv, parquet, tum or foxglove.", autocompletion=_formats)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File or folder to write [the recording's name].")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Robot description [that of the recording].", autocompletion=robots)
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Snapshots a second, of foxglove [one for each tick].")] = None,
    json: Json = False,
) -> None:
    """Write a recording in a format of other programs."""
    use_json(json)
    check_format(to)
    check_rate(to, rate)
    target = out or file.with_name(f"{file.stem}{ENDINGS[to]}")
    check_out(to, target)
    refuse_unreachable(target, makes_folders=True)
    with Progress(f"{file.name} to {to}", reads=[file]) as progress:
        from surefoot.record.recording import open_readable

        from .exporting import export

        recording = open_readable(file)
        path = export(recording, to, target, robot, progress.at, rate)
    for note in recording.notes:
        notify(f"note  {note}")
    write_answer({"file": str(path)}, f"file  {path}")
