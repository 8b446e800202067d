"""Widgets of ipywidgets with layouts and styles that they share.

Each model opens a comm, and a front end makes each before it shows the first. ipywidgets makes a layout and a style for
every widget; here all equal widgets share one. It is never changed: :func:`set_layout` gives a widget another,
and :func:`own_layout` one that users may change.
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
    >>> own_layout(one).width = "9em"
    >>> other.layout.width is None
    True
    """
    if is_shared(widget.layout):
        widget.layout = ipw.Layout(**_traits_of(widget.layout))
    return widget.layout


def set_layout(widget: Any, **traits: Any) -> None:
    """Give a widget another layout: the one it has but for these traits.

    Examples
    --------
    >>> one, other = Button(description="a"), Button(description="b")
    >>> set_layout(one, width="9em")
    >>> one.layout.width, other.layout.width is None
    ('9em', True)
    """
    if is_shared(widget.layout):
        changed = _traits_of(widget.layout) | traits
        widget.layout = layout(**{name: value for name, value in changed.items() if value is not None})
    else:
        for name, value in traits.items():
            setattr(widget.layout, name, value)


def set_visible(part: Any, is_visible: object) -> None:
    """Show a widget or a :class:`~deformnb.widgets.boxes.Box`, or take it out of the layout flow."""
    if not isinstance(part, ipw.Widget):
        part.is_visible = bool(is_visible)
    elif (part.layout.display != "none") != bool(is_visible):
        set_layout(part, display=None if is_visible else "none")


def _traits_of(one: Any) -> dict[str, Any]:
    names = [name for name in ipw.Layout.class_trait_names(sync=True) if not name.startswith("_")]
    return {name: value for name in names if (value := getattr(one, name)) is not None}


@cache
def _style_of(kind: type) -> Any:
    """The class of the style of a widget, None for widgets without one."""
    trait = kind.class_traits().get("style")  # type: ignore[attr-defined]
    return None if trait is None else trait.klass


def _make(kind: type, *given: Any, layout: Any = None, style: Any = None, **traits: Any) -> Any:
    if _style_of(kind) is not None:
        traits["style"] = shared(_style_of(kind), **(style or {}))
    return kind(*given, layout=layout or shared(ipw.Layout), **traits)


BoundedFloatText = partial(_make, ipw.BoundedFloatText)
BoundedIntText = partial(_make, ipw.BoundedIntText)
Button = partial(_make, ipw.Button)
Checkbox = partial(_make, ipw.Checkbox)
ColorPicker = partial(_make, ipw.ColorPicker)
Dropdown = partial(_make, ipw.Dropdown)
FloatLogSlider = partial(_make, ipw.FloatLogSlider)
FloatProgress = partial(_make, ipw.FloatProgress)
FloatRangeSlider = partial(_make, ipw.FloatRangeSlider)
FloatSlider = partial(_make, ipw.FloatSlider)
FloatText = partial(_make, ipw.FloatText)
HTML = partial(_make, ipw.HTML)
IntSlider = partial(_make, ipw.IntSlider)
Label = partial(_make, ipw.Label)
SelectMultiple = partial(_make, ipw.SelectMultiple)
Text = partial(_make, ipw.Text)
Textarea = partial(_make, ipw.Textarea)
ToggleButton = partial(_make, ipw.ToggleButton)
