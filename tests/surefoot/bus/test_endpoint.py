"""Where services and clients find the router, and certificates that are not there."""

import os
from pathlib import Path

import pytest

from surefoot.bus.endpoint import DEFAULT_ENDPOINT, settings_file, to_connect
from surefoot.bus.options import RUNTIME, ZenohOptions, reading_threads, threads_that_read, zenoh_config
from surefoot.errors import ConfigError
from tests.surefoot.expect import expect_error

CONNECT, LISTEN = "tcp/127.0.0.1:7001", "tcp/127.0.0.1:7002"


@pytest.mark.parametrize(
    ("connect", "listen", "found"),
    [("", "", DEFAULT_ENDPOINT), ("", LISTEN, LISTEN), (CONNECT, "", CONNECT), (CONNECT, LISTEN, CONNECT)],
)
def test_the_router_is_where_the_environment_names_it_first(
    connect: str, listen: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SUREFOOT_CONNECT", connect)
    monkeypatch.setenv("SUREFOOT_LISTEN", listen)
    assert to_connect() == found


def test_settings_of_an_identity_that_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUREFOOT_SECURITY", str(tmp_path))
    monkeypatch.delenv("SUREFOOT_IDENTITY", raising=False)
    with expect_error(ConfigError, "not_found", text="`surefoot security init`"):
        settings_file("surefoot/ragno", "walker")


@pytest.mark.parametrize(("value", "shared"), [("", False), ("0", False), ("1", True)])
def test_memory_is_shared_where_the_environment_asks_for_it(
    value: str, shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SUREFOOT_SHARED_MEMORY", value)
    assert zenoh_config(ZenohOptions()).get_json("transport/shared_memory/enabled") == str(shared).lower()


def test_a_word_for_shared_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUREFOOT_SHARED_MEMORY", "yes")
    with expect_error(ConfigError, "invalid", text="'yes', allowed: 1, 0"):
        zenoh_config(ZenohOptions())


def test_the_process_of_a_router_reads_with_many_threads_and_those_it_starts_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[str | None] = []
    for mode, before in (("router", None), ("peer", None), ("router", "(rx: (worker_threads: 5))")):
        monkeypatch.delenv(RUNTIME, raising=False)
        if before is not None:
            monkeypatch.setenv(RUNTIME, before)
        with reading_threads(ZenohOptions(mode)):
            found.append(os.environ.get(RUNTIME))
        assert os.environ.get(RUNTIME) == before
    assert found == ["(rx: (worker_threads: 32))", None, "(rx: (worker_threads: 5))"]


def test_one_reading_thread_is_for_the_session_that_is_opened_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RUNTIME, raising=False)
    with threads_that_read(1):
        assert os.environ[RUNTIME] == "(rx: (worker_threads: 1))"
    assert RUNTIME not in os.environ
