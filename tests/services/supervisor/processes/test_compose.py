"""The compose reader honours, accepts or refuses every key, and names it."""

from pathlib import Path

import pytest

from surefoot.services.supervisor.processes.compose import ComposeError, HealthCheck, load_compose, parse_compose
from tests.services.refusals import refused

ROOT = Path(__file__).parents[4]


def error_of(text: str) -> ComposeError:
    with pytest.raises(ComposeError) as caught:
        parse_compose(text, Path("some.yaml"))
    assert str(caught.value).startswith("some.yaml")
    return caught.value


def rates(service):
    return service.healthcheck.interval_s, service.healthcheck.retries, service.healthcheck.start_period_s


def test_reads_every_honoured_key():
    compose = parse_compose(
        """
        name: robot
        x-mine: {anything: [1]}
        services:
          late:
            command: python -m services.late --flag "two words"
            environment: [A=1, B=x=y]
            depends_on: {early: {condition: service_healthy}}
            healthcheck: {test: surefoot health late, interval: 500ms, retries: 4, start_period: 1m30s, timeout: 2s}
            restart: on-failure:3
            stop_grace_period: 1s
            x-note: mine
          early: {environment: {N: 2}, restart: no, image: surefoot, build: ., init: true, network_mode: host}
        """
    )
    assert (compose.name, tuple(compose.services)) == ("robot", ("early", "late"))
    late = compose.services["late"]
    assert late.command == ("python", "-m", "services.late", "--flag", "two words")
    assert late.environment == {"A": "1", "B": "x=y"}
    assert late.depends_on == (("early", "service_healthy"),)
    assert rates(late) == (0.5, 4, 90.0)
    assert (late.restart, late.max_restarts, late.stop_grace_s) == ("on-failure", 3, 1.0)
    early = compose.services["early"]
    assert early.command == ("surefoot-service", "early")
    assert (early.restart, early.environment) == ("no", {"N": "2"})


def test_a_disabled_health_check_is_none():
    compose = parse_compose("services: {a: {healthcheck: {disable: true}}, b: {healthcheck: {test: [NONE]}}}")
    assert [service.healthcheck for service in compose.services.values()] == [None, None]


BASE = """
services:
  first: {restart: always}
  walker:
    command: surefoot-service walker --set a=1
    environment: [A=1, B=2]
    depends_on: [first]
    healthcheck: {interval: 2s, retries: 5}
    restart: always
"""


def test_a_service_begins_as_the_one_it_extends(tmp_path):
    (tmp_path / "base.yaml").write_text(BASE)
    (tmp_path / "more.yaml").write_text("""
services:
  first: {extends: {file: base.yaml, service: first}}
  mine:
    extends: {file: base.yaml, service: walker}
    environment: {B: 3, C: 4}
    depends_on: {other: {condition: service_healthy}}
    healthcheck: {test: [CMD, surefoot, health, mine], retries: 7}
  other: {extends: first, restart: no}
""")
    compose = load_compose(tmp_path / "more.yaml")
    mine, other = compose.services["mine"], compose.services["other"]
    assert mine.command == ("surefoot-service", "walker", "--set", "a=1")
    assert mine.environment == {"A": "1", "B": "3", "C": "4"}
    assert set(mine.depends_on) == {("first", "service_started"), ("other", "service_healthy")}
    assert rates(mine) == (2.0, 7, HealthCheck().start_period_s)
    assert (mine.restart, other.restart) == ("always", "no")


@pytest.mark.parametrize(
    ("services", "code", "field"),
    [
        ("{a: {extends: {file: base.yaml, service: walkr}}}", "unknown_name", "services.a.extends.service"),
        ("{a: {extends: {file: none.yaml, service: a}}}", "not_found", "file"),
        ("{a: {extends: {file: base.yaml}}}", "missing", "services.a.extends.service"),
        ("{a: {extends: {service: a, from: b}}}", "unknown_key", "services.a.extends.from"),
        ("{a: {extends: 3}}", "type", "services.a.extends"),
        ("{a: {extends: b}, b: {extends: a}}", "value", "services.a.extends"),
        ("{a: {extends: {file: broken.yaml, service: a}}}", "syntax", "file"),
        ("{a: {extends: {file: base.yaml, service: ported}}}", "unknown_key", "services.a.ports"),
        ("{a: {extends: {file: base.yaml, service: first}, environment: 3}}", "type", "services.a.environment"),
    ],
)
def test_what_cannot_be_extended_is_refused_by_name(tmp_path, services, code, field):
    (tmp_path / "base.yaml").write_text(BASE + "  ported: {ports: ['1:1']}")
    (tmp_path / "broken.yaml").write_text("{")
    (tmp_path / "some.yaml").write_text(f"services: {services}")
    with refused(ComposeError, code, field):
        load_compose(tmp_path / "some.yaml")


@pytest.mark.parametrize(
    ("text", "code", "field"),
    [
        ("services: {a: {ports: ['1:1']}}", "unknown_key", "services.a.ports"),
        ("services: {a: {}}\nvolumes: {}", "unknown_key", "volumes"),
        ("services: {a: {healthcheck: {tests: x}}}", "unknown_key", "services.a.healthcheck.tests"),
        ("services: {a: {healthcheck: {test: curl x}}}", "value", "services.a.healthcheck.test"),
        ("services: {a: {restart: sometimes}}", "value", "services.a.restart"),
        ("services: {a: {restart: 'on-failure:0'}}", "value", "services.a.restart"),
        ("services: {a: {command: []}}", "type", "services.a.command"),
        ("services: {a: {command: 'say \"'}}", "value", "services.a.command"),
        ("services: {a: {command: 3}}", "type", "services.a.command"),
        ("services: {a: {command: [say, 1]}}", "type", "services.a.command"),
        ("services: {a: {restart: 3}}", "value", "services.a.restart"),
        ("services: {a: {environment: {X: [1]}}}", "type", "services.a.environment.X"),
        ("services: {a: {environment: [1]}}", "type", "services.a.environment"),
        ("services: {a: {depends_on: [1]}}", "type", "services.a.depends_on"),
        ("services: {!!binary YQ==: {}}", "value", "services"),
        ("services: {a: {healthcheck: {retries: 0}}}", "value", "services.a.healthcheck.retries"),
        ("services: {a: {healthcheck: {retries: 1001}}}", "value", "services.a.healthcheck.retries"),
        ("services: {a: {? [restart] : always}}", "syntax", "file"),
        ("services: {a: {environment: {X: true}}}", "type", "services.a.environment.X"),
        ("services: {a: {environment: [X]}}", "type", "services.a.environment"),
        ("services: {a: {stop_grace_period: 2}}", "value", "services.a.stop_grace_period"),
        ("services: {a: {stop_grace_period: ''}}", "value", "services.a.stop_grace_period"),
        ("services: {a: {depends_on: [b]}}", "unknown_name", "services.a.depends_on"),
        ("services: {a: {depends_on: [b]}, b: {depends_on: [a]}}", "value", "services.a.depends_on"),
        ("services: {a: {depends_on: {a: {condition: done}}}}", "value", "services.a.depends_on.a.condition"),
        ("services: {'A b': {}}", "value", "services"),
        ("services: {1: {}}", "value", "services"),
        ("services: {a: }", "type", "services.a"),
        ("services: {}", "missing", "services"),
        ("name: x", "missing", "services"),
        ("name: X y\nservices: {a: {}}", "value", "name"),
        ("services: {a: {}, a: {}}", "syntax", "file"),
        ("[1, 2]", "type", "file"),
        ("", "type", "file"),
        ("a: [", "syntax", "file"),
        ("a: !!python/object:os.system x", "syntax", "file"),
        ("[" * 5000, "syntax", "file"),
        (
            "services: {a: {environment: {SUREFOOT_ROBOT: nao}}, b: {environment: {SUREFOOT_ROBOT: ragno}}}",
            "value",
            "services.b.environment.SUREFOOT_ROBOT",
        ),
    ],
)
def test_refuses_by_name(text, code, field):
    error = error_of(text)
    assert (error.code, error.field) == (code, field)


def test_a_command_with_an_open_quote_is_refused_in_plain_words():
    assert "cannot be split into words: " in str(error_of("services: {a: {command: 'say \"'}}"))


def test_what_is_merged_twice_is_not_given_twice():
    text = "services: {a: &a {restart: always}, b: &b {stop_grace_period: 1s}, c: {<<: *a, <<: *b}}"
    service = parse_compose(text).services["c"]
    assert (service.restart, service.stop_grace_s) == ("always", 1.0)


def test_a_file_of_aliases_upon_aliases_is_a_short_sentence():
    lines = ["a0: &a0 [x, x]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 40))]
    assert len(str(error_of("\n".join([*lines, "services: *a39"])))) < 1000
    assert len(str(error_of("\n".join([*lines, "services: {a: {command: *a39}}"])))) < 1000


def test_an_unknown_key_names_the_allowed_ones_and_the_nearest():
    message = str(error_of("services: {a: {depend_on: [b]}}"))
    for word in ("services.a.depend_on", "did you mean 'depends_on'", "healthcheck", "restart"):
        assert word in message


@pytest.mark.parametrize(("content", "code"), [(None, "not_found"), (b"\xff\xfe", "syntax"), (b"#" * 300_000, "value")])
def test_refuses_files_that_cannot_be_read(tmp_path, content, code):
    path = tmp_path / "system.yaml"
    if content is not None:
        path.write_bytes(content)
    with refused(ComposeError, code) as caught:
        load_compose(path)
    assert str(path) in str(caught.value)


def test_a_folder_stands_for_the_compose_file_in_it(tmp_path, monkeypatch):
    """Before, `surefoot up examples/robot` was refused as 'Is a directory', although `system.yaml` lies in it."""
    robot = ROOT / "examples" / "robot"
    assert load_compose(robot) == load_compose(f"{robot}/") == load_compose(robot / "system.yaml")
    monkeypatch.chdir(robot)
    assert load_compose(".").services == load_compose("system.yaml").services
    (tmp_path / "compose.yaml").write_text("services: {walker: {command: surefoot-service walker}}")
    assert set(load_compose(tmp_path).services) == {"walker"}


def test_a_folder_without_a_compose_file_is_refused_with_what_it_holds(tmp_path):
    with pytest.raises(ComposeError) as empty:
        load_compose(tmp_path)
    assert str(empty.value) == f"{tmp_path}: is a folder without system.yaml or compose.yaml"
    (tmp_path / "two.yaml").touch()
    (tmp_path / "one.yaml").touch()
    with pytest.raises(ComposeError) as full:
        load_compose(tmp_path)
    assert str(full.value).endswith("; name the file: one.yaml, two.yaml")
