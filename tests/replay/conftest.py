"""`pytest tests/replay --update` writes the references anew."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="write the references of replay tests anew")
