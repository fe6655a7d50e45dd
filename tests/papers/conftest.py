"""The command line in this process, as in the tests of the lab."""

from tests.lab.conftest import answer, complaint, in_process

__all__ = ["answer", "complaint", "in_process"]
