"""Style sheets of the widgets: who prefers reduced motion sees none."""

from __future__ import annotations

import re

from deformnb.widgets.bundle import SOURCES

_REDUCED = re.compile(r"@media \(prefers-reduced-motion: reduce\) \{((?:[^{}]*\{[^{}]*\})*)\s*\}")
_RULE = re.compile(r"([^{};]+)\{([^{}]*)\}")


def _selectors(text: str) -> set[str]:
    return {selector.strip() for selector in re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).split(",")}


def test_every_animation_and_transition_ends_where_reduced_motion_is_preferred() -> None:
    moving = 0
    for path in SOURCES.rglob("*.css"):
        text = re.sub(r"/\*.*?\*/", "", path.read_text("utf-8"), flags=re.DOTALL)
        still = {
            selector
            for block in _REDUCED.findall(text)
            for rule in _RULE.findall(block)
            for selector in _selectors(rule[0])
        }
        for selectors, style in _RULE.findall(_REDUCED.sub("", text)):
            if re.search(r"\b(animation|transition): *(?!none)", style):
                moving += 1
                assert _selectors(selectors) <= still, (path.name, selectors)
    assert moving >= 4
