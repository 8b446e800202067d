"""How time passes in an animation: between two key frames, and after the last one."""

from __future__ import annotations

from collections.abc import Callable

EASINGS: dict[str, Callable[[float], float]] = {"linear": lambda t: t, "smooth": lambda t: t * t * (3 - 2 * t)}
"""How time passes from one key frame to the next, by name: at an even pace, or slowly at both ends."""

LOOPS = {"once": "from the first key frame to the last", "loop": "over and over from the beginning",
         "swing": "there and back, over and over"}
"""What comes after the last key frame."""
