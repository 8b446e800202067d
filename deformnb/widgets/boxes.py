"""Boxes of widgets, which are none themselves: one widget shows a tree of them.

A box of ipywidgets is a widget, and its layout is another: each opens a comm. Here a box is a description, in which
widgets are named by number, and all boxes of a front end are one trait of :class:`Boxes`. The front end has the class
names and styles of ipywidgets' boxes.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, ClassVar

import ipywidgets as ipw
import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import BOXES, BoxChoice
from deformnb.widgets.synced import SyncedWidget

_NUMBERS = itertools.count(1)


class Box:
    """A place of widgets and other boxes; each is in one place at a time.

    Parameters
    ----------
    children : its contents.
    classes : names for style sheets, with spaces between.
    style : its own style, such as ``flex_flow="row wrap"``.

    Attributes
    ----------
    number : its id in the front end.

    Examples
    --------
    >>> inner = Box([ipw.Button(), ipw.Button()], min_width="0")
    >>> shown = Boxes([inner])
    >>> inner.is_visible = False
    >>> shown.tree["children"][0]["shown"], len(shown.contents)
    (False, 2)
    """

    kind: ClassVar = "box"

    def __init__(self, children: Iterable[Any] = (), classes: str = "", **style: str) -> None:
        self.number = next(_NUMBERS)
        self._around: weakref.ref[Box | Boxes] | None = None  # a thread may hold a box, and must not hold the studio
        self._classes = tuple(classes.split())
        self._style = {name.replace("_", "-"): value for name, value in style.items()}
        self._is_visible = True
        self._children: tuple[Any, ...] = ()
        self.children = tuple(children)

    @property
    def around(self) -> Box | Boxes | None:
        """The box or the widget that it is in; None for none yet."""
        return None if self._around is None else self._around()

    @around.setter
    def around(self, around: Box | Boxes | None) -> None:
        self._around = None if around is None else weakref.ref(around)

    @property
    def children(self) -> tuple[Any, ...]:
        """The widgets and boxes in it."""
        return self._children

    @children.setter
    def children(self, children: Iterable[Any]) -> None:
        before, self._children = self._children, tuple(children)
        for child in before:
            if isinstance(child, Box) and child not in self._children and child.around is self:
                child.around = None
        for child in self._children:
            if isinstance(child, Box):
                child.around = self
        self.update()

    @property
    def is_visible(self) -> bool:
        """Presence in the layout flow."""
        return self._is_visible

    @is_visible.setter
    def is_visible(self, is_visible: bool) -> None:
        if is_visible != self._is_visible:
            self._is_visible = is_visible
            self.update()

    @property
    def classes(self) -> tuple[str, ...]:
        """Its class names."""
        return self._classes

    def add_class(self, name: str) -> Box:
        """Add a class name; returns the box."""
        if name not in self._classes:
            self._classes = (*self._classes, name)
            self.update()
        return self

    def remove_class(self, name: str) -> None:
        """Remove a class name."""
        if name in self._classes:
            self._classes = tuple(other for other in self._classes if other != name)
            self.update()

    def set_style(self, **style: str | None) -> None:
        """Set parts of its style; None removes one."""
        changes = {name.replace("_", "-"): value for name, value in style.items()}
        self._style = {name: value for name, value in {**self._style, **changes}.items() if value is not None}
        self.update()

    def update(self) -> None:
        """Show what has changed."""
        around = self.around
        if around is not None:
            around.update()

    def inside(self) -> Iterator[Box]:
        """The box and all boxes in it."""
        yield self
        for child in self._children:
            if isinstance(child, Box):
                yield from child.inside()

    def data(self, contents: list[Any]) -> dict[str, Any]:
        """Description for the front end, in which widgets are their numbers in a list; they are added to it."""
        children: list[Any] = []
        for child in self._children:
            if isinstance(child, Box):
                children.append(child.data(contents))
            elif child.comm is not None:  # else it is closed
                children.append(len(contents))
                contents.append(child)
        return {
            "id": self.number,
            "kind": self.kind,
            "classes": list(self._classes),
            "style": dict(self._style),
            "shown": self._is_visible,
            "children": children,
            **self._more_data(),
        }

    def _more_data(self) -> dict[str, Any]:
        return {}

    def choose(self, index: int | None) -> None:
        """Take a choice of the front end: DeformError for a box without any."""
        raise DeformError("there is nothing to choose in this box.")


class Tabs(Box):
    """Boxes of which one is shown, below their titles.

    Attributes
    ----------
    titles : of the boxes; selected : the index of the one that is shown.
    changed : called when another one is.

    Examples
    --------
    >>> tabs = Tabs([Box(), Box()], ["Shape", "View"])
    >>> tabs.changed = lambda: print(tabs.titles[tabs.selected])
    >>> tabs.choose(1)
    View
    """

    kind = "tabs"

    def __init__(self, children: Iterable[Box], titles: Sequence[str]) -> None:
        self.titles = list(titles)
        self.changed: Callable[[], None] = lambda: None
        self.selected = 0
        super().__init__(children, "dnb-tabs")

    def choose(self, index: int | None) -> None:
        """Show the box of this index."""
        if index is None or not 0 <= index < len(self.titles):
            raise DeformError(f"there is no tab {index}.")
        if index != self.selected:
            self.selected = index
            self.changed()
            self.update()

    def _more_data(self) -> dict[str, Any]:
        return {"titles": self.titles, "selected": self.selected}


class Fold(Box):
    """A box below a heading that shows and hides it.

    Attributes
    ----------
    title : the heading; is_open : whether the box is shown.
    changed : called when that changes.

    Examples
    --------
    >>> fold = Fold(Box(), "Points")
    >>> fold.choose(0)
    >>> fold.is_open
    True
    """

    kind = "fold"

    def __init__(self, child: Box, title: str, *, is_open: bool = False) -> None:
        self.title, self.is_open = title, is_open
        self.changed: Callable[[], None] = lambda: None
        super().__init__([child], "dnb-section dnb-section-open" if is_open else "dnb-section")

    def choose(self, index: int | None) -> None:
        """Show the box for 0, hide it for None."""
        if (index is not None) != self.is_open:
            self.is_open = index is not None
            self.changed()
            self.update()

    def _more_data(self) -> dict[str, Any]:
        return {"titles": [self.title], "selected": 0 if self.is_open else None}


def column(*children: Any, classes: str = "", **style: str) -> Box:
    """Widgets and boxes one below the other.

    Examples
    --------
    >>> column(ipw.Button(), classes="dnb-late").classes
    ('widget-vbox', 'dnb-late')
    """
    return Box(children, f"widget-vbox {classes}", **style)


def line(*children: Any, classes: str = "", **style: str) -> Box:
    """Widgets and boxes side by side."""
    return Box(children, f"widget-hbox {classes}", **style)


def row(*children: Any) -> Box:
    """Controls side by side, one below the other where the window is narrow."""
    return line(*children, classes="dnb-row", flex_flow="row wrap", align_items="center", grid_gap="4px 8px")


class Boxes(SyncedWidget):
    """A widget of boxes and of the widgets in them.

    Parameters
    ----------
    children : from top to bottom.

    Attributes
    ----------
    children : the same, to be set.
    tree : the boxes, for the front end; contents : the widgets in them.

    Examples
    --------
    >>> boxes = Boxes([row(ipw.Button(description="a"), ipw.Button(description="b"))])
    >>> [widget.description for widget in boxes.contents]
    ['a', 'b']
    >>> boxes.close()
    """

    _esm = bundle("boxes.js")
    _css = bundle("boxes.css")
    channel = BOXES

    children = traitlets.Tuple()
    tree = traitlets.Dict().tag(sync=True)
    contents = traitlets.Tuple().tag(sync=True, **ipw.widget_serialization)

    def __init__(self, children: Iterable[Any] = (), **traits: Any) -> None:
        self._root = Box(children)
        self._root.around = self
        contents: list[Any] = []
        tree = self._root.data(
            contents
        )  # in the message that opens the model: anywidget drops later ones of a late page
        super().__init__(children=self._root.children, contents=tuple(contents), tree=tree, **traits)

    @traitlets.observe("children")
    def _children_changed(self, change: Any) -> None:
        self._root.children = change["new"]

    def update(self) -> None:
        """Send the boxes to the front end."""
        if getattr(self, "comm", None) is None:
            return
        with self._sending:  # the tree that is sent last is that of now
            contents: list[Any] = []
            tree = self._root.data(contents)
            with self.hold_sync():
                self.contents, self.tree = tuple(contents), tree

    def take_message(self, message: BoxChoice, buffers: Any = ()) -> None:
        for box in self._root.inside():
            if box.number == message.box:
                box.choose(message.index)
                return
        raise DeformError("the box is not there any more.")

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""
