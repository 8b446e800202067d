"""Sections of the client's drawer: single controls, settings, display, points, diagnostics, and the history."""

from __future__ import annotations

import math
from typing import Any

from deformnb.widgets.parameters import ACTIONS, OF_THE_FIT, PARAMETERS, AbstractParameter, Choice, Number, Switch
from deformnb.widgets.studio.panels.depth import HINTS

_GROUPS = (
    ("Picture", ("view", "method", "depth", "show_grid", "drag_grid", "show_radius")),
    ("Deformation", tuple(name for name in OF_THE_FIT if name != "stages")),  # they stand beside the folds
    ("Through the depth", ("extrusion",)),
)
_BESIDE = {"support": "automatic_support"}  # a switch in the row of a slider
_SHOWN_IF = {"depth": "method === 'slice'"}
_OF_THE_DEPTH = (("curve", "extrusion === 'modulate'"), ("keys", "extrusion === 'interpolate'"))
_GO_HINT = "Click on a state to go there. An edit after an undo begins a branch; what was undone stays, indented."
_STATE = [
    'v-for="s in states"', ':key="s.id"', 'type="button"', ':title="s.tip"', ':aria-current="s.id === state_shown"',
    """@click="trigger('go_to', [s.id])" """, """:style="{ paddingLeft: (6 + 12 * s.indent) + 'px' }" """,
    """:class="['dnb-app-state', s.on ? '' : 'dnb-app-undone']" """,
    # What is shown is scrolled into view whenever the list is drawn: it may be two hundred lines long.
    """:ref="(line) => s.id === state_shown && line?.scrollIntoView({ block: 'nearest' })" """,
]
_TIME = "new Date(1000 * s.time).toLocaleTimeString([], { hourCycle: 'h23' })"


def add_control(v: Any, html: Any, name: str, control: AbstractParameter, shown_if: str | None = None,
                beside: str | None = None) -> None:
    """A control of the table, where ``shown_if`` holds in the client; ``beside`` is a switch in the row of a slider."""
    shown = {"v_if": (shown_if,)} if shown_if else {}
    common = {"density": "compact", "hide_details": True, "color": "primary"}
    if isinstance(control, Choice):
        items = [{"value": value, "title": title} for value, title in control.options]
        v.VSelect(v_model=(name,), items=(f"dnb_items_{name}", items), label=control.label, variant="outlined",
                  title=control.tooltip, classes="dnb-app-select", __properties=["title"], **common, **shown)
    elif isinstance(control, Number):
        low, high, value = control.low, control.high, f"{name}.toFixed({control.digits})"
        bound: dict[str, Any] = {"v_model_number": (name,)}
        if control.is_log:
            low, high, value = math.log10(low), math.log10(high), f"Number({name}.toPrecision({control.digits}))"
            bound = {"model_value": (f"Math.log10({name})",), "update_modelValue": f"{name} = 10 ** $event"}
        with html.Div(classes="dnb-app-number", title=control.tooltip, **shown):
            html.Span(control.label, classes="dnb-app-label")
            v.VSlider(min=low, max=high, step=control.step, aria_label=control.label, start="trigger('take_hold')",
                      track_size=3, thumb_size=14, __properties=["aria_label"], **bound, **common)
            html.Span(f"{{{{ {value} }}}}", classes="dnb-app-value")
            if beside:
                switch = PARAMETERS[beside]
                v.VCheckboxBtn(v_model=(beside,), title=switch.tooltip, aria_label=switch.label, density="compact",
                               color="primary", inline=True, __properties=["title", "aria_label", "inline"])
    elif isinstance(control, Switch):
        v.VCheckbox(v_model=(name,), label=control.label, title=control.tooltip, __properties=["title"], **common,
                    **shown)


def add_action(v: Any, name: str, **more: Any) -> None:
    """The button for an action of :data:`~deformnb.widgets.parameters.ACTIONS`."""
    action = ACTIONS[name]
    v.VBtn(action.label, size="small", variant="tonal", color="primary", block=True, click=f"trigger('{name}')",
           title=action.tooltip, classes="dnb-app-do", __properties=["title"], **more)


def add_widget(name: str, shown_if: str | None = None) -> None:
    """A widget of :data:`~deformnb.app.panel_widgets.WIDGETS`, where ``shown_if`` holds in the client."""
    from trame_client.widgets.core import AbstractElement

    shown = {"v_if": (shown_if,)} if shown_if else {}
    part = AbstractElement("deformnb-widget", name=name, source=f"deformnb/{name}.js", theme=("dnb_theme",), **shown)
    part._attr_names += ["name", "source", "theme"]


def settings_section(v: Any, html: Any, controls: dict[str, AbstractParameter]) -> None:
    """Settings of the deformation."""
    for title, names in _GROUPS:
        html.H2(title, classes="dnb-app-group")
        switches = [name for name in names if isinstance(controls[name], Switch)]
        for name in names:
            if name not in switches:
                add_control(v, html, name, controls[name], _SHOWN_IF.get(name), _BESIDE.get(name))
        if switches:
            with html.Div(classes="dnb-app-switches"):
                for name in switches:
                    add_control(v, html, name, controls[name])
    for name, shown_if in _OF_THE_DEPTH:
        add_widget(name, shown_if)
    html.Div(HINTS["interpolate"], v_if=("extrusion === 'interpolate'",), classes="dnb-app-words")


def display_section(v: Any, html: Any, controls: dict[str, AbstractParameter]) -> None:
    """Settings of the volume display, and its clipping."""
    for name in ("shows", "projection"):
        add_control(v, html, name, controls[name])
    html.H2("Colours and opacities", classes="dnb-app-group")
    add_widget("colours")
    html.H2("Clipping", classes="dnb-app-group")
    add_widget("clip")


def points_section(v: Any, html: Any, controls: dict[str, AbstractParameter]) -> None:
    """The steps, and the points of the one being edited, one below the other."""
    html.H2("Steps", classes="dnb-app-group")
    add_widget("steps")
    add_action(v, "add_step")
    with html.Div(v_if=("several",)):
        add_control(v, html, "mode", controls["mode"])
    html.H2("Points", classes="dnb-app-group")
    add_widget("points")


def diagnostics_section(v: Any, html: Any, controls: dict[str, AbstractParameter]) -> None:
    """Figures of the map, possible outliers, and buttons that make it fold-free."""
    add_control(v, html, "overlay", controls["overlay"])
    html.Div("{{ uncertainty_said }}", v_if=("uncertainty_said",), classes="dnb-app-words")
    html.H2("The map", classes="dnb-app-group")
    html.Div("Computing diagnostics ...", v_if=("!diagnostics",), classes="dnb-app-words")
    html.Div(v_html=("diagnostics",), classes="dnb-app-facts")  # names of points are escaped in it
    html.Div("{{ suspects_text }}", classes="dnb-app-words")
    with html.Div(classes="dnb-app-suspects", v_if=("suspects.length",)):
        v.VBtn("{{ s.name }}", v_for="s in suspects", key="s.id", size="small", variant="outlined",
               title=ACTIONS["look_at"].tooltip, click="trigger('look_at', [s.id])", __properties=["title"])
    html.H2("The box of the result", classes="dnb-app-group")
    html.Div("{{ box || 'That of the volume.' }}", classes="dnb-app-words")
    add_action(v, "fit_box")
    add_action(v, "own_box", v_if=("box",))
    html.H2("Without folds", classes="dnb-app-group")
    add_action(v, "take_back")
    add_action(v, "unfold")
    add_control(v, html, "stages", controls["stages"])
    with html.Div(classes="dnb-app-switches"):
        add_control(v, html, "keep_free", controls["keep_free"])
        add_control(v, html, "show_folds", controls["show_folds"])


def history_section(v: Any, html: Any, controls: dict[str, AbstractParameter]) -> None:
    """All states that can be gone to."""
    with html.Div(classes="dnb-app-states"), html.Button(raw_attrs=_STATE):
        html.Span("{{ s.mark }}", classes="dnb-app-mark", raw_attrs=['aria-hidden="true"'])
        html.Span("{{ s.title }}", classes="dnb-app-done")
        html.Span(f"{{{{ s.time ? {_TIME} : '' }}}}", classes="dnb-app-when")
    html.Div(_GO_HINT, classes="dnb-app-words")
