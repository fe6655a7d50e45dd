"""The service with learned models: which is in force, what a learning job does, and that the old one stays."""

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.errors import Refusal
from surefoot.schemas.footholds import LearnReply, LearnRequest, ModelRequest, SelectRequest
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, Report, learn, learn_and_compare
from surefoot.services.footholds.learning.samples import gather, trial_lines
from surefoot.services.footholds.models.files import ModelError, encode, load, save, shipped
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.grounds import flat
from tests.services.footholds.learning.made import samples
from tests.services.footholds.test_footholds_service import asked, give, message
from tests.services.refusals import refused

CONFIG = FootholdsConfig()


def changed(path: Path, changes: dict[str, object]) -> Path:
    """Write the shipped model of ragno with other values."""
    path.write_text(json.dumps(json.loads(shipped("ragno").read_text()) | changes))
    return path


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[threading.Event, threading.Event]]:
    """Learning jobs that wait: events of a job that has begun and of its release."""
    from surefoot.services.footholds.learning import job

    entered, released = threading.Event(), threading.Event()

    def slow(found: object, options: LearnOptions, report: Report) -> object:
        entered.set()
        assert released.wait(20.0)
        return learn_and_compare(gather(samples(300)), options, report)

    monkeypatch.setattr(job, "learn_and_compare", slow)
    yield entered, released
    released.set()


def written(path: Path, count: int = 400, trials: int = 6) -> Path:
    lines: list[str] = []
    for name in sorted({each.trial for each in samples(count, trials=trials)}):
        lines += trial_lines(name, [each for each in samples(count, trials=trials) if each.trial == name])
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_shipped_model_answers_and_is_named(mapped: Footholds) -> None:
    reply = mapped.select(asked("lf", "rh"))
    assert reply.model.startswith("ragno/")
    assert reply.legs[0].status == "ok"
    assert 0.0 <= (reply.legs[0].slip or 0.0) < 0.1
    told = mapped.use_model(ModelRequest())
    assert (told.model, told.robot) == (reply.model, "ragno")
    assert told.samples > 1000
    assert told.provenance


def test_every_shipped_model_is_of_the_robot_as_it_is() -> None:
    path = shipped("ragno")
    assert path is not None
    model = load(path)
    assert encode(model) == path.read_bytes()
    assert model.unfit(0.005, True, 0.008) == ""
    assert model.table_error() < 0.01
    assert shipped("messor") is None
    assert shipped("../ragno") is None


def test_a_model_takes_the_place_of_another_and_a_bad_one_does_not(mapped: Footholds, tmp_path: Path) -> None:
    mine = save(learn(gather(samples(300)), LearnOptions(candidates=(Candidate(8, 0.1, 1e-6),))), tmp_path / "m.json")
    assert mapped.use_model(ModelRequest(use=str(mine))).model == "learned/300"
    for bad in (str(tmp_path / "none.json"), str(tmp_path)):
        with pytest.raises(ModelError):
            mapped.use_model(ModelRequest(use=bad))
        assert mapped.select(asked("lf")).model == "learned/300"
    assert mapped.use_model(ModelRequest(use="hand-made")).model == HandScore().name
    assert mapped.use_model(ModelRequest(use="shipped")).model.startswith("ragno/")


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"robot": "messor"}, "other_robot"),
        ({"schema": "surefoot.slip/3"}, "schema"),
        ({"cell": "wide"}, "invalid"),
        ({"ranges": [[0.0, 1.0], [float("nan"), 1.0], [0.0, 1.0]]}, "invalid"),
        ({"distance_weight": -0.5}, "invalid"),
    ],
)
def test_a_refused_model_is_counted_and_the_old_one_stays(
    mapped: Footholds, tmp_path: Path, changes: dict[str, object], code: str
) -> None:
    bad = changed(tmp_path / "bad.json", changes)
    for count in (1, 2):
        with refused(ModelError, code):
            mapped.use_model(ModelRequest(use=str(bad)))
        told = mapped.use_model(ModelRequest())
        assert told.refused == {f"model_{code}": count}
        assert mapped.select(asked("lf")).model == told.model
        assert told.model.startswith("ragno/")


@pytest.mark.parametrize(
    ("condition", "word"), [({"cell": 0.01}, "cells"), ({"smooth": False}, "filter"), ({"foot_radius": 0.012}, "feet")]
)
def test_a_model_of_another_cell_filter_or_foot_is_not_used(
    mapped: Footholds, tmp_path: Path, condition: dict[str, object], word: str
) -> None:
    other = changed(tmp_path / "other.json", condition)
    told = mapped.use_model(ModelRequest(use=str(other)))
    assert word in told.unfit
    assert told.model == HandScore().name
    assert mapped.select(asked("lf")).legs[0].status == "ok"


def test_a_job_of_a_past_epoch_writes_its_file_and_changes_nothing(
    mapped: Footholds, tmp_path: Path, held: tuple[threading.Event, threading.Event]
) -> None:
    service, (entered, released) = mapped, held
    file, out = written(tmp_path / "samples.jsonl"), tmp_path / "learned.json"
    before = service.select(asked("lf")).model
    request = LearnRequest(action="start", samples=str(file), out=str(out), use=True)
    service.models.job.answer(request)
    assert entered.wait(20.0)
    service.on_reset()
    give(service, message(flat()))
    released.set()
    service.models.job.wait()
    done = service.models.job.answer(LearnRequest())
    assert done.state == "done", done
    assert out.exists()
    assert service.select(asked("lf")).model == before
    assert finished(service, request).state == "done"  # a job of this epoch is put in force
    assert service.select(asked("lf")).model == "learned/300"


def test_a_map_of_another_cell_is_answered_by_the_hand_made_score(mapped: Footholds) -> None:
    other = message(flat(), version=4).model_copy(update={"cell": 0.01})
    give(mapped, other)
    reply = mapped.select(asked("lf"))
    assert reply.model == HandScore().name
    assert "10 mm" in mapped.use_model(ModelRequest()).unfit
    give(mapped, message(flat(), version=5))
    assert mapped.select(asked("lf")).model.startswith("ragno/")


def test_random_footholds_need_a_seed_and_repeat_with_it(mapped: Footholds) -> None:
    with refused(Refusal, field="seed"):
        mapped.select(asked("lf", mode="random"))
    a, b, c = (mapped.select(asked("lf", "lm", mode="random", seed=seed)) for seed in (3, 3, 4))
    assert a.legs == b.legs
    assert a.legs != c.legs
    assert isinstance(asked("lf", mode="random", seed=3), SelectRequest)


def finished(service: Footholds, request: LearnRequest) -> LearnReply:
    service.models.job.answer(request)
    service.models.job.wait()
    return service.models.job.answer(LearnRequest())


def test_a_job_learns_writes_and_puts_in_force(mapped: Footholds, tmp_path: Path) -> None:
    file, out = written(tmp_path / "samples.jsonl"), tmp_path / "learned.json"
    assert mapped.models.job.answer(LearnRequest()).state == "idle"
    done = finished(mapped, LearnRequest(action="start", samples=str(file), out=str(out), title="mine", use=True))
    assert (done.state, done.model, done.samples) == ("done", "mine/400", 400)
    assert done.error is not None
    assert mapped.select(asked("lf")).model == "mine/400"
    again = finished(
        mapped, LearnRequest(action="start", samples=str(file), out=str(tmp_path / "b.json"), title="mine")
    )
    assert again.job == 2
    assert out.read_bytes() == (tmp_path / "b.json").read_bytes()


@pytest.mark.parametrize(
    ("count", "trials", "code"), [(0, 6, "no_samples"), (50, 2, "too_few_trials"), (-1, 6, "unreadable")]
)
def test_a_job_that_fails_leaves_the_model(
    mapped: Footholds, tmp_path: Path, count: int, trials: int, code: str
) -> None:
    before = mapped.select(asked("lf")).model
    file = tmp_path / "none.jsonl" if count < 0 else written(tmp_path / "samples.jsonl", count, trials)
    done = finished(mapped, LearnRequest(action="start", samples=str(file), use=True))
    assert (done.state, done.code) == ("failed", code)
    assert mapped.select(asked("lf")).model == before


def test_start_while_learning_and_cancel(
    service: Footholds, tmp_path: Path, held: tuple[threading.Event, threading.Event]
) -> None:
    entered, released = held
    file = written(tmp_path / "samples.jsonl")
    with refused(Refusal, "nothing_to_cancel"):
        service.models.job.answer(LearnRequest(action="cancel"))
    with pytest.raises(Refusal):
        service.models.job.answer(LearnRequest(action="start"))
    service.models.job.answer(LearnRequest(action="start", samples=str(file)))
    assert entered.wait(20.0)
    give(service, message(flat()))  # ticks and questions go on
    assert service.select(asked("lf")).legs[0].status == "ok"
    with refused(Refusal, "busy"):
        service.models.job.answer(LearnRequest(action="start", samples=str(file)))
    service.models.job.answer(LearnRequest(action="cancel"))
    released.set()
    service.models.job.wait()
    assert service.models.job.answer(LearnRequest()).state == "cancelled"
