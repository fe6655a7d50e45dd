"""Files on full disks, and files that are none: nothing half written is left, nothing is waited for."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.files import FileError, read_text
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_exchange import load_any
from surefoot.geometry.heightmap_files import load, load_asc, save
from surefoot.lockstep.config import ServiceConfig, load_config
from surefoot.record.recording import read_recording, recording_info, verify_recording
from surefoot.record.tables import read_table
from surefoot.services.footholds.models.files import load as load_model
from surefoot.services.navigator.belief.landmark_files import load as load_landmarks
from surefoot.services.navigator.memory import GoalMemory
from surefoot.services.navigator.planning.map_files import load as load_floor
from surefoot.services.navigator.policy.params import load as load_navigation
from tests.processes import full_disk

MAP = HeightMap(z=np.zeros((40, 40), np.float32), cell=0.02, origin=(0.0, 0.0), version=1)


def test_a_file_is_whole_or_as_it_was_and_the_error_names_it(tmp_path: Path) -> None:
    target = tmp_path / "report.html"
    with whole(target) as part:
        part.write_text("before")
    with full_disk(64), pytest.raises(OSError) as raised, whole(target) as part:  # noqa: PT011 - whichever it gives
        part.write_text("x" * 1000)
    assert raised.value.filename == str(target)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert target.read_text() == "before"


def test_a_map_on_a_full_disk_leaves_neither_of_its_files(tmp_path: Path) -> None:
    with full_disk(64), pytest.raises(OSError):  # noqa: PT011
        save(MAP, tmp_path / "map.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "read", "error"),
    [
        ("system.yaml", lambda path: read_text(path, FileError), FileError),
        ("service.toml", lambda path: load_config(ServiceConfig, "walker", path, {}, []), SurefootError),
        ("run.mcap", lambda path: list(read_recording(path)), SurefootError),
        ("run.mcap", recording_info, SurefootError),
        ("run.mcap", verify_recording, SurefootError),
        ("log.csv", read_table, SurefootError),
        ("log.npz", read_table, SurefootError),
        ("map.npz", load, HeightMapError),
        ("map.asc", load_asc, HeightMapError),
        ("map.png", load_any, HeightMapError),
        ("model.json", load_model, SurefootError),
        ("landmarks.npz", load_landmarks, Exception),
        ("floor.yaml", load_floor, SurefootError),
        ("params.toml", lambda path: load_navigation(str(path)), SurefootError),
    ],
)
def test_a_pipe_is_refused_and_not_waited_for(
    tmp_path: Path, name: str, read: Callable[[Path], Any], error: type[Exception]
) -> None:
    pipe = tmp_path / name
    os.mkfifo(pipe)
    with pytest.raises(error, match="regular file"):
        read(pipe)


def test_a_goal_of_an_earlier_run_that_cannot_be_removed_costs_the_memory_only(tmp_path: Path) -> None:
    (tmp_path / "goal.json").mkdir()  # as on a disk that is read-only, for root too
    memory = GoalMemory(str(tmp_path / "goal.json"))
    memory.forget()
    assert "cannot be kept" in memory.problem
    assert memory.path is None
