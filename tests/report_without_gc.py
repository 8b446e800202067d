"""A plugin for pytest: no garbage is collected while the report of a test is made.

To show a failure, pytest parses the test's file. The finaliser of a piece of garbage that is found meanwhile may fail,
its traceback is written, and for that Python 3.11 parses a line; of the two parsers, one inside the other, the outer
raises SystemError ("AST constructor recursion depth mismatch", https://github.com/python/cpython/issues/106905), which
ends the run. Playwright leaves such garbage wherever it cannot start.
"""

from __future__ import annotations

import gc
from collections.abc import Generator
from typing import Any

import pytest


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, Any, Any]:
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return (yield)
    finally:
        if was_enabled:
            gc.enable()
