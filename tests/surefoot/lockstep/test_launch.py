"""Start of a service's process."""

import gc
import os
import socket

import pytest

from surefoot.errors import EXIT_USAGE
from surefoot.lockstep import launch
from surefoot.lockstep.service import Service


class Idle(Service):
    """Does nothing."""

    name = "idle"


def test_the_collector_is_on_again_when_a_service_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entry points switch it off for their imports."""
    seen: list[bool] = []

    def run(service: type[Service], arguments: list[str] | None) -> int:
        seen.append(gc.isenabled())
        return 0

    def leave(code: int) -> None:
        raise SystemExit(code)

    monkeypatch.setattr(launch, "run", run)
    monkeypatch.setattr(launch.ENDING, "watch", lambda: None)
    monkeypatch.setattr(os, "_exit", leave)
    gc.disable()
    try:
        with pytest.raises(SystemExit) as end:
            launch.main(Idle, [])
    finally:
        gc.enable()
        gc.unfreeze()
    assert (seen, end.value.code) == ([True], 0)


def test_the_exit_code_separates_a_wrong_configuration_from_a_network_that_may_come_back(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert launch.run(Idle, ["--set", "nonsense=1"]) == EXIT_USAGE
    assert "nonsense" in capsys.readouterr().err
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        assert launch.run(Idle, ["--listen", place, "--connect", "tcp/127.0.0.1:1"]) == 1
    assert place in capsys.readouterr().err
