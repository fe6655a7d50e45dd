"""The grants follow the table: owners publish, readers subscribe, callers ask, servers serve, and nothing else."""

from surefoot.bus.sizes import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.lab.security.grants import ROUTER, Grant, Role, Verb, areas, grants, limits
from surefoot.lab.security.settings import access_control
from surefoot.lockstep.service import Service
from surefoot.schemas.topics import CMD_ESTOP, CMD_JOINTS, QUERIES, TERRAIN_MAP, TOPICS
from tests.lab.security.test_table import GRANTED, IDENTITIES, SYSTEM


def keys_of(identity: str, verb: Verb) -> set[str]:
    return {grant.key for grant in GRANTED if (grant.identity, grant.verb) == (identity, verb)}


def test_every_service_has_grants_and_every_topic_one_publisher() -> None:
    assert set(IDENTITIES) == {*SYSTEM.services, "operator", "guest"} - {ROUTER}
    for topic in TOPICS:
        if topic.owner == "*" or topic.owner == ROUTER:
            continue
        publishers = {grant.identity for grant in GRANTED if grant.verb is Verb.PUBLISH and grant.key == topic.key}
        expected = {"simulator"} if topic.owner == "driver" else {topic.owner}
        assert publishers <= expected, topic.key


def test_each_query_has_one_server() -> None:
    for query in QUERIES:
        servers = {grant.identity for grant in GRANTED if grant.verb is Verb.SERVE and grant.key == query.key}
        assert len(servers) <= 1, query.key


def test_only_the_walker_commands_joints_and_only_the_driver_takes_them() -> None:
    assert {g.identity for g in GRANTED if g.verb is Verb.PUBLISH and g.key == CMD_JOINTS.key} == {"walker"}
    readers = {grant.identity for grant in GRANTED if grant.verb is Verb.READ and grant.key == "@frame/walker"}
    assert "simulator" in readers


def test_people_command_by_their_role() -> None:
    acting = {query.key for query in QUERIES if query.acts}
    assert acting <= keys_of("operator", Verb.ASK)
    assert not acting & keys_of("guest", Verb.ASK)
    assert keys_of("operator", Verb.PUBLISH) == {CMD_ESTOP.key}
    assert keys_of("guest", Verb.PUBLISH) == set()
    for name in ("operator", "guest"):
        assert not any(key.startswith("@") for key in keys_of(name, Verb.READ) | keys_of(name, Verb.ASK))


def test_every_key_has_one_size_limit() -> None:
    found = [key for keys in limits().values() for key in keys]
    assert len(found) == len(set(found))
    assert {topic.key for topic in TOPICS} <= set(found)
    assert TERRAIN_MAP.key in limits()[max(limits())]


def test_only_keys_of_arrays_may_carry_as_much_as_a_map() -> None:
    small, large = limits()[MAX_JSON_BYTES], limits()[MAX_BULK_BYTES]
    assert {CMD_ESTOP.key, CMD_JOINTS.key} <= set(small)
    assert TERRAIN_MAP.key in large
    assert len(large) < len(small)


def test_the_router_may_do_all_without_a_grant() -> None:
    router = type("Router", (Service,), {"name": ROUTER})
    assert grants([router], {}) == ()
    assert {grant.identity for grant in grants([type("Other", (Service,), {"name": "other"})], {})} == {"other"}


def test_the_areas_of_keys_are_all_and_each_first_word_that_all_leaves_out() -> None:
    found = areas(
        [Grant("walker", Verb.PUBLISH, key) for key in ("state/gait", "@frame/walker", "@live/a/*", "@live/b")]
    )
    assert found == ("**", "@frame/**", "@live/**")


def test_the_rules_deny_by_default_and_name_each_identity_once() -> None:
    rules = access_control("surefoot/ragno", GRANTED)
    assert (rules["enabled"], rules["default_permission"]) == (True, "deny")
    assert {name for subject in rules["subjects"] for name in subject["cert_common_names"]} == {*IDENTITIES, ROUTER}
    assert {rule["permission"] for rule in rules["rules"]} == {"allow"}
    assert all(key.startswith("surefoot/ragno/") for rule in rules["rules"] for key in rule["key_exprs"])


def test_a_new_person_changes_no_grant_of_others() -> None:
    from surefoot.lab.security.made import classes

    more = grants(classes(SYSTEM), {**{role.value: role for role in Role}, "alice": Role.GUEST})
    assert [grant for grant in more if grant.identity != "alice"] == list(GRANTED)
