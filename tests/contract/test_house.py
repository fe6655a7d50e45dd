"""The rules of `tests.house` hold: lengths, parameters, names, numbers, helpers, imports, prose."""

import ast
import json
from pathlib import Path

import pytest

from tests import house
from tests.guards import GUARDS

ALLOWED = json.loads(house.ALLOWED.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def found() -> dict[str, dict[str, int]]:
    """Findings by rule and file; in a fixture, for every process of a run imports this file, and one runs it."""
    return house.counted()


@pytest.mark.parametrize("rule", [rule.__name__ for rule in house.RULES])
def test_no_file_breaks_a_rule_more_often_than_it_did(rule: str, found: dict[str, dict[str, int]]) -> None:
    allowed = ALLOWED[rule]
    more = {path: n for path, n in found[rule].items() if n > allowed.get(path, 0)}
    assert not more, f"python -m tests.house prints the lines of {sorted(more)}"


@pytest.mark.parametrize("rule", [rule.__name__ for rule in house.RULES])
def test_what_is_allowed_shrinks_with_what_is_found(rule: str, found: dict[str, dict[str, int]]) -> None:
    stale = {path: n for path, n in ALLOWED[rule].items() if found[rule].get(path, 0) < n}
    assert not stale, "python -m tests.house --allow"


def source(tmp_path: Path, text: str, name: str = "lab/x.py") -> house.Source:
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    made = object.__new__(house.Source)
    made.path, made.name, made.text = path, name, text
    return made


def texts(findings: list[house.Finding]) -> list[str]:
    return [finding.text for finding in findings]


def test_lines_of_code_leave_out_prose_and_blanks(tmp_path: Path) -> None:
    assert (
        source(
            tmp_path, '"""A\nb."""\n\n# c\nx = 1  # d\n"""E."""\ndef f():\n    """G."""\n    return """\n"""\n'
        ).code_lines()
        == 4
    )


def test_long_functions_and_many_parameters_are_found(tmp_path: Path) -> None:
    body = "\n".join("    a += 1" for _ in range(60))
    file = source(tmp_path, f"def f(a, b, c, d, e, g, h, i, j):\n{body}\n")
    assert texts(house.long_functions([file])) == ["f has 61 lines"]
    assert texts(house.many_parameters([file])) == ["f has 9 parameters"]


def test_a_class_a_number_and_a_helper_of_two_files_are_found(tmp_path: Path) -> None:
    helper = "def spread(v):\n    mean = sum(v) / len(v)\n    return [(each - mean) ** 2 + abs(each) for each in v]\n"
    files = [
        source(tmp_path, f"REST_S = 2.0\nclass Walk: ...\n{helper}", "lab/a.py"),
        source(tmp_path, f"_REST_S = 4.0 / 2\nclass _Walk: ...\n{helper.replace('spread', 'other')}", "lab/b.py"),
    ]
    assert len(house.classes_twice(files)) == len(house.numbers_twice(files)) == len(house.helpers_twice(files)) == 2
    assert not house.numbers_twice(files[:1])
    pairs = [source(tmp_path, "REST_S, MOST = 2.0, 7\n", "lab/c.py"), source(tmp_path, "X, Y = 0, 1\n", "lab/d.py")]
    assert len(house.numbers_twice([*files[:1], *pairs, *pairs[1:]])) == 2  # X and Y are indices


def test_absolute_imports_of_the_own_room_are_found(tmp_path: Path) -> None:
    text = "from surefoot.services.walker.memory import a\nfrom surefoot.schemas.hw import b\n"
    assert len(house.climbing_names([source(tmp_path, text, "services/walker/x.py")])) == 1
    assert not house.climbing_names([source(tmp_path, text, "services/estimator/x.py")])


def test_words_and_openings_are_found_where_people_read_them(tmp_path: Path) -> None:
    text = '''"""Whether it walks."""
A = 1
"""Number that `tell` needs."""  # told at the start
def judge():
    """Return what nobody reads (note 2.7)."""
'''
    printed = texts(house.prose([source(tmp_path, text)]))
    assert len(printed) == 4
    assert any(each.startswith("opening: Whether") for each in printed)


def test_strings_that_users_read_and_questions(tmp_path: Path) -> None:
    text = '''"""How far does it walk? Ten centimetres."""
KIND = "told"
raise ValueError(f"{KIND} is told nothing by `tell`")
'''
    (found,) = texts(house.prose([source(tmp_path, text)]))
    assert found == "word 'told': is told nothing by `tell`"
    assert not house.prose([source(tmp_path, text, "tests/x.py")])


def test_all_docstrings_of_the_product_are_seen() -> None:
    file = next(each for each in house.sources() if each.name == "schemas/rows.py")
    fields = sum(isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) for node in ast.walk(file.tree))
    assert len(list(file.docstrings())) == fields > 10


def test_guards_and_the_tests_that_notice_them_exist() -> None:
    named = {*GUARDS, *(path for paths in GUARDS.values() for path in paths)}
    assert not [path for path in named if not (house.ROOT / path).exists()]
