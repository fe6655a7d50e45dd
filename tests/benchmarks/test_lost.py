"""The study of lost robots runs the navigator itself: robots notice, recover rightly, raise no false alarm."""

from benchmarks.lost import put_down, undisturbed, with_map
from benchmarks.lost_robot import World

EASY = World()


def test_robots_that_were_put_down_elsewhere_notice_and_recover_rightly() -> None:
    lines = [
        put_down(seed, distance, turn, walking, EASY)
        for seed, (distance, turn, walking) in enumerate([(0.35, 20.0, True), (0.7, 90.0, False), (3.0, 180.0, True)])
    ]
    assert not any(line["early"] or line["wrong"] for line in lines)
    assert all(line["noticed"] is not None and line["noticed"] <= 3.0 for line in lines)
    assert all(line["recovered"] is not None for line in lines)
    assert put_down(0, 0.35, 20.0, True, EASY) == lines[0]


def test_maps_that_do_not_fit_are_noticed_within_a_third_of_a_metre() -> None:
    for kind in ("mirrored", "shuffled", "stretched"):
        line = with_map(1000, kind, EASY)
        assert line["noticed"] is not None
        assert line["walked"] <= 0.35


def test_an_undisturbed_robot_raises_no_alarm() -> None:
    assert undisturbed(1, 1.0, EASY)["alarms"] == 0
