"""Controls of the studio: sliders and menus made from the registries, each bound to one setting of the session.

A control writes the choice of its user and shows the value of the session; when the two are equal nothing happens, so
an edit never comes back as another one.
"""

from __future__ import annotations

import html
import re
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import ipywidgets as ipw
import numpy as np
import traitlets

from deformnb._progress import remaining_time
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.support import lone_support
from deformnb.rbf.trends import TRENDS
from deformnb.session.session import Session
from deformnb.volume.channels import ChannelDisplay
from deformnb.volume.views import side_words
from deformnb.volume.volume import Volume
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, line, row
from deformnb.widgets.cell_widgets import close_all, owned_widgets
from deformnb.widgets.inputs.clip_controls import ClipControls
from deformnb.widgets.inputs.transfer_editor import PresetMenu
from deformnb.widgets.parameters import ACTIONS, OF_THE_FIT, PARAMETERS, Choice, Number, parameters
from deformnb.widgets.synced import translated_by_owner

Guard = Callable[[Callable[[], None]], bool]
"""Runs an edit and shows its error; returns whether it was done."""

STEP_COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#f0e442")
"""Of the marks of steps, in the list and over the picture: Okabe and Ito's, repeated."""

_IN_SPACE = ("in space", "")
_VIEW = "view "  # before the number of an oblique plane in the menu of sides
_STYLE = {"description_width": "100px"}
WHOLE_DESCRIPTION = {"description_width": "initial"}
"""Style of a control whose description is never cut short."""
_STANDING_ELSEWHERE = ("strength", "stages")  # above the panels, and next to the folds
_ROUNDING = 0.501  # of a slider's step
_SHOWN_SHARE = 0.01  # of work, by which a bar grows


def error_action(error: Exception) -> Callable[[], None]:
    """An action that raises an error: a guard shows it as it shows those of other actions."""

    def action() -> None:
        raise error

    return action


def file_stem(volume: Volume) -> str:
    """The name of a volume as the beginning of a file name that every system takes.

    Examples
    --------
    >>> file_stem(Volume.from_array([[[0, 1]]], name="my scan (2).nii"))
    'my_scan_2_nii'
    """
    return re.sub(r"[^\w-]+", "_", volume.name).strip("_")[:40] or "deformed"


def wide(**more: str) -> ipw.Layout:
    """A layout that shares a row evenly."""
    return basic.layout(**{"flex": "1 1 240px", "width": "auto", "min_width": "0", "max_width": "480px", **more})


@dataclass
class Control:
    """A widget bound to one thing of the session.

    Parameters
    ----------
    widget : has a trait ``value``.
    read : the value that the session holds, as the widget shows it.
    write : passes the widget's value to the session.
    """

    widget: Any
    read: Callable[[], Any]
    write: Callable[[Any], None]

    def bind(self, guard: Guard, is_refreshing: Callable[[], bool]) -> None:
        """Let the widget edit the session; a refused value returns to that of the session."""

        def changed(change: Any) -> None:
            if is_refreshing() or self._shows(change["new"], self.read()):
                return
            guard(lambda: self.write(change["new"]))
            self.refresh()

        self.widget.observe(changed, "value")

    def refresh(self) -> None:
        """Show the state of the session."""
        value = self.read()
        if not self._shows(self.widget.value, value):
            self.widget.value = value

    def _shows(self, shown: Any, value: Any) -> bool:
        """Check whether the widget shows this value: a slider rounds it to its step, and reports that as an edit."""
        if not _is_slider(self.widget):
            return bool(shown == value)
        if isinstance(self.widget, ipw.FloatLogSlider):
            shown, value = np.log10(shown), np.log10(value)
        return bool(abs(shown - value) <= _ROUNDING * self.widget.step)


def _is_slider(widget: Any) -> bool:
    return isinstance(widget, ipw.FloatSlider | ipw.FloatLogSlider)


def menu(description: str, options: Iterable[tuple[str, str]], tooltip: str = "", layout: Any = None) -> ipw.Dropdown:
    """A menu of (words, value); ``layout`` instead of the usual one."""
    return basic.Dropdown(
        options=list(options),
        description=description,
        tooltip=tooltip or description,
        layout=layout or wide(),
        style=_STYLE,
    )


def widget_of(name: str, diagonal: float = 1.0, layout: Any = None, *, label: str = "100px") -> Any:
    """The widget for a parameter of :data:`~deformnb.widgets.parameters.PARAMETERS`.

    Parameters
    ----------
    diagonal : of the volume, for lengths.
    layout : instead of the usual one.
    label : width of the words before it.
    """
    style = {"description_width": label}
    parameter = parameters(diagonal)[name]
    words = {"description": parameter.label, "tooltip": parameter.tooltip}
    if isinstance(parameter, Choice):
        return basic.Dropdown(options=parameter.menu, layout=layout or wide(), style=style, **words)
    if isinstance(parameter, Number):
        low, high, step = parameter.low, parameter.high, parameter.step
        if parameter.is_log:
            return basic.FloatLogSlider(
                min=np.log10(low),
                max=np.log10(high),
                step=step,
                style=style,
                readout_format=f".{parameter.digits}r",
                layout=layout or wide(),
                **words,
            )
        if parameter.digits == 0:
            return basic.IntSlider(
                min=int(low), max=int(high), step=int(step), style=style, layout=layout or wide(), **words
            )
        return basic.FloatSlider(
            min=low,
            max=high,
            step=step,
            style=style,
            readout_format=f".{parameter.digits}f",
            layout=layout or wide(),
            continuous_update=True,
            **words,
        )
    return basic.Checkbox(False, indent=False, layout=layout or basic.layout(width="auto"), **words)


def action_button(name: str, action: Callable[[], Any]) -> ipw.Button:
    """The button for an action of :data:`~deformnb.widgets.parameters.ACTIONS`."""
    return button(ACTIONS[name].label, ACTIONS[name].tooltip, action)


def button(text: str, tooltip: str, action: Callable[[], Any]) -> ipw.Button:
    """A button that does something."""
    made = basic.Button(description=text, tooltip=tooltip, layout=basic.layout(width="auto"))
    made.on_click(lambda _: action())
    return made


def fill(widget: ipw.Dropdown, options: list[tuple[str, str]]) -> None:
    """Give a menu other options, if they are others."""
    if list(widget.options) != options:
        widget.options = options


def slider(
    description: str, low: float, high: float, step: float, tooltip: str = "", text: str = ".2f", layout: Any = None
) -> Any:
    """A slider that follows the pointer."""
    return basic.FloatSlider(
        min=low,
        max=high,
        step=step,
        description=description,
        layout=layout or wide(),
        style=_STYLE,
        readout_format=text,
        tooltip=tooltip or description,
        continuous_update=True,
    )


def prose(text: str) -> str:
    """A text for an HTML widget, in as many lines as it needs: a label would cut it, and lines be far apart."""
    return f'<div style="line-height: 1.35">{html.escape(text)}</div>'


class _Depth(threading.local):
    """Nesting depth of a thread; each has a separate number, for several refresh a panel concurrently."""

    depth = 0


class Panel:
    """Some controls in a box.

    Attributes
    ----------
    title : of its section; box : the widget; controls : the bound ones.
    warning : a line below the pictures while something is wrong; None for panels that warn of nothing, as
        all must that are made late.
    """

    title = ""
    warning: Any = None
    box: Any

    def __init__(self, session: Session, guard: Guard) -> None:
        self.session = session
        self.guard = guard
        self.controls: list[Control] = []
        self._refreshing = _Depth()  # new options of a menu choose the first of them, and that is no edit of the user

    def add(self, widget: Any, read: Callable[[], Any], write: Callable[[Any], None]) -> Any:
        """Bind one more widget; returns it."""
        control = Control(widget, read, write)
        control.refresh()
        control.bind(self.guard, lambda: self._refreshing.depth > 0)
        self.controls.append(control)
        return widget

    def bind_step(self, widget: Any, name: str) -> Any:
        """Bind a widget to a field of the step being edited."""
        return self.add(
            widget,
            lambda: getattr(self.session.editing.step, name),
            lambda value: self.session.editing.change(kind=name, slides=_is_slider(widget), **{name: value}),
        )

    def refresh(self) -> None:
        """Show the state of the session."""
        self._refreshing.depth += 1
        try:
            self.arrange()
            for control in self.controls:
                control.refresh()
        finally:
            self._refreshing.depth -= 1

    def arrange(self) -> None:
        """Show or hide what depends on the session, and fill the menus."""

    def handle_visibility(self, is_open: bool) -> None:
        """Called when the panel is shown, and when it is hidden."""

    def close(self) -> None:
        """Stop the threads and observers of the panel."""


_AnyPanel = TypeVar("_AnyPanel", bound=Panel)


class LatePanel(Generic[_AnyPanel]):
    """A panel that is made when it is first seen or used: a studio is shown long before most of its panels are.

    Parameters
    ----------
    kind : of the panel; arguments : it is made of these.

    Attributes
    ----------
    title : of the panel; box : its place, empty and of the class dnb-late until it is made.
    unfold : scrolls the place into view, where it is a section that can be folded.
    made : the panel; None until it is made.
    """

    def __init__(self, kind: type[_AnyPanel], *arguments: Any) -> None:
        self._make = partial(kind, *arguments)
        self._lock = threading.RLock()
        self._actions: list[Callable[[_AnyPanel], None]] = []
        self.title = kind.title
        self.box = column(classes="dnb-late")
        self.unfold: Callable[[], None] = lambda: None
        self.made: _AnyPanel | None = None

    @property
    def panel(self) -> _AnyPanel:
        """The panel, made now if it was not before."""
        return self.make()

    def make(self) -> _AnyPanel:
        """Make the panel, if it has not been made."""
        with self._lock:
            if self.made is None:
                with translated_by_owner(), owned_widgets():
                    made = self._make()
                self.box.children = (made.box,)
                self.box.remove_class("dnb-late")
                self.made = made
                for action in self._actions:
                    action(made)
            return self.made

    def call_when_ready(self, action: Callable[[_AnyPanel], None]) -> None:
        """Do something with the panel once it is made, or now if it was."""
        with self._lock:
            if self.made is None:
                self._actions.append(action)
            else:
                action(self.made)

    def reveal(self) -> None:
        """Scroll the panel into view."""
        self.unfold()

    def handle_visibility(self, is_open: bool) -> None:
        """Called when the place is shown, and when it is hidden."""
        if is_open or self.made is not None:
            self.panel.handle_visibility(is_open)


def _with_icon(made: Any, icon: str) -> Any:
    """A button that shows an icon of the studio's style sheet where its pane has no room for words."""
    made.add_class("dnb-icon-button").add_class(f"dnb-icon-{icon}")
    return made


class PicturePanel(Panel):
    """Row over the picture: the step that is edited, side, projection, slice.

    Parameters
    ----------
    show_grids : shows the panel of Thompson's grids.
    """

    def __init__(self, session: Session, guard: Guard, editor: Any, show_grids: Callable[[], None]) -> None:
        super().__init__(session, guard)
        self._side = side = widget_of("view", layout=basic.layout(width="auto"))
        fill(side, self._sides())
        self.add(side, self._side_value, self._choose_side)
        method = self.add(
            widget_of("method", layout=basic.layout(width="auto")),
            lambda: session.pictures.method,
            lambda value: session.pictures.set_trait("method", value),
        )
        self._depth = self.add(
            slider("Slice", -1.0, 1.0, 0.01, "Depth of the slice, from the middle of the volume", ".1f"),
            self._clipped_depth,
            lambda value: session.pictures.set_trait("depth", value),
        )
        hold = _with_icon(action_button("hold_outline", lambda: guard(session.fix_outline)), "hold")
        shows_grids = _with_icon(action_button("thompson", lambda: guard(show_grids)), "grids")
        self._on_picture = [method, hold, shows_grids]  # three pictures of a step in space have their own controls
        self._step = basic.HTML("")
        back = ACTIONS["set_back"]
        self._back = button("\u21a9", f"{back.label}: {back.tooltip}", lambda: guard(session.set_back))
        self.box = row(self._step, side, self._back, method, self._depth, hold, shows_grids)
        self.refresh()

    def _sides(self) -> list[tuple[str, str]]:
        """The menu: the six sides, the oblique views of the document, and for a step in space that."""
        steps, grid = self.session.steps, self.session.editing.grid
        sides = [(side_words(view, is_anatomical=grid.is_anatomical), view) for _, view in PARAMETERS["view"].menu]  # type: ignore[attr-defined]
        views = [(name, f"{_VIEW}{k}") for k, name in enumerate(steps.oblique_views().values())]
        return sides + views + ([_IN_SPACE] if self.session.editing.step.plane is None else [])

    def _side_value(self) -> str:
        """The name of the side in the menu; "" in space, and "view " with a number for oblique planes."""
        steps, plane = self.session.steps, self.session.editing.step.plane
        if plane is None or steps.view is not None:
            return steps.view or ""
        return f"{_VIEW}{list(steps.oblique_views()).index(plane)}"

    def _choose_side(self, value: Any) -> None:
        if value.startswith(_VIEW):
            self.session.set_view(list(self.session.steps.oblique_views())[int(value.removeprefix(_VIEW))])
        elif value:
            self.session.set_view(value)

    def _clipped_depth(self) -> float:
        return float(np.clip(self.session.pictures.depth, *self.session.pictures.depth_range))

    def arrange(self) -> None:
        self._step.value = step_badge(self.session)
        basic.set_visible(self._step, self._step.value)
        low, high = self.session.pictures.depth_range
        if (self._depth.min, self._depth.max) != (low, high):
            self._depth.min, self._depth.max = min(low, self._depth.max), max(high, self._depth.min)
            self._depth.min, self._depth.max, self._depth.step = low, high, self.session.pictures.slices.spacing
        in_space = self.session.editing.step.plane is None
        for widget in self._on_picture:
            basic.set_visible(widget, not (in_space))
        basic.set_visible(self._depth, self.session.pictures.method == "slice" and not in_space)
        basic.set_visible(self._back, not in_space and self.session.steps.view is None)
        fill(self._side, self._sides())


def step_badge(session: Session) -> str:
    """The number of the step that is edited, on its colour; empty while there is only one."""
    count, k = len(session.editing.deformation.steps), session.editing.index
    if count == 1:
        return ""
    title = html.escape(session.steps.titles()[k])
    return (
        f'<span class="dnb-step-badge" title="Step {k + 1} of {count}, {title}, is edited on this picture" '
        f'style="background: {STEP_COLOURS[k % len(STEP_COLOURS)]}">{k + 1}</span>'
    )


class PictureLookPanel(Panel):
    """Picture panel: colour map, the automatic window, and the number of lines of the grid."""

    title = "Picture"

    def __init__(self, session: Session, guard: Guard, editor: Any) -> None:
        super().__init__(session, guard)
        colours = self.add(
            widget_of("colour_map"),
            lambda: session.pictures.colour_map,
            lambda value: session.pictures.set_trait("colour_map", value),
        )
        self._auto = action_button("auto_window", lambda: guard(lambda: session.pictures.set_trait("window", None)))
        density = widget_of("density")
        traitlets.link((editor, "density"), (density, "value"))
        self.box = row(colours, self._auto, density)
        self.refresh()

    def arrange(self) -> None:
        self._auto.disabled = self.session.pictures.window is None


class ChannelsPanel(Panel):
    """Channels panel: visibility, colour and window of each channel that the picture adds up."""

    title = "Channels"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        assert session.channels is not None
        self.rows = [self._row(k, volume) for k, volume in enumerate(session.channels.coloured_channels)]
        words = basic.HTML(
            "The picture adds the channels up in Maximum, Mean and Slice; the volume shows how "
            "bright they are together."
        )
        self.box = column(*self.rows, words)
        self.refresh()

    def _row(self, k: int, volume: Volume) -> ipw.Widget:
        name = volume.name or f"Channel {k + 1}"
        low, high = volume.value_range
        first, last = self.session.pictures.channel_displays[k].window
        low, high = min(low, first), max(high, last)
        shown = self.add(
            basic.Checkbox(
                description=name, indent=False, tooltip=f"Whether {name} is shown", layout=basic.layout(width="140px")
            ),
            lambda: self._display(k).visible,
            lambda on: self.session.pictures.show_channel(k, visible=on),
        )
        colour = self.add(
            basic.ColorPicker(concise=True, tooltip=f"Colour of {name}", layout=basic.layout(width="36px")),
            lambda: _hex(self._display(k).colour),
            lambda value: self.session.pictures.show_channel(k, colour=_rgb(value)),
        )
        window = self.add(
            basic.FloatRangeSlider(
                value=(first, last),
                min=low,
                max=high,
                step=(high - low) / 256,
                readout_format=".0f" if volume.dtype.kind in "iu" else ".4g",
                continuous_update=False,
                tooltip=f"Values of {name} shown black and in its full colour",
                layout=basic.layout(flex="1 1 auto", min_width="0", width="auto"),
            ),
            lambda: self._display(k).window,
            lambda ends: self._set_window(k, ends, (high - low) / 256),
        )
        return column(line(shown, colour, align_items="center"), row(window))

    def _display(self, k: int) -> ChannelDisplay:
        display: ChannelDisplay = self.session.pictures.channel_displays[k]
        return display

    def _set_window(self, k: int, ends: tuple[float, float], least: float) -> None:
        self.session.pictures.show_channel(k, window=(ends[0], max(ends[1], ends[0] + least)))


def _hex(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def _rgb(text: str) -> tuple[float, float, float]:
    """A colour of a colour picker, "#rrggbb"."""
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue


class MapPanel(Panel):
    """Interpolation panel: settings of the fit, but for those in other panels."""

    title = "Interpolation"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        bound = {
            name: self.bind_step(widget_of(name), name)
            for name in OF_THE_FIT
            if name not in ("support", *_STANDING_ELSEWHERE)
        }
        self._kernel, self._trend = bound.pop("kernel"), bound.pop("trend")
        self._support = widget_of(
            "support",
            session.editing.grid.diagonal,
            basic.layout(flex="1 1 auto", min_width="0", width="auto"),
            label="96px",
        )
        self.add(
            self._support,
            self._slider_support,
            lambda value: session.editing.change(kind="support", slides=True, support=float(value)),
        )
        self._auto = widget_of("automatic_support")
        self.add(
            self._auto,
            lambda: not isinstance(session.editing.step.support, float),
            lambda on: session.editing.change(support=None if on else float(self._support.value)),
        )
        self.box = column(row(self._kernel, self._trend), row(self._support, self._auto, *bound.values()))
        self.refresh()

    def _slider_support(self) -> float:
        step, low, high = self.session.editing.step, 10**self._support.min, 10**self._support.max
        support = step.support_for(self.session.editing.points) or lone_support(self.session.editing.grid)
        return float(np.clip(support, low, high))

    def arrange(self) -> None:
        fill(self._kernel, PARAMETERS["kernel"].menu)  # type: ignore[attr-defined]  # some are registered later
        least = KERNELS[self.session.editing.step.kernel].order
        choices = PARAMETERS["trend"].menu  # type: ignore[attr-defined]
        fill(self._trend, [(label, name) for label, name in choices if TRENDS[name].order >= least])


class DisplayPanel(Panel):
    """Display panel of the volume: colours and opacities, clipping, ambient occlusion."""

    title = "Colours and opacity"

    def __init__(self, session: Session, guard: Guard, view: Any, transfer: Any) -> None:
        super().__init__(session, guard)
        self.clip = ClipControls(view if view.has_trait("clip") else None)
        colours = column(transfer, flex="2 1 480px", min_width="0", max_width="720px")
        inside = column(basic.HTML("<b>Clipping</b>"), self.clip, flex="1 1 270px", min_width="0")
        beside = line(colours, inside, flex_flow="row wrap", align_items="flex-start", grid_gap="4px 24px")
        light = [
            self.add(
                widget_of("ambient_occlusion"),
                lambda: session.pictures.ambient_occlusion,
                lambda value: session.pictures.set_trait("ambient_occlusion", value),
            )
        ]
        self.box = column(beside, *(light if view.has_trait("ambient_occlusion") else []))

    def close(self) -> None:
        self.clip.close()


class StrengthPanel(Panel):
    """Strength of the step, and the button that puts all back."""

    title = "Strength"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        strength = widget_of("strength", layout=wide())
        self.add(
            strength,
            lambda: float(np.clip(session.editing.step.strength, strength.min, strength.max)),
            lambda value: session.editing.change(kind="strength", slides=True, strength=float(value)),
        )
        self.box = row(strength, action_button("reset", lambda: guard(session.editing.reset)))


class VolumePanel(Panel):
    """Row over the volume: deformed, original or both, its rendering and preset; or three slices instead.

    Parameters
    ----------
    slices : take the place of the view.
    transfer : the editor of colours and opacities.
    """

    def __init__(self, session: Session, guard: Guard, view: Any, slices: Any, transfer: Any) -> None:
        super().__init__(session, guard)
        shows = self.add(
            widget_of("shows", layout=basic.layout(width="auto")),
            lambda: view.shows,
            lambda value: setattr(view, "shows", value),
        )
        menus = [shows]
        if view.has_trait("projection"):
            menus.append(
                self.add(
                    widget_of("projection", layout=basic.layout(width="auto")),
                    lambda: view.projection,
                    lambda value: view.set_trait("projection", value),
                )
            )
        menus.append(
            self.add(PresetMenu(transfer), lambda: transfer.preset_name, lambda name: _take_preset(session, name))
        )
        parameter = PARAMETERS["slices"]
        button = basic.ToggleButton(
            False, description=parameter.label, tooltip=parameter.tooltip, layout=basic.layout(width="auto")
        )
        _with_icon(button, "slices")
        self._of_view, self._slices = menus, slices
        self.box = row(*menus, self.add(button, lambda: slices.is_visible, slices.show))

    def arrange(self) -> None:
        for widget in self._of_view:  # which is not seen meanwhile
            widget.disabled = self._slices.is_visible


def _take_preset(session: Session, name: str) -> None:
    if name:  # the user's own are those that are there
        session.pictures.transfer = name


class ProgressBar:
    """A progress bar, visible during the work, and the button that stops it.

    Parameters
    ----------
    text, tooltip : of the button; width : of the bar.

    Attributes
    ----------
    bar, stop : the widgets; is_busy : whether work is in progress.

    Examples
    --------
    >>> progress = ProgressBar("Stop", "Stop; nothing is changed", "140px")
    >>> progress.begin()
    >>> progress.stop.click()
    >>> progress.is_busy, progress.is_stopped()
    (True, True)
    """

    def __init__(self, text: str, tooltip: str, width: str) -> None:
        self._stopped = threading.Event()
        self._begun = 0.0
        self.is_busy = False
        self.stop = button(text, tooltip, self._stopped.set)
        self.stop.disabled = True
        self.bar = basic.FloatProgress(min=0.0, max=1.0, layout=basic.layout(width=width, visibility="hidden"))

    def begin(self) -> None:
        """Show the bar, and let the work be stopped."""
        self._stopped.clear()
        self._begun = time.monotonic()
        self.bar.value = 0.0
        self._set_busy(True)

    def end(self) -> None:
        """Hide the bar."""
        self._set_busy(False)

    def _set_busy(self, is_busy: bool) -> None:
        self.is_busy = is_busy
        self.stop.disabled = not is_busy
        basic.set_layout(self.bar, visibility="visible" if is_busy else "hidden")

    def show(self, share: float) -> str:
        """Show the finished share, and return in words how long the rest takes."""
        if abs(share - self.bar.value) > _SHOWN_SHARE or share == 1:  # a message for each would flood the front end
            self.bar.value = share
        return remaining_time(time.monotonic() - self._begun, share)

    def cancel(self) -> None:
        """Stop the work."""
        self._stopped.set()

    def is_stopped(self) -> bool:
        """Check whether the work should stop."""
        return self._stopped.is_set()


class Question:
    """A line with a question before an action, with a button for each answer; hidden while there is none.

    Parameters
    ----------
    guard : runs the confirmed action and shows its errors.

    Attributes
    ----------
    box : the line, empty while there is no question: the question, and the buttons of the answers, of none the last.
    """

    def __init__(self, guard: Guard) -> None:
        self._guard = guard
        self.box = row()
        self.forget()

    def ask(
        self,
        text: str,
        agreement: str,
        action: Callable[[], None],
        others: Mapping[str, Callable[[], None]] | None = None,
    ) -> None:
        """Show a question, and do this if the answer is yes; an earlier question is dropped.

        Parameters
        ----------
        others : further answers by the words of their buttons, and what each of them does.
        """
        self.forget()
        answers = {agreement: action, **(others or {})}
        self.box.children = (
            basic.HTML(
                f'<span role="alert" style="line-height: 1.35">{html.escape(text)}</span>',
                layout=basic.layout(flex="0 1 auto", min_width="0"),  # a label would cut long words
            ),
            *(button(words, words, partial(self._answer, answer)) for words, answer in answers.items()),
            button("Cancel", "Leave everything as it is", self.forget),
        )
        self.box.is_visible = True

    def forget(self) -> None:
        """Remove the question."""
        before, self.box.children, self.box.is_visible = self.box.children, (), False
        close_all(*before)

    @property
    def text(self) -> str:
        """The question; empty for none."""
        return str(self.box.children[0].value) if self.box.children else ""

    def _answer(self, action: Callable[[], None]) -> None:
        self.forget()
        self._guard(action)
