"""Runs on disks that are full or read-only, on seeds that the study does not use."""

import pytest

from benchmarks import storage


def test_the_kinds_take_turns_and_a_seed_draws_the_same_case() -> None:
    assert [storage.drawn(seed).kind for seed in range(5)] == list(storage.KINDS)
    assert storage.drawn(7) == storage.drawn(7)
    assert storage.drawn(7) != storage.drawn(12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1000, 1001])
def test_a_failing_disk_changes_no_run_and_is_reported(seed: int) -> None:
    case = storage.drawn(seed)
    try:
        storage.try_case(case, *storage.reference())
    except OSError as error:
        pytest.skip(f"{case.kind}: {error}")
    assert not case.problems
    assert case.sentences
