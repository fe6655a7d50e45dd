"""The service that learns again while it answers: outcomes in, a new model at a choice that is fixed beforehand."""

from pathlib import Path

import numpy as np
import pytest

from surefoot.lockstep.local import LocalSystem
from surefoot.schemas.footholds import ModelRequest, SelectReply, StanceOutcome
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.learning.relearner import LAG
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.files import encode, load, save
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.grounds import STROKE, neutral
from tests.services.footholds.learning.made import samples
from tests.services.footholds.test_footholds_service import asked, give, message
from tests.services.footholds.test_select import rough


def made(path: Path) -> Path:
    model = learn(gather(samples(300)), LearnOptions(title="made", candidates=(Candidate(8, 0.1, 1e-6),)))
    return save(model, path / "made.json")


def mapped(model: Path | str, **config: object) -> Footholds:
    """A service with a slip model and a map."""
    one = Footholds(FootholdsConfig(slip_model=str(model), **config))
    LocalSystem([one])
    give(one, message(rough(3)))
    return one


def service(model: Path, **config: object) -> Footholds:
    return mapped(model, relearn="counted", relearn_every=6, **config)


def outcome(k: int, slip: float = 0.004, **changes: object) -> StanceOutcome:
    x, y = neutral(0)[0] + 0.01 * (k % 5 - 2), neutral(0)[1] + 0.01 * (k // 5 % 5 - 2)
    told = {"leg": "lf", "foothold": (x, y), "nominal": tuple(neutral(0)[:2]), "stroke": STROKE, "slip": slip}
    return StanceOutcome(**(told | changes))


def walk(one: Footholds, steps: int, first: int = 0, **changes: object) -> list[SelectReply]:
    return [
        one.select(asked("lf", "rm", tick=50 * k, outcomes=(outcome(2 * k), outcome(2 * k + 1, 0.002)), **changes))
        for k in range(first, first + steps)
    ]


def test_the_model_changes_at_the_choice_that_is_due_and_the_reply_names_it(tmp_path: Path) -> None:
    runs = [walk(service(made(tmp_path)), 12) for _ in range(2)]
    names = [reply.model for reply in runs[0]]
    assert names[:6] == ["made/300"] * 6  # six outcomes are there at the third choice, LAG choices later it is learned
    assert names.index("made/306+1") == 2 + LAG
    first = runs[0][2 + LAG]
    assert first.model_tick == 50 * (2 + LAG)
    assert [reply.model_tick for reply in runs[0][:6]] == [0] * 6
    assert runs[0] == runs[1]
    changed = [reply.legs[0].slip for reply in runs[0]]
    assert changed[0] != changed[-1]


def test_without_re_learning_outcomes_change_nothing(tmp_path: Path) -> None:
    one = mapped(made(tmp_path))
    replies = walk(one, 12)
    assert {reply.model for reply in replies} == {"made/300"}
    assert one.use_model(ModelRequest()).outcomes == 0


def test_what_was_learned_survives_a_restart_with_its_provenance(tmp_path: Path) -> None:
    path = made(tmp_path)
    kept = tmp_path / "kept.json"
    one = service(path, relearn_file=str(kept))
    walk(one, 24)
    told = one.use_model(ModelRequest())
    one.on_stop()
    model = load(kept)
    assert encode(model) == kept.read_bytes()
    again = service(path, relearn_file=str(kept))
    assert again.use_model(ModelRequest()).model == model.name
    assert int(model.name.rpartition("+")[2]) >= int(told.model.rpartition("+")[2]) >= 2
    lines = [line for line in model.provenance if "own slip of ragno" in line]
    assert len(lines) == 1
    learned = sum(each.count for each in model.bins.values()) - 300
    assert lines[0].endswith(f"samples {learned:g}")
    assert told.outcomes == 48


@pytest.mark.parametrize("bad", ["", "{", "other robot"])
def test_a_kept_file_that_is_none_is_counted_and_the_configured_model_answers(tmp_path: Path, bad: str) -> None:
    path, kept = made(tmp_path), tmp_path / "kept.json"
    kept.write_text(path.read_text().replace('"robot": "ragno"', '"robot": "messor"') if bad == "other robot" else bad)
    one = service(path, relearn_file=str(kept))
    told = one.use_model(ModelRequest())
    assert (told.model, told.refused) == ("made/300", {"kept_file": 1})


def test_bad_outcomes_are_counted_and_the_others_learned(tmp_path: Path) -> None:
    one = service(made(tmp_path))
    bad = (
        outcome(0, -0.1), outcome(1, 1e9), outcome(2, stroke=(0.0, 0.0, 0.0)), outcome(3, leg="none"),
        outcome(4, foothold=(1e12, 0.0)), outcome(5, foothold=(50.0, 0.0)),
    )  # fmt: skip
    assert one.select(asked("lf", outcomes=bad)).legs[0].status == "ok"
    told = one.use_model(ModelRequest())
    assert told.refused == dict.fromkeys(
        ("negative", "huge", "no_stroke", "unknown_leg", "off_the_map", "not_finite"), 1
    )
    assert told.outcomes == 0
    assert walk(one, 8)[-1].model == "made/306+1"


def test_a_folder_that_cannot_be_written_is_counted_and_the_model_still_used(tmp_path: Path) -> None:
    one = service(made(tmp_path), relearn_file=str(tmp_path / "absent" / "kept.json"))
    assert walk(one, 8)[-1].model == "made/306+1"
    assert one.use_model(ModelRequest()).refused == {"unwritable": 1}


def test_a_reset_ends_the_round_and_its_model_is_in_force(tmp_path: Path) -> None:
    one = service(made(tmp_path))
    walk(one, 4)
    one.on_reset()
    give(one, message(rough(3)))
    assert one.select(asked("lf")).model == "made/306+1"


def test_a_hand_made_score_is_not_learned_again() -> None:
    one = mapped("hand-made", relearn="paper", relearn_every=2)
    assert {reply.model for reply in walk(one, 10)} == {"hand-made/1"}


def test_a_set_share_of_choices_explores_and_never_what_cannot_be_stepped_on(tmp_path: Path) -> None:
    one = service(made(tmp_path), explore=0.3, explore_seed=5, relearn_weight=0.0)
    replies = [one.select(asked("lf", "rm", tick=k)) for k in range(300)]
    share = np.mean([reply.explored for reply in replies])
    assert share == pytest.approx(0.3, abs=0.08)
    again = service(made(tmp_path), explore=0.3, explore_seed=5)
    assert [one.select(asked("lf", "rm", tick=k)) for k in range(20)] == [
        again.select(asked("lf", "rm", tick=k)) for k in range(20)
    ]
    explored = [leg for reply in replies if reply.explored for leg in reply.legs]
    assert {leg.status for leg in explored} <= {"ok", "raise_trunk"}
    assert len({leg.foothold for leg in explored}) > 20


def test_stances_of_a_leg_with_a_faulty_sensor_are_left_out_and_counted(tmp_path: Path) -> None:
    """Six sound outcomes between others of 18 mm make the model that the six alone make."""
    models = []
    for faulty in (False, True):
        one = service(made(tmp_path))
        for k in range(6 + LAG):
            found = (outcome(k),) if k < 6 else ()
            bad = (outcome(10 + k, 0.018, healthy=False),) if faulty and k < 6 else ()
            one.select(asked("lf", tick=50 * k, outcomes=(*bad, *found)))
        answer = one.use_model(ModelRequest())
        assert answer.outcomes == 6
        assert answer.refused == ({"unhealthy": 6} if faulty else {})
        assert answer.model == "made/306+1"
        models.append(one.select(asked("lf", tick=999)))
    assert models[0] == models[1]
