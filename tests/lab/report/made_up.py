"""A made-up walk of four legs as a recording has it, and edits by which one thing in it goes wrong."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.lab.report import why
from surefoot.lab.report.signals import Signals
from surefoot.lab.report.why import Explanation, explain

TICKS, AT = 800, 500
LEGS, JOINTS = 4, 12
FEET = ((0.1, 0.1), (0.1, -0.1), (-0.1, -0.1), (-0.1, 0.1))
Edit = Callable[[dict[str, dict[int, dict[str, Any]]]], None]


def walk(seed: int = 0) -> dict[str, dict[int, dict[str, Any]]]:
    """Return the messages of a walk by key and tick: two legs stand, two swing, every half second the others."""
    rng, rows = np.random.default_rng(seed), {key: {} for key in ("hw/tick", "hw/imu", "sim/truth", "state/gait")}
    rows |= {
        key: {} for key in ("cmd/joints", "hw/joints", "hw/contacts", "state/velocity", "state/stability", "sim/status")
    }
    for tick in range(TICKS):
        stance = [leg % 2 == tick // 50 % 2 for leg in range(LEGS)]
        angles = [0.3 * np.sin(0.02 * tick + joint) for joint in range(JOINTS)]
        head = {"epoch": 1, "tick": tick, "seq": tick, "source": "x", "stamp_ns": tick * 10**7}
        rows["hw/tick"][tick] = {**head, "roster": ["estimator", "walker"], "held": False}
        noise = rng.normal(0.0, 0.01, 6)
        rows["hw/imu"][tick] = {
            **head,
            "gyro": noise[:3].tolist(),
            "acc": (noise[3:] + np.array([0.0, 0.0, 9.81])).tolist(),
        }
        rows["cmd/joints"][tick] = {**head, "position": angles}
        rows["sim/truth"][tick] = {
            **head, "fallen": False, "velocity": [0.05, 0.0, 0.0], "contact_sliding": [0.0] * LEGS,
            "foot_force_n": [10.0 * s for s in stance], "com": [5e-4 * tick, 0.0, 0.1],
            "position": [5e-4 * tick, 0.0, 0.1],
            "foot_position": [[5e-4 * tick + x, y, 0.0] for x, y in FEET],
        }  # fmt: skip
        if tick % 3 == 0:
            rows["hw/joints"][tick] = {**head, "position": [a + 1e-4 * noise[0] for a in angles]}
            rows["hw/contacts"][tick] = {**head, "touch": [[s] for s in stance]}
        rows["state/gait"][tick] = {**head, "state": "walking", "reason": "", "stance": stance}
        rows["state/velocity"][tick] = {
            **head, "inputs_ok": True, "filter_ok": True, "slipping": [False] * LEGS, "g_up": [0.0, 0.0, 9.81]
        }  # fmt: skip
        rows["state/stability"][tick] = {**head, "margin_planned": 0.05, "margin_measured": 0.04, "mu": 0.6}
        rows["state/stability"][tick]["stance"] = stance
    rows["sim/status"][0] = {**rows["hw/tick"][0], "stopped": "", "failed": ""}
    return rows


def edited(edit: Edit, without: tuple[str, ...] = ()) -> Signals:
    """Return the signals of the walk after an edit, without some keys."""
    rows = walk()
    edit(rows)
    found = Signals()
    for key, messages in rows.items():
        if key not in without:
            found.rows[key] = [messages[tick] for tick in sorted(messages)]
    return found


def explained(signals: Signals, monkeypatch: pytest.MonkeyPatch) -> Explanation:
    monkeypatch.setattr(why, "read_signals", lambda path, progress: signals)
    return explain(Path("run.mcap"))


def falls(rows: Any, at: int = AT + 100) -> None:
    for tick in range(at, TICKS):
        rows["sim/truth"][tick]["fallen"] = True


def after(rows: Any, key: str, change: Callable[[dict[str, Any], int], None], at: int = AT) -> None:
    for tick, row in rows[key].items():
        if tick >= at:
            change(row, tick - at)


def drops(key: str) -> Edit:
    def edit(rows: Any) -> None:
        rows[key] = {tick: row for tick, row in rows[key].items() if tick < AT}

    return edit


def slides(rows: Any) -> None:
    after(rows, "sim/truth", lambda row, n: row.update(contact_sliding=[2e-4 * n] * 2 + [0.0] * 2))


def slides_in_turn(rows: Any, feet: int = 3, apart: int = 20) -> None:
    def change(row: Any, n: int) -> None:
        row.update(contact_sliding=[3e-4 * min(max(n - apart * foot, 0), 30) * (foot < feet) for foot in range(LEGS)])

    after(rows, "sim/truth", change)


def pushed(rows: Any) -> None:
    after(rows, "sim/truth", lambda row, n: row.update(velocity=[0.05, min(0.1 * n, 2.0), 0.0]))
    slides(rows)
