"""A slip model learned from a robot's own walks, beside the hexapod's model and the hand-made score."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from benchmarks.own_slip import explored
from surefoot.lab.footholds.rules import model_rule
from surefoot.lab.footholds.walks import Rule, Setting, walk
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.packages import PREFIX, source_file
from surefoot.lab.studies import Line
from surefoot.services.footholds.learning.fit import LearnOptions, learn
from surefoot.services.footholds.learning.samples import StanceSample, gather
from surefoot.services.footholds.models.files import load, save, shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

RULES = ("learned", "hexapod", "hand", "nominal")
"""Rules of footholds: `learned`: model from the robot's own walks; `hexapod`: shipped model of Ragno; `hand`: hand-made
score; `nominal`: no choice."""
HEXAPOD = "ragno"


@contextmanager
def placed(robot: str) -> Iterator[str]:
    """Yield a robot as a name or folder; a robot PACKAGE/ROBOT is imported into a folder first."""
    with tempfile.TemporaryDirectory() as folder:
        if "/" in robot:
            import_robot(source_file(PREFIX + robot), out := Path(folder) / "robot")
            robot = str(out)
        yield robot


def ground(robot: str) -> Setting:
    """Return the conditions of every walk of the study: 0.9 m of rough ground of 4 cm, friction 0.5, a noisy map."""
    return Setting("rough", 0.9, 0.04, 0.5, robot=robot, profile="noise")


def hexapod() -> LearnedModel:
    """Return the shipped model of the hexapod, learned with smaller feet."""
    path = shipped(HEXAPOD)
    assert path is not None
    return load(path)


def taught(robot: str, seed: int) -> Line:
    """Walk with random footholds; return the samples of the stances, with the slip that the robot measured."""
    with placed(robot) as place:
        own, _ = explored(seed, ground(place), hexapod(), 1.0)
    return {"samples": [asdict(sample) for sample in own]}


def learned(lines: list[Line], path: Path) -> int:
    """Learn a model from the lines of `taught`, write it to a file and return its number of samples."""
    samples = [
        StanceSample(**{**each, "stroke": tuple(each["stroke"]), "heights_um": tuple(each["heights_um"]),
                        "trial": f"{line['seed']}", "step": number})
        for line in lines for number, each in enumerate(line["samples"])
    ]  # fmt: skip
    found = gather(samples)
    save(learn(found, LearnOptions(title="own walks", distance_weight=0.5)), path)
    return len(found)


def chosen(robot: str, rule: str, seed: int, model: str) -> Line:
    """Walk under a rule; return how far feet slid by truth, mm a stance, and whether the robot arrived."""
    rules: dict[str, SlipModel] = {"hexapod": hexapod(), "hand": HandScore()}
    if rule == "learned":
        rules[rule] = load(model)
    select: Rule | None = model_rule(rules[rule], SelectParams()) if rule in rules else None
    with placed(robot) as place:
        done = walk(seed, ground(place), select)
    return {"sliding_mm": done.sliding_mm, "reached": done.reached, "fallen": done.fallen, "stances": done.stances}
