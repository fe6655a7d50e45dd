"""Each service makes of recorded inputs what it made of them before, to a part in 10^9."""

import math
from typing import Any

import pytest

from tests.replay.cases import FOLDER, read, recorded, reference, replayed, write

RELATIVE, ABSOLUTE = 1e-9, 1e-12
MOST_BYTES = 1_000_000


def differences(was: Any, now: Any, where: str = "") -> list[str]:
    """Return the places where two values differ by more than the tolerance."""
    if isinstance(was, float) and isinstance(now, float | int):
        return [] if math.isclose(was, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE) else [f"{where}: {was} is now {now}"]
    if isinstance(was, dict) and isinstance(now, dict) and was.keys() == now.keys():
        return [text for key in was for text in differences(was[key], now[key], f"{where}.{key}")]
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        return [text for k in range(len(was)) for text in differences(was[k], now[k], f"{where}[{k}]")]
    return [] if was == now else [f"{where}: {str(was)[:200]} is now {str(now)[:200]}"]


@pytest.mark.parametrize(("case", "name"), list(recorded()))
def test_replay(case: str, name: str, request: pytest.FixtureRequest) -> None:
    found = replayed(case, name)
    if request.config.getoption("--update", default=False):
        write(reference(case, name), found)
    was = read(reference(case, name))
    assert len(was) > 2
    problems = differences(was, found)
    assert not problems, "\n".join(problems[:10])


def test_the_recordings_are_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < MOST_BYTES
