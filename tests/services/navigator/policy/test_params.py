"""The navigation model: what ships is valid, what contradicts itself is refused with the value and what is allowed."""

import pytest

from surefoot.errors import ConfigError
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.params import load, shipped
from tests.services.refusals import refused


@pytest.mark.parametrize("name", shipped())
def test_what_ships_is_valid_and_mirrored(name):
    model = load(name)
    for use in model.action_sets:
        world = arrays(load(name, [f"use={use!r}"]))
        for a, row in enumerate(world.tables.actions):
            other = world.tables.actions[int(row.mirror)]
            assert (other.turn, other.forward) == (-row.turn, row.forward)
            assert int(other.mirror) == a


def test_values_are_changed_one_by_one_and_the_hash_follows():
    plain, changed = load("paper"), load("paper", ["drift.per_10cm_deg=2", "actions.walk.match=0.1"])
    assert (changed.drift.per_10cm_deg, changed.actions["walk"].match) == (2.0, 0.1)
    assert changed.actions["walk"].forward == plain.actions["walk"].forward
    assert plain.sha256() != changed.sha256()
    assert plain.sha256() == load("paper", ["name=other"]).sha256()


def test_blur_reduces_moving_matches_only():
    sharp, blurred = arrays(load("paper")), arrays(load("paper-blur"))
    assert blurred.tables.actions["match"][:3] == pytest.approx(0.2 * sharp.tables.actions["match"][:3])
    assert blurred.tables.actions[3].match == sharp.tables.actions[3].match


@pytest.mark.parametrize(
    ("change", "needle"),
    [
        ("reward.gamma=0.95", "standing for ever is best"),
        ("reward.gamma=1.5", "1.5"),
        ("scene.goal_x=9", "not inside the walls"),
        ("actions.walk.forward=0", "needs > 0"),
        ("actions.stand.turn_deg=3", "allowed for a stand is 0"),
        ("actions.left.turn_deg=20", "mirrors"),
        ("action_sets.four=['walk','left','right','hop']", "hop"),
        ("use=nine", "nine"),
        ("sight.range_max=true", "True"),
        ("drift.per_10cm_deg=nan", "nan"),
        ("drift.speed=1", "drift.speed"),
        ("version=2", "2"),
        ("drift.per_10cm_deg", "key=value"),
        ("name.x=1", "has no fields"),
    ],
)
def test_bad_values_are_refused(change, needle):
    with pytest.raises(ConfigError) as caught:
        load("paper", [change])
    assert needle in str(caught.value)


def test_the_discount_is_refused_with_the_inequality_and_its_neighbour_is_not():
    """Break-even of the paper's numbers is near .964 (-0.7/(1 - g) against the discounted way to the goal)."""
    with pytest.raises(ConfigError, match=r"-14\.00 >= -22"):
        load("paper", ["reward.gamma=0.95"])
    assert load("paper", ["reward.gamma=0.97"]).reward.gamma == 0.97
    assert load("paper", ["reward.gamma=1"]).reward.gamma == 1.0


def test_files_that_cannot_be_read_are_refused(tmp_path):
    for content, code in (
        (b"version = ", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b'extends = "me.toml"', "invalid"),
    ):
        path = tmp_path / "me.toml"
        path.write_bytes(content)
        with refused(ConfigError, code):
            load(path)
    with refused(ConfigError, "not_found"):
        load(tmp_path / "absent.toml")
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        load("papr")


def test_a_file_extends_a_shipped_one(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('extends = "paper"\n[scene]\nlandmarks_per_m2 = 10\n')
    assert load(path).scene.landmarks_per_m2 == 10
    assert load(path).actions == load("paper").actions
