"""Widgets of ipywidgets with layouts and styles that they share.

Each model opens a comm, and a front end makes each before it shows the first. ipywidgets makes a layout and a style for
every widget; here all that look the same have one. It is never changed: :func:`own_layout` gives a widget its own.
"""

from __future__ import annotations

import threading
from functools import cache, partial
from typing import Any

import ipywidgets as ipw

_LOCK = threading.Lock()
_SHARED: dict[tuple[type, frozenset[tuple[str, Any]]], Any] = {}


def shared(kind: type, **traits: Any) -> Any:
    """The layout or style of these traits, which must not be changed.

    Examples
    --------
    >>> shared(ipw.Layout, width="auto") is shared(ipw.Layout, width="auto")
    True
    """
    key = (kind, frozenset(traits.items()))
    with _LOCK:
        found = _SHARED.get(key)
        if found is None or found.comm is None:  # a user may close all widgets
            found = _SHARED[key] = kind(**traits)
        return found


def layout(**traits: Any) -> Any:
    """The layout of these traits that widgets share."""
    return shared(ipw.Layout, **traits)


def shared_models() -> list[Any]:
    """All open layouts and styles that widgets share by now."""
    with _LOCK:
        return [model for model in _SHARED.values() if model.comm is not None]


def is_shared(model: Any) -> bool:
    """Check whether a layout or style is one that widgets share."""
    with _LOCK:
        return any(found is model for found in _SHARED.values())


def own_layout(widget: Any) -> Any:
    """The layout of a widget alone, to be changed.

    Examples
    --------
    >>> one, other = Button(description="a"), Button(description="b")
    >>> own_layout(one).display = "none"
    >>> other.layout.display is None
    True
    """
    if is_shared(widget.layout):
        widget.layout = ipw.Layout(**{name: getattr(widget.layout, name) for name in _layout_traits()})
    return widget.layout


def set_shown(widget: Any, is_shown: object) -> None:
    """Show a widget, or take it out of the flow of the page."""
    if (widget.layout.display != "none") != bool(is_shown):
        own_layout(widget).display = None if is_shown else "none"


@cache
def _layout_traits() -> tuple[str, ...]:
    return tuple(name for name in ipw.Layout.class_trait_names(sync=True) if not name.startswith("_"))


@cache
def _style_of(kind: type) -> Any:
    """The class of the style of a widget, None for widgets without one."""
    trait = kind.class_traits().get("style")  # type: ignore[attr-defined]
    return None if trait is None else trait.klass


def _make(kind: type, *given: Any, layout: Any = None, style: Any = None, **traits: Any) -> Any:
    if _style_of(kind) is not None:
        traits["style"] = shared(_style_of(kind), **(style or {}))
    return kind(*given, layout=layout or shared(ipw.Layout), **traits)


Accordion = partial(_make, ipw.Accordion)
BoundedFloatText = partial(_make, ipw.BoundedFloatText)
BoundedIntText = partial(_make, ipw.BoundedIntText)
Box = partial(_make, ipw.Box)
Button = partial(_make, ipw.Button)
Checkbox = partial(_make, ipw.Checkbox)
ColorPicker = partial(_make, ipw.ColorPicker)
Dropdown = partial(_make, ipw.Dropdown)
FloatLogSlider = partial(_make, ipw.FloatLogSlider)
FloatProgress = partial(_make, ipw.FloatProgress)
FloatRangeSlider = partial(_make, ipw.FloatRangeSlider)
FloatSlider = partial(_make, ipw.FloatSlider)
FloatText = partial(_make, ipw.FloatText)
HBox = partial(_make, ipw.HBox)
HTML = partial(_make, ipw.HTML)
IntSlider = partial(_make, ipw.IntSlider)
Label = partial(_make, ipw.Label)
SelectMultiple = partial(_make, ipw.SelectMultiple)
Tab = partial(_make, ipw.Tab)
Text = partial(_make, ipw.Text)
Textarea = partial(_make, ipw.Textarea)
ToggleButton = partial(_make, ipw.ToggleButton)
VBox = partial(_make, ipw.VBox)
