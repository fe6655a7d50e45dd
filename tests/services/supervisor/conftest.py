"""Fixtures shared with the tests of the lab."""

from tests.lab.conftest import command_line, listen, place, surefoot

__all__ = ["command_line", "listen", "place", "surefoot"]
