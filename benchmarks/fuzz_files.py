"""Every kind of file that is read, with good contents, and readers of damaged ones."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.fuzz_inputs import Drawer, Tally, attempt, spoil
from surefoot.bus.codec import encode, json_schema
from surefoot.bus.interface import Raw
from surefoot.schemas.topics import TOPICS


@dataclass(frozen=True)
class Format:
    """A kind of file to damage: suffix, good contents, and the function that reads it."""

    name: str
    suffix: str
    seeds: tuple[bytes, ...]
    """Valid contents of such files, which are damaged."""
    read: Callable[[Path], object]


@contextmanager
def beside(folder: Path) -> Iterator[Path]:
    """Yield a path in a folder, and empty the folder at the end of the context."""
    yield folder
    for path in folder.iterdir():
        path.unlink()


ASC = b"ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 0.1\nNODATA_value -9999\n1 2\n3 -9999\n"
CSV = b"t,gx,gy,gz,ax,ay,az\n0.0,0,0,0,0,0,9.81\n0.01,0,0,0,0,0,9.81\n"
YAML = b"image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.25\nnegate: 0\n"
ZONES = b"""zones:
  - {name: stairs, type: keepout, polygon: [[1.0, 0.2], [1.6, 0.2], [1.6, 1.0]]}
  - {name: ramp, type: speed_limit, speed_limit: 0.03, percentage: false, polygon: [[4, 0], [5, 0], [5, 1]]}
"""
IMAGE = b"P5\n2 2\n255\n\x00\xff\x80\x00"
MASKS = b"zones:\n  - {name: hall, type: speed_limit, mask: mask.yaml, base: 100.0, multiplier: -1.0}\n"
"""Good contents of a height map, a log, a floor map and lists of zones."""


def texts(pattern: str) -> tuple[bytes, ...]:
    """Return the contents of the project's files that fit a pattern."""
    return tuple(path.read_bytes() for path in sorted(Path(__file__).parents[1].glob(pattern)))


def record(path: Path) -> None:
    """Write a recording of twenty messages of four topics."""
    from surefoot.record.recording import RecordingWriter

    writer = RecordingWriter(path, {"robot": "ragno"})
    for number in range(20):
        topic = TOPICS[number % 4]
        value = Drawer(json_schema(topic.model), Random(1)).value() | {"stamp_ns": number, "seq": number}
        message = topic.model.model_validate_json(json.dumps(value))
        writer.write(topic, message, Raw(*encode(message), ""))
    writer.close({"run_hash": "x"})


def written(folder: Path, name: str, write: Callable[[Path], object]) -> bytes:
    """Return what a function writes to a file of an empty folder, which is empty again afterwards."""
    path = folder / name
    write(path)
    content = path.read_bytes()
    for each in folder.iterdir():
        each.unlink()
    return content


def load_map(path: Path) -> object:
    """Return the floor map of a file, beside which its image is written."""
    from surefoot.services.navigator.planning import map_files

    (path.parent / "m.pgm").write_bytes(IMAGE)
    return map_files.load(path)


def load_image(path: Path) -> object:
    """Return the floor map whose image a file is."""
    from surefoot.services.navigator.planning import map_files

    text = path.parent / "m.yaml"
    text.write_bytes(YAML)
    return map_files.load(text)


def load_zones(path: Path) -> object:
    """Return the zones of a file, beside which their mask is written."""
    from surefoot.services.navigator.planning import zone_files

    (path.parent / "mask.yaml").write_bytes(YAML)
    (path.parent / "m.pgm").write_bytes(IMAGE)
    return zone_files.load(path)


def formats(folder: Path) -> tuple[Format, ...]:
    """Return every kind of file that is read, with contents that are good."""
    from surefoot.files import read_regular
    from surefoot.geometry import heightmap_files
    from surefoot.geometry.heightmap import HeightMap
    from surefoot.lockstep.config import load_config
    from surefoot.record.recording import read_recording, verify_recording
    from surefoot.record.tables import read_table
    from surefoot.robot.reader import load_robot
    from surefoot.services.footholds.models import files as models_of_slip
    from surefoot.services.navigator.belief import landmark_files
    from surefoot.services.navigator.belief.landmarks import FloorLandmarks
    from surefoot.services.navigator.config import NavigatorConfig
    from surefoot.services.navigator.memory import GoalMemory
    from surefoot.services.navigator.policy.files import load_policy
    from surefoot.services.supervisor.processes.compose import load_compose
    from surefoot.services.supervisor.scenarios.scenario import load_scenario
    from surefoot.services.walker.memory import MemoryFile, WalkMemory

    def made(name: str, write: Callable[[Path], object]) -> bytes:
        return written(folder, name, write)

    ground = HeightMap(z=np.zeros((3, 4), np.float32), cell=0.1, origin=(0.0, 0.0), version=1)
    marks = FloorLandmarks(np.eye(3, 2), np.eye(3, 8), 1, "x")
    walk = made("w.json", lambda p: MemoryFile(str(p)).keep(1, 2, WalkMemory(1, None, None, None)))
    goal = b'{"epoch": 1, "tick": 2, "number": 1, "pose": [0, 0, 0], "covariance": [0,0,0,0,0,0,0,0,0], "odom": null, "goal": null, "state": "idle", "end": ["idle", "", ""], "ended": 0.0, "planned": []}'  # noqa: E501

    def load_navigator(path: Path) -> object:
        return load_config(NavigatorConfig, "navigator", path)

    return (
        Format("compose file", ".yaml", texts("compose/*.yaml"), load_compose),
        Format("scenario", ".toml", texts("scenarios/*.toml"), load_scenario),
        Format("robot", ".toml", texts("surefoot/robots/*/robot.toml"), load_robot),
        Format("configuration", ".toml", (b"[navigator]\nrobot = 'nao'\n",), load_navigator),
        Format("height map", ".npz", (made("h.npz", lambda p: heightmap_files.save(ground, p)),), heightmap_files.load),
        Format("height map", ".asc", (ASC,), heightmap_files.load),
        Format("floor map", ".yaml", (YAML,), load_map),
        Format("zones", ".yaml", (ZONES, MASKS), load_zones),
        Format("floor image", ".pgm", (IMAGE, b"P2\n2 2\n255\n0 255 128 0\n"), load_image),
        Format("landmarks", ".npz", (made("l.npz", lambda p: landmark_files.save(marks, p)),), landmark_files.load),
        Format("policy", ".npz", texts("services/navigator/policy/shipped/*.npz"), load_policy),
        Format("slip model", ".json", texts("services/footholds/models/shipped/*.json"), models_of_slip.load),
        Format("log", ".csv", (CSV,), read_table),
        Format("walk memory", ".json", (walk,), lambda p: MemoryFile(str(p)).recall(1, 9)),
        Format("goal memory", ".json", (goal,), lambda p: GoalMemory(str(p)).recall(1, 9)),
        Format("recording", ".mcap", (made("r.mcap", record),), lambda p: [*read_recording(p)]),
        Format("damaged recording", ".mcap", (made("r.mcap", record),), verify_recording),
        Format("bounded file", ".bin", (b"x" * 100,), lambda p: read_regular(p, 150)),
    )


def damaged_files(tally: Tally, kind: Format, count: int, folder: Path, seed: int) -> None:
    """Read files of a kind with damaged contents, the first one whole."""
    random = Random(f"{seed} {kind.name}")
    for number in range(count):
        data = random.choice(kind.seeds)
        for _ in range(min(number, random.choice((1, 1, 2, 8)))):
            data = spoil(data, random)
        with beside(folder):
            path = folder / f"m{kind.suffix}"
            path.write_bytes(data)
            attempt(tally, kind.name, data, lambda path=path: kind.read(path))
