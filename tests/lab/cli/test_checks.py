"""The doctor finds nothing wrong where the tests run, and names what is wrong where something is."""

import socket

import pytest

from surefoot.lab.cli import checks


def test_this_machine_is_fit(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    findings = checks.examine()
    assert len(findings) == len(checks.CHECKS)
    assert [finding for finding in findings if finding.grade == "FAIL"] == []


def test_a_check_that_breaks_is_a_finding(monkeypatch):
    def _broken_thing():
        raise OSError("no such device")

    monkeypatch.setattr(checks, "CHECKS", (_broken_thing,))
    (finding,) = checks.examine()
    assert (finding.grade, finding.what) == ("FAIL", "broken thing")
    assert "no such device" in finding.found


def test_a_taken_port_is_a_warning(monkeypatch):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        monkeypatch.setenv("SUREFOOT_LISTEN", f"tcp/127.0.0.1:{other.getsockname()[1]}")
        monkeypatch.setattr(checks, "CHECKS", (checks._port,))
        (finding,) = checks.examine()
    assert finding.grade == "WARN"
    assert "process" in finding.found


@pytest.mark.parametrize("name", ["SUREFOOT_LISTEN", "SUREFOOT_CONNECT"])
def test_a_variable_that_holds_no_endpoint_is_told(monkeypatch, name):
    monkeypatch.setenv(name, "7447")
    monkeypatch.setattr(checks, "CHECKS", (checks._port,))
    (finding,) = checks.examine()
    assert finding.grade == "FAIL"
    assert f"{name}: got '7447', expected tcp/" in finding.found
    assert name in finding.remedy
