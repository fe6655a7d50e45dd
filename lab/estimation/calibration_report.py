"""Report of a log's calibration (legs, mounting of the IMU, time offset, force cells) as tables or JSON."""

from dataclasses import asdict, replace
from typing import Any

from ..cli.output import write, write_json, write_table
from .calibrate import CalibratedValue, calibrate, offset_note, proven
from .files import Opened
from .forces import calibrate_forces
from .log import Log


def report(log: Log) -> dict[str, Any]:
    """Return calibration results of a log as plain numbers; `corrections` are those that `--calibrated` applies."""
    found = calibrate(log)
    return {
        "log": log.name, "robot": log.robot_name, "windows": found.windows,
        "parameters": [asdict(one) for one in (*found.found(), *calibrate_forces(log))],
        "corrections": [asdict(one) for one in proven(found).found()],
    }  # fmt: skip


def show(log: Log, notes: tuple[str, ...], json: bool) -> None:
    """Print the report of a log as tables, or as JSON."""
    content = report(log)
    if json:
        write_json({**content, "notes": list(notes)})
        return
    write_table(("parameter", "differs by", "95 %", "in this log"), [_row(one) for one in content["parameters"]])
    corrections = [_row(one)[:3] for one in content["corrections"]]
    if corrections:
        write_table(("correction", "add", "95 %"), corrections)
    else:
        write("corrections  none: the log does not prove that a parameter is wrong")
    stated = "the robot file" if content["robot"] else "the log's own feet"
    write(f"note  {content['windows']} windows of standing feet; differences are to {stated}")
    for note in notes:
        write(f"note  {note}")


def corrected(opened: Opened) -> Opened:
    """Return a log with its feet corrected by the proven part of its calibration, and notes on that."""
    found = proven(calibrate(opened.log))
    added = tuple(f"corrected  {one.name}: {one.value:+.2f} +- {one.half:.2f} {one.unit}" for one in found.found())
    if not added:
        return replace(opened, notes=(*opened.notes, "nothing to correct"))
    return replace(opened, log=found.apply(), notes=opened.notes + added)


def checked(opened: Opened, correct: bool) -> Opened:
    """Return a log, with corrected feet if `correct`, and with a note if its feet are late or early."""
    opened = corrected(opened) if correct else opened
    return replace(opened, notes=(*opened.notes, *offset_note(opened.log)))


def _row(one: dict[str, Any]) -> tuple[str, str, str, str]:
    found = CalibratedValue(**one)
    seen = "observable" if found.observable else "not observable"
    return found.name, f"{found.value:+.2f} {found.unit}", f"+- {found.half:.2f}", seen
