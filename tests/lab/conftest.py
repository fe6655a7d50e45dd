"""Fixtures of several tests: an invented run for verdict and report, the command line in and out of this process."""

import io
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from subprocess import CompletedProcess
from types import SimpleNamespace

import numpy as np
import pytest

from surefoot.lab.cli import main as cli
from surefoot.lab.cli.output import state
from surefoot.lab.report.traces import Traces
from surefoot.lab.runs.local import run_local
from tests.contract.short_walks import WALKS, short
from tests.ports import free_address
from tests.processes import end_systems, run_process

IDENTITY = (1.0, 0.0, 0.0, 0.0)


def message(tick, epoch=1, **fields):
    return SimpleNamespace(tick=tick, epoch=epoch, stamp_ns=tick * 10_000_000, **fields)


def truth(
    tick,
    x=0.0,
    *,
    epoch=1,
    tilt=0.0,
    fallen=False,
    stances=(0,) * 6,
    sliding=(0.0,) * 6,
    twist=(),
    vx=0.0,
    y=0.0,
    touching=False,
):
    return message(
        tick, epoch, position=(x, y, 0.08), quat_wxyz=IDENTITY, velocity=(vx, 0.0, 0.0), com=(x, y, 0.06), tilt=tilt,
        fallen=fallen, stances=stances, stance_sliding=sliding, stance_twist=twist, touching=touching,
        foot_position=tuple((x + 0.1, y + 0.02 * i, 0.008) for i in range(6)),
    )  # fmt: skip


def velocity(tick, vx=0.0, *, initialised=True):
    covariance = tuple(np.eye(6).ravel() * 1e-4)
    return message(tick, velocity=(vx, 0.0, 0.0), initialised=initialised, covariance=covariance, nis=3.0)


def odometry(tick, x=0.0, y=0.0, yaw=0.0, *, initialised=True):
    return message(tick, position=(x, y, 0.08), yaw=yaw, initialised=initialised, covariance=(1e-4,) * 16)


def gait(tick, *, state="walking", reason="", margin=0.02, remaining=0.5, walk_id=1):
    return message(
        tick, state=state, reason=reason, margin=margin, remaining=remaining, steps=tick // 50, stance=(True,) * 6,
        walk_id=walk_id,
    )  # fmt: skip


def ground(shape=(80, 200), cell=0.02):
    z = 0.03 * np.sin(np.arange(shape[1]) / 9.0) * np.ones((shape[0], 1))
    z[10:12, 30:33] = np.nan
    data = z.astype("<f4").tobytes()
    return SimpleNamespace(epoch=1, rows=shape[0], cols=shape[1], cell=cell, origin=(-0.8, -0.8), data=data)


def walk(ticks=600, speed=0.1):
    """Traces of a walk with every kind of message."""
    traces = Traces()
    traces.feed("terrain/map", ground())
    done = [0] * 6
    for tick in range(ticks):
        x = speed * tick * 0.01
        if tick and tick % 50 == 0:
            for foot in range(tick // 50 % 2, 6, 2):
                done[foot] += 1
        y, tilt = 0.004 * np.sin(tick / 30), 0.05 + 0.03 * np.sin(tick / 40)
        sliding = tuple(1e-4 * (1 + f + tick % 7) for f in range(6))
        seen = truth(tick, x, vx=speed, y=y, tilt=tilt, stances=tuple(done), sliding=sliding, twist=(0.01,) * 6)
        traces.feed("sim/truth", seen)
        noise = 0.01 * np.sin(tick / 5)
        for name in ("", "/imu", "/kinematics", "/kinematics_gyro", "/ekf"):
            traces.feed(f"state/velocity{name}", velocity(tick, speed + noise * (1 + len(name) / 4)))
        traces.feed("state/odometry", odometry(tick, 1.02 * x, 0.01 * x))
        traces.feed("state/gait", gait(tick, reason="step refused: margin too small" if tick == 300 else ""))
        if tick % 2 == 0:
            margin = 0.03 + 0.01 * np.sin(tick / 25)
            traces.feed("state/stability", stability(tick, margin, margin - 0.002))
        if tick % 10 == 0:
            traces.feed("state/pose", pose(tick, x + 0.01, np.cos(tick)))
            traces.feed("navigator/feedback", feedback(tick, x, done=tick >= ticks - 10))
    return traces


def pose(tick, x=0.0, wobble=0.0):
    """A believed pose, 1 cm along and 1 cm aside of the truth, with 1 cm of standard deviation."""
    return message(
        tick, pose=(x, 0.01 * wobble, 0.0), covariance=tuple(np.diag([1e-4, 1e-4, 1e-4]).ravel()),
        entropy=-9.0, drift=0.1, drift_sd=0.05, matched=3, lost=False, lost_probability=0.0, lost_reason="",
    )  # fmt: skip


def feedback(tick, x=0.0, *, done=False, error=""):
    """Progress of a goal at (x, 0), with a decision every second."""
    choice = SimpleNamespace(
        number=1 + tick // 100, action=("walk", "stand")[tick // 100 % 2], reason="because",
        values={"walk": -10.0, "stand": -11.0}, distance=1.0, bearing=0.1, entropy=-9.0,
    )  # fmt: skip
    state = ("failed" if error else "succeeded") if done else "navigating"
    return message(
        tick, state=state, goal_id="there", goal_pose=(x, 0.05), distance_remaining=1.0, decision=choice,
        error_code=error, navigation_time=0.01 * tick, number_of_recoveries=1,
    )  # fmt: skip


def stability(tick, planned, measured):
    return message(tick, margin_planned=planned, margin_measured=measured)


@pytest.fixture
def invented():
    """Makers of invented messages, and `walk`, a whole run of them."""
    makers = (truth, velocity, odometry, gait, ground, stability, walk, pose, feedback)
    return SimpleNamespace(**{make.__name__: make for make in makers})


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Recording of a hexapod that walks 0.1 m over rough terrain, 4.6 s."""
    path = tmp_path_factory.mktemp("walk") / "walk.mcap"
    run_local(short("rough-terrain", WALKS["rough-terrain"]), recording=path)
    return path


@pytest.fixture
def apart(monkeypatch, tmp_path):
    """Own run folders, no port of another system, no colours, a wide terminal."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("SUREFOOT_CONNECT", "tcp/127.0.0.1:9")
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:9")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(state, "json", False)
    monkeypatch.setattr(state, "debug", False)


@pytest.fixture
def in_process(capsys):
    """The command line in this process: exit code, standard output, standard error."""

    def run(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main([*map(str, words)])
        return ended.value.code or 0, *capsys.readouterr()

    return run


@pytest.fixture
def answer(in_process):
    """Standard output of a command that must succeed."""

    def run(*words):
        code, out, err = in_process(*words)
        assert code == 0, err
        return out

    return run


@pytest.fixture
def complaint(in_process):
    """Standard error of a command that must end with this exit code."""

    def run(*words, code=cli.EXIT_USAGE):
        found, _, err = in_process(*words)
        assert found == code
        return err

    return run


@pytest.fixture
def listen(monkeypatch, tmp_path):
    """An own state folder, and the endpoint of an own router."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("SUREFOOT_LISTEN", raising=False)
    return free_address()


@pytest.fixture(scope="session")
def command_line():
    """`surefoot`, run by this Python."""
    return [sys.executable, "-m", "surefoot.lab.cli.main"]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Own state folder and port; the kernels' stamps stay shared. What still runs at the end is ended."""
    folder = tmp_path_factory.mktemp("live")
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith("SUREFOOT_")},
        "XDG_STATE_HOME": str(folder / "state"),
        "SUREFOOT_LISTEN": free_address(),
        "PYTHONPATH": str(Path(__file__).parents[2]),
        "NO_COLOR": "1",
    }
    yield folder, environment
    end_systems(folder / "state" / "surefoot")


PROCESSES = ("up", "run", "down")
"""Commands that start or end processes; a test of the others saves the start of Python."""


@pytest.fixture(scope="module")
def surefoot(place, command_line):
    """The command line with the folder and environment of `place`: exit code, standard output and error."""
    folder, environment = place

    def run(*words):
        command = [*command_line, *map(str, words)]
        if words[0] in PROCESSES:
            done = run_process(command, cwd=folder, env=environment, capture_output=True, text=True)
        else:
            out, err = io.StringIO(), io.StringIO()
            with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
                patch.chdir(folder)
                for name in set(os.environ) - set(environment):
                    patch.delenv(name)
                for name, value in environment.items():
                    patch.setenv(name, value)
                patch.setattr(state, "json", False)
                with pytest.raises(SystemExit) as ended:
                    cli.main(command[len(command_line) :])
            done = CompletedProcess(command, ended.value.code or 0, out.getvalue(), err.getvalue())
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return run
