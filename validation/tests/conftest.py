"""The fixtures of `tests/`, and its rules for slow tests."""

from tests.conftest import *  # noqa: F403
