"""Output of commands for programs: one document of JSON."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add_json(p: argparse.ArgumentParser) -> None:
    """The option ``--json``."""
    p.add_argument("--json", action="store_true", help='print one document of JSON, {"error": ...} for an error')


def print_json(document: Any) -> None:
    """Print a document of JSON in ASCII, which any terminal and any pipe can hold."""
    print(json.dumps(document, indent=2, allow_nan=False))
