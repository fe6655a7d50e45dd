"""`surefoot goal`: what is sent to the navigator, and the exit code of a refusal."""

import json
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.schemas.navigation import NavigatorReply

pytestmark = pytest.mark.usefixtures("apart")


@pytest.mark.parametrize("what", ["pause", "resume", "cancel"])
@pytest.mark.parametrize("accepted", [True, False])
def test_a_goal_is_changed_or_the_reason_why_not_is_written(in_process, monkeypatch, what: str, accepted: bool) -> None:
    sent: list[tuple[str, dict[str, Any]]] = []

    def call(key: str, **fields: Any) -> NavigatorReply:
        sent.append((key, fields))
        return NavigatorReply(accepted=accepted, reason="" if accepted else "no goal is there")

    monkeypatch.setattr("surefoot.lab.cli.goal.client", lambda *_: nullcontext(SimpleNamespace(call=call)))
    code, out, _ = in_process("goal", what, "--goal-id", "far")
    assert sent == [(f"navigator/{what}", {"goal_id": "far"})]
    assert (code, "no goal is there" in out) == (int(not accepted), not accepted)
    code, out, _ = in_process("goal", what, "--at-tick", "70", "--json")
    assert sent[1] == (f"navigator/{what}", {"at_tick": 70})
    assert (code, json.loads(out)["accepted"]) == (int(not accepted), accepted)
