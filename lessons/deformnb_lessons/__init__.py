"""Lessons for pupils and first-year students: five notebooks with exercises that check themselves.

``deformnb lesson`` lists them and ``deformnb lesson coordinates`` opens one. In a notebook, ``LESSONS["coordinates"]``
is the lesson, and its ``check`` answers with a hint.
"""

from pathlib import Path

import lazy_loader

from deformnb.words import add_tables

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

add_tables(Path(__file__).parent / "words")
