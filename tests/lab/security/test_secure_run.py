"""A run of processes with certificates: the run without, whatever the holders of other certificates send."""

import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import zenoh

from surefoot.bus.codec import encode
from surefoot.bus.endpoint import secured, settings_file
from surefoot.bus.frame import FramePart, pack
from surefoot.bus.interface import Stamp
from surefoot.bus.options import HANDSHAKE_MS, ZenohOptions, zenoh_config
from surefoot.errors import CallError, ConfigError
from surefoot.lab.cli import checks
from surefoot.lab.security.made import Membership, make, renew
from surefoot.schemas.hw import Imu, JointCommand
from surefoot.schemas.system import HealthRequest, JoinRequest
from surefoot.schemas.topics import CMD_JOINTS, HEALTH_GET, HW_IMU, SIM_JOIN, TICK_NS
from tests.ports import free_address
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.test_lockstep import run
from tests.surefoot.lockstep.test_zenoh_run import Threads
from tests.surefoot.net import Net, wait_until
from tests.surefoot.toys import toys

NAMESPACE = "test/secure"
TICKS = 300


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SUREFOOT_SECURITY", str(tmp_path))
    services = [type(service) for service in toys()[1]]
    return make(services, NAMESPACE, Membership(("operator",), ("guest",), (), 20))


@pytest.fixture
def secure(folder: Path) -> Iterator[Net]:
    made = Net(NAMESPACE, secured(free_address()))
    yield made
    made.close()


@pytest.mark.e2e
def test_forgeries_with_certificates_of_people_reach_nobody(secure: Net) -> None:
    """They know the instance of every process, and forge what is due next."""
    with Threads(secure, (0, 1, 2, 3), ticks=TICKS) as system:
        driver = system.driver.node
        wait_until(lambda: driver.leader.tick > 5)
        bound = {name: member.instance for name, member in driver.leader.members.items()}
        people = [secure.open("client", identity=name) for name in ("guest", "operator")]
        nodes = (driver, system.observer.runtime)
        before = [Counter({k: n for k, n in node.refused.items() if k != "resent_ticks"}) for node in nodes]
        tick = driver.leader.tick
        while tick < TICKS - 20:
            tick = driver.leader.tick
            for bus in people:
                header = (tick * TICK_NS, tick, 1, tick, "x")
                command = JointCommand(position=(40.0,)).stamped(*header)
                imu = Imu(acc=(9.0, 0.0, 0.0), gyro=(0.0, 0.0, 0.0)).stamped(*header)
                for key, instance, topic, message in (
                    ("@frame/walker", bound["walker"], CMD_JOINTS, command),
                    ("@frame/driver", driver.instance, HW_IMU, imu),
                ):
                    part = FramePart(topic.key, encode(message)[0], Stamp(tick, 1, tick * TICK_NS, tick))
                    payload, index = pack([part], instance)
                    bus.session.put(key, payload, attachment=index)
        assert system.wait() == run(ticks=TICKS)[0]
        for node in nodes:
            node.refused.pop("resent_ticks", None)  # a busy machine, no refusal
        assert [node.refused for node in nodes] == before


@pytest.mark.e2e
def test_people_ask_what_their_role_may_ask(secure: Net) -> None:
    with Threads(secure, (0, 1, 2, 3), ticks=20) as system:
        system.wait()
        for name in ("guest", "operator"):
            bus = secure.open("client", identity=name)
            assert bus.call(HEALTH_GET.of("estimator"), HealthRequest()).health.state == "running"
            if name == "operator":
                assert not bus.call(SIM_JOIN, JoinRequest(service="viewer", instance="x")).accepted
            else:
                with pytest.raises(CallError):
                    bus.call(SIM_JOIN, JoinRequest(service="viewer", instance="x"), 0.5)


def test_a_service_asks_the_router_by_its_own_certificate_who_lives(secure: Net) -> None:
    """A link that was lost differs from a process that has ended in that."""
    buses = {name: secure.open(identity=name) for name in ("walker", "estimator")}
    for name, bus in buses.items():
        bus.announce(name, bus.new_instance())
    names = {bus.new_instance() for bus in buses.values()}

    def answered() -> bool:
        with suppress(zenoh.ZError):  # the router took longer than a second
            return buses["walker"]._alive() == names
        return False

    wait_until(answered)


def test_silent_connections_keep_no_client_out(secure: Net) -> None:
    """A hundred of them, which Zenoh's own limit of 10 s would close one by one with a pause after each."""
    host, _, port = secure.address.partition("/")[2].rpartition(":")
    options = ZenohOptions("router", (), (secure.address,), NAMESPACE, "supervisor")
    assert f"tls_handshake_timeout_ms={HANDSHAKE_MS}" in zenoh_config(options).get_json("listen/endpoints")
    with ExitStack() as silent:
        for _ in range(100):
            silent.enter_context(socket.create_connection((host, int(port)), 5.0))
        assert secure.open("client", identity="operator").new_instance()


def test_without_a_certificate_the_remedy_is_named(folder: Path) -> None:
    with expect_error(ConfigError, "not_found", text="surefoot security init"):
        settings_file(NAMESPACE, "stranger")


def test_keys_are_their_owners_alone(folder: Path) -> None:
    assert folder.stat().st_mode & 0o077 == 0
    assert all(path.stat().st_mode & 0o077 == 0 for path in folder.glob("*.key"))


def test_certificates_that_end_soon_are_named_until_they_are_renewed(folder: Path) -> None:
    found = checks._certificates()
    assert (found.grade, "walker" in found.found) == ("WARN", True)
    settings = settings_file(NAMESPACE, "walker").read_text()
    renew(folder, ["walker"], 200)
    found = checks._certificates()
    assert (found.grade, "walker" in found.found) == ("WARN", False)
    renew(folder, [], 200)
    assert checks._certificates().grade == "PASS"
    assert settings_file(NAMESPACE, "walker").read_text() == settings


def test_an_endpoint_beyond_loopback_without_certificates_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/0.0.0.0:7447")
    assert checks._exposure().grade == "WARN"
    monkeypatch.setenv("SUREFOOT_LISTEN", "tls/0.0.0.0:7447")
    assert checks._exposure().grade == "PASS"
