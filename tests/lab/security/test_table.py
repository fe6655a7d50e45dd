"""Every identity tries every verb on every key, against the rules made of the table, over real links."""

from pathlib import Path

import pytest
import zenoh

from surefoot.lab.security.grants import ROUTER, Role, grants
from surefoot.lab.security.made import Membership, classes, make
from surefoot.services.supervisor.processes.compose import load_compose
from tests.lab.security.sessions import Trial, allowed, open_session, settings_in
from tests.ports import free_address

NAMESPACE = "surefoot/ragno"
SYSTEM = load_compose("ragno-goal")
GRANTED = grants(classes(SYSTEM), {role.value: role for role in Role})
KEYS = tuple(sorted({grant.key for grant in GRANTED}))
IDENTITIES = tuple(sorted({grant.identity for grant in GRANTED}))
FEW = ("guest", "walker")
"""Identities that are tried in each run of the tests; the others are tried among the slow ones."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SUREFOOT_SECURITY", str(tmp_path_factory.mktemp("security")))
        return make(classes(SYSTEM), NAMESPACE, Membership(("operator",), ("guest", "mallory"), (), 30))


def tls() -> str:
    return free_address().replace("tcp/", "tls/")


def identities() -> list[object]:
    return [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in IDENTITIES]


@pytest.mark.e2e
@pytest.mark.parametrize("identity", identities())
@pytest.mark.parametrize(("mode", "keeper"), [("router", ROUTER), ("peer", "stability")])
def test_what_an_identity_does_is_what_the_table_grants(folder: Path, mode: str, keeper: str, identity: str) -> None:
    """At the router and at a peer; the identity shows its certificate and keeps no rules of its own."""
    address = tls()
    own = ("client", "") if mode == "router" else ("peer", "tls/127.0.0.1:0")
    with open_session(mode, settings_in(folder, keeper, rules=True), listen=address) as other:
        shown = settings_in(folder, identity, rules=False)
        with open_session(own[0], shown, connect=address, listen=own[1]) as one:
            may = allowed(GRANTED, identity, KEYS)
            did = Trial(one, other, NAMESPACE, KEYS).run(may)
    assert did - may == set()
    assert may - did == set()


@pytest.mark.e2e
def test_a_certificate_of_no_role_another_authority_and_none_at_all_do_nothing(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = tls()
    rules = settings_in(folder, ROUTER, rules=True)
    monkeypatch.setenv("SUREFOOT_SECURITY", str(tmp_path))
    foreign = make(classes(SYSTEM), NAMESPACE, Membership(("operator",), ("guest",), (), 30))
    plain = address.replace("tls/", "tcp/")
    known = [subject for subject in rules["access_control"]["subjects"] if subject["id"] != "mallory"]
    rules["access_control"]["subjects"] = known
    policies = rules["access_control"]["policies"]
    rules["access_control"]["policies"] = [one for one in policies if one["subjects"] != ["mallory"]]
    with open_session("router", rules, listen=address) as other:
        with open_session("client", settings_in(folder, "mallory", rules=False), connect=address) as one:
            assert Trial(one, other, NAMESPACE, KEYS).run(set()) == set()
        wrong = settings_in(foreign, "operator", rules=False)
        half = settings_in(folder, "operator", rules=False)
        for name in ("connect_private_key", "connect_certificate"):
            half["transport"]["link"]["tls"][name] = wrong["transport"]["link"]["tls"][name]
        for settings, place in ((wrong, address), (half, address), ({}, plain)):
            try:
                one = open_session("client", settings, connect=place)
            except zenoh.ZError:
                continue
            with one:  # opened before the other end has looked at its certificate
                assert Trial(one, other, NAMESPACE, KEYS).run(set()) == set()
