"""Errors that come from another process are those that were raised there."""

import pickle

import pytest

from surefoot.errors import FieldError, InvalidField, Refusal, SurefootError
from surefoot.services.footholds.learning.fit import LearnError

RAISED = [
    SurefootError("absent", "got nothing", "map"), FieldError("range", "mu", "got -1"), InvalidField("mu", "got 'x'"),
    Refusal("stale", "0.3 s old"), LearnError("few", "got 3 outcomes"),
]  # fmt: skip


@pytest.mark.parametrize("error", RAISED, ids=[type(error).__name__ for error in RAISED])
def test_an_error_of_a_pool_arrives_as_it_was_raised(error: SurefootError) -> None:
    """Before, one with a code and a message broke the pool, which reported a process that had ended abruptly."""
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert vars(found) == vars(error)
