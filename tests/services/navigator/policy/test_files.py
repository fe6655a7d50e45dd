"""Policy files: what is written is read, and nothing else is."""

import io
import os
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.services.navigator.policy import files
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.choose import SARSA, PolicyTables
from surefoot.services.navigator.policy.decider import Policy, hand
from surefoot.services.navigator.policy.files import MEMBERS, content_of, digest_of, load_policy, parse, save, shipped
from surefoot.services.navigator.policy.library import find, known
from surefoot.services.navigator.policy.params import load
from tests.services.refusals import refused

AXES = np.array([0.0, 6.0, -8.0, -2.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def policy():
    world = arrays(load("paper"))
    rng = np.random.default_rng(0)
    tables = PolicyTables(SARSA, np.zeros(8), rng.normal(size=(2, 3, 4, 4)), AXES, np.eye(3))
    return Policy("x", world.names, tables, {"seed": "1"})


def changed(policy, *, signed=True, **members):
    with np.load(io.BytesIO(content_of(policy))) as file:
        held = {m: file[m] for m in MEMBERS}
    held.update(members)
    if signed and all(held[m] is not None and held[m].dtype.kind != "O" for m in MEMBERS):
        held["digest"] = np.array(digest_of({m: np.asarray(held[m]) for m in MEMBERS}))
    buffer = io.BytesIO()
    np.savez(buffer, **{k: v for k, v in held.items() if v is not None})
    return buffer.getvalue()


def test_round_trip_and_equal_bytes(policy, tmp_path):
    digest = save(policy, tmp_path / "p.npz")
    again = load_policy(tmp_path / "p.npz", policy.actions)
    assert again.sha256 == digest
    assert (again.tables.kind, again.actions, dict(again.provenance)) == (3, policy.actions, {"seed": "1"})
    assert again.tables.table == pytest.approx(policy.tables.table, abs=1e-6)
    assert content_of(policy) == content_of(policy)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize(
    "members",
    [
        {"version": np.int64(1)},
        {"kind": np.str_("oracle")},
        {"table": np.full((2, 3, 4, 4), np.nan, dtype=np.float32)},
        {"table": np.zeros((2, 3, 4, 5), dtype=np.float32)},
        {"table": np.zeros((0, 3, 4, 4), dtype=np.float32)},
        {"table": np.zeros((2, 3, 4, 4), dtype=np.int64)},
        {"numbers": np.zeros(3)},
        {"numbers": np.full(8, np.inf)},
        {"grid": None},
        {"grid": np.zeros(6)},
        {"grid": AXES[[1, 0, 2, 3, 4, 5]]},
        {"grid": AXES[[0, 1, 3, 2, 4, 5]]},
        {"shown": np.diag([1.0, 1.0, 0.0])},
        {"shown": np.eye(3) + np.eye(3, k=1)},
        {"provenance": np.str_("[1]")},
        {"provenance": np.str_("{")},
        {"actions": np.array([b"walk", None], dtype=object)},
    ],
)
def test_wrong_members_are_refused(policy, members):
    with refused(Refusal, field="policy"):
        parse(changed(policy, **members), "p", "p.npz")


@pytest.mark.parametrize("member", MEMBERS)
def test_a_file_that_was_changed_after_it_was_written_is_refused(policy, member):
    with np.load(io.BytesIO(content_of(policy))) as file:
        array = file[member]
    other = array + 0.25 if array.dtype.kind == "f" else np.array("x") if array.dtype.kind == "U" else array + 1
    with pytest.raises(Refusal):
        parse(changed(policy, signed=False, **{member: other}), "p", "p.npz")
    if array.dtype.kind == "f":
        with pytest.raises(Refusal, match="not as it was written"):
            parse(changed(policy, signed=False, **{member: other}), "p", "p.npz")
        assert parse(changed(policy, **{member: other}), "p", "p.npz").tables.kind == policy.tables.kind


def test_what_is_wrong_is_named_once(policy):
    with pytest.raises(Refusal, match=r"^p\.npz: lacks grid; a policy file has "):
        parse(changed(policy, grid=None), "p", "p.npz")


def test_truncated_foreign_and_pickled_files_are_refused(policy, tmp_path):
    content = content_of(policy)
    made = []

    class Evil:
        def __reduce__(self):
            return made.append, (1,)

    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as z:
        z.writestr("table.npy", pickle.dumps(Evil()))
    damaged = [
        content[: len(content) // 2],
        content[:-30],
        b"PK\x03\x04",
        pickle.dumps(Evil()),
        archive.getvalue(),
        b"",
    ]
    for number, each in enumerate(damaged):
        path = tmp_path / f"{number}.npz"
        path.write_bytes(each)
        with pytest.raises(Refusal):
            load_policy(path)
    with pytest.raises(Refusal):
        load_policy(tmp_path / "absent.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(Refusal, match="no regular file"):
        load_policy(tmp_path / "pipe.npz")
    assert made == []


def test_other_actions_are_refused_with_both_lists(policy):
    with pytest.raises(Refusal, match="arc_left_11") as caught:
        parse(content_of(policy), "p", "p.npz", arrays(load("paper", ["use='arcs'"])).names)
    assert caught.value.code == "policy_actions"


def test_policies_that_ship_can_be_found_by_name_for_their_robot():
    for stem, path in shipped().items():
        found = load_policy(path)
        model = load(found.provenance["model"], [f"use={found.provenance['action_set']!r}"])
        assert find(stem, model).sha256 == found.sha256
        assert found.provenance["model_sha256"] == model.sha256(), f"{stem} is of other parameters: train it again"


def test_the_planner_of_a_shipped_robot_is_its_file_and_of_another_is_computed():
    assert find("planner", load("nao")).sha256
    assert not find("planner", load("paper")).sha256
    with pytest.raises(Refusal, match="did you mean 'planner'"):
        find("planer", load("paper"))
    assert {"hand", "tuned", "steer", "planner", "sarsa"} <= set(known())


def test_a_rule_can_be_kept_in_a_file(tmp_path):
    world = arrays(load("paper"))
    save(hand(world, turn_deg=20.0), tmp_path / "mine.npz")
    assert find(str(tmp_path / "mine.npz"), load("paper")).tables.numbers[2] == pytest.approx(np.radians(20.0))


def test_values_of_another_model_are_refused_or_computed_anew_in_words(tmp_path):
    other = load("nao-paper", ["actions.walk.match=0.05"])
    with pytest.raises(Refusal, match="was learned for the model 'nao-paper'") as caught:
        find("sarsa-nao-paper", other)
    assert caught.value.code == "policy_model"
    with pytest.raises(Refusal, match="surefoot train navigator"):
        find("sarsa", other)
    kept = find("planner-nao-four", load("nao", ["use='four'"]))
    save(kept, tmp_path / "mine.npz")
    anew = find(str(tmp_path / "mine.npz"), other)
    assert "made for the model 'nao'" in anew.provenance["instead_of"]
    assert anew.provenance["model_sha256"] == other.sha256()
    assert find("sarsa-nao-paper", other, any_model=True).sha256  # studies may
    save(replace(find("sarsa-nao-paper", load("nao-paper")), provenance={}), tmp_path / "of-none.npz")
    with pytest.raises(Refusal, match="no model_sha256"):
        find(str(tmp_path / "of-none.npz"), load("nao-paper"))
    conduct = load("nao-paper", ["conduct.stuck=60", "odometry.turn=0.1", "drift.course='flip'"])
    assert find("sarsa-nao-paper", conduct).sha256  # no value depends on these


def test_a_file_without_a_member_and_one_that_unpacks_to_too_much_are_refused_in_words(policy, monkeypatch):
    with np.load(io.BytesIO(content_of(policy))) as file:
        held = {name: file[name] for name in file.files if name != "grid"}
    part = io.BytesIO()
    np.savez(part, **held)
    with pytest.raises(Refusal, match="lacks grid; a policy file has"):
        parse(part.getvalue(), "p", "p.npz")
    monkeypatch.setattr(files, "MAX_BYTES", 100)
    with pytest.raises(Refusal, match="unpacks to"):
        parse(content_of(policy), "p", "p.npz")
