"""Settings of all tests."""

from hypothesis import settings

# The same examples on every machine; a first call may compile a kernel, so single examples have no time limit.
settings.register_profile("surefoot", derandomize=True, deadline=None)
settings.load_profile("surefoot")
