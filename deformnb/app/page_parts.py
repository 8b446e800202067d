"""Sections of the client's drawer: single controls, settings, looks, points, diagnostics, and the history."""

from __future__ import annotations

from typing import Any

from deformnb.app.controls import AbstractControl, Choice, Number, Switch
from deformnb.widgets.studio.panels.depth import HINTS

_GROUPS = (
    ("Picture", ("view", "method", "depth", "show_net", "drag_net", "show_radius")),
    ("Deformation", ("kernel", "trend", "support", "smoothing", "strength")),
    ("Through the depth", ("extrusion",)),
)
_SHOWN_IF = {"depth": "method === 'slice'"}
_OF_THE_DEPTH = (("curve", "extrusion === 'modulate'"), ("keys", "extrusion === 'interpolate'"))
_SAFETY = (
    ("take_back", "Largest safe drag", "Take the last drag, or else the strength, back to where nothing folds"),
    ("unfold", "Unfold by stages", "The same drag in as many stages as leave no fold; all points still meet"),
)
BOX_HINT = "So that nothing is cut off that was dragged out of the volume's box"
_BOX: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
    ("fit_box", "As large as needed", BOX_HINT, {}),
    ("own_box", "The volume's own", "What lies outside of it is cut off", {"v_if": ("box",)}),
)
_SUSPECT_HINT = "Show it: a wrong place, two points swapped, or a drag that its neighbours do not follow"
_GO_HINT = "Click on a state to go there. An edit after an undo begins a branch; what was undone stays, indented."
_STATE = [
    'v-for="s in states"', ':key="s.id"', 'type="button"', ':title="s.tip"', ':aria-current="s.id === state_shown"',
    """@click="trigger('go_to', [s.id])" """, """:style="{ paddingLeft: (6 + 12 * s.indent) + 'px' }" """,
    """:class="['dnb-app-state', s.on ? '' : 'dnb-app-undone']" """,
    # What is shown is scrolled into view whenever the list is drawn: it may be two hundred lines long.
    """:ref="(line) => s.id === state_shown && line?.scrollIntoView({ block: 'nearest' })" """,
]
_TIME = "new Date(1000 * s.time).toLocaleTimeString([], { hourCycle: 'h23' })"


def add_control(v: Any, html: Any, name: str, control: AbstractControl, shown_if: str | None = None) -> None:
    """A control of the table, where ``shown_if`` holds in the client."""
    shown = {"v_if": (shown_if,)} if shown_if else {}
    common = {"density": "compact", "hide_details": True, "color": "primary"}
    if isinstance(control, Choice):
        items = [{"value": value, "title": title} for value, title in control.titles]
        v.VSelect(v_model=(name,), items=(f"dnb_items_{name}", items), label=control.title, variant="outlined",
                  title=control.hint, classes="dnb-app-select", __properties=["title"], **common, **shown)
    elif isinstance(control, Number):
        value = f"{name}.toFixed(2)" if control.step < 1 else f"{name}.toFixed(0)"
        if control.unset:
            value = f"{name} ? {value} : '{control.unset}'"
        with html.Div(classes="dnb-app-number", title=control.hint, **shown):
            html.Span(control.title, classes="dnb-app-label")
            v.VSlider(v_model_number=(name,), min=control.low, max=control.high, step=control.step,
                      aria_label=control.title, start="trigger('take_hold')", track_size=3, thumb_size=14,
                      __properties=["aria_label"], **common)
            html.Span(f"{{{{ {value} }}}}", classes="dnb-app-value")
    elif isinstance(control, Switch):
        v.VCheckbox(v_model=(name,), label=control.title, title=control.hint, __properties=["title"], **common, **shown)


def add_widget(name: str, shown_if: str | None = None) -> None:
    """A widget of :data:`~deformnb.app.parts.WIDGETS`, where ``shown_if`` holds in the client."""
    from trame_client.widgets.core import AbstractElement

    shown = {"v_if": (shown_if,)} if shown_if else {}
    part = AbstractElement("deformnb-widget", name=name, source=f"deformnb/{name}.js", theme=("dnb_theme",), **shown)
    part._attr_names += ["name", "source", "theme"]


def settings_part(v: Any, html: Any, controls: dict[str, AbstractControl]) -> None:
    """Settings of the deformation."""
    for title, names in _GROUPS:
        html.H2(title, classes="dnb-app-group")
        switches = [name for name in names if isinstance(controls[name], Switch)]
        for name in names:
            if name not in switches:
                add_control(v, html, name, controls[name], _SHOWN_IF.get(name))
        if switches:
            with html.Div(classes="dnb-app-switches"):
                for name in switches:
                    add_control(v, html, name, controls[name])
    for name, shown_if in _OF_THE_DEPTH:
        add_widget(name, shown_if)
    html.Div(HINTS["interpolate"], v_if=("extrusion === 'interpolate'",), classes="dnb-app-words")


def look_part(v: Any, html: Any, controls: dict[str, AbstractControl]) -> None:
    """Settings of the volume display, and its clipping."""
    for name in ("shows", "projection"):
        add_control(v, html, name, controls[name])
    html.H2("Colours and opacities", classes="dnb-app-group")
    add_widget("colours")
    html.H2("See inside", classes="dnb-app-group")
    add_widget("clip")


def points_part(v: Any, html: Any, controls: dict[str, AbstractControl]) -> None:
    """The steps, and the points of the one being edited, one below the other."""
    html.H2("Steps", classes="dnb-app-group")
    add_widget("steps")
    v.VBtn("Add step", size="small", variant="tonal", color="primary", block=True, click="trigger('add_step')",
           title="Deform once more from this side, after all other steps", classes="dnb-app-do", __properties=["title"])
    with html.Div(v_if=("several",)):
        add_control(v, html, "mode", controls["mode"])
    html.H2("Points", classes="dnb-app-group")
    add_widget("points")


def trust_part(v: Any, html: Any, controls: dict[str, AbstractControl]) -> None:
    """Figures of the map, points that disagree, and buttons that make it safe."""
    add_control(v, html, "overlay", controls["overlay"])
    html.Div("{{ haze_said }}", v_if=("haze_said",), classes="dnb-app-words")
    html.H2("The map", classes="dnb-app-group")
    html.Div("Looking at the map ...", v_if=("!trust",), classes="dnb-app-words")
    html.Div(v_html=("trust",), classes="dnb-app-facts")  # names of points are escaped in it
    html.Div("{{ suspects_text }}", classes="dnb-app-words")
    with html.Div(classes="dnb-app-suspects", v_if=("suspects.length",)):
        v.VBtn("{{ s.name }}", v_for="s in suspects", key="s.id", size="small", variant="outlined", title=_SUSPECT_HINT,
               click="trigger('look_at', [s.id])", __properties=["title"])
    html.H2("The box of the result", classes="dnb-app-group")
    html.Div("{{ box || 'That of the volume.' }}", classes="dnb-app-words")
    for name, title, hint, shown in _BOX:
        v.VBtn(title, size="small", variant="tonal", color="primary", block=True, click=f"trigger('{name}')",
               title=hint, classes="dnb-app-do", __properties=["title"], **shown)
    html.H2("Without folds", classes="dnb-app-group")
    for name, title, hint in _SAFETY:
        v.VBtn(title, size="small", variant="tonal", color="primary", block=True, click=f"trigger('{name}')",
               title=hint, classes="dnb-app-do", __properties=["title"])
    add_control(v, html, "stages", controls["stages"])
    with html.Div(classes="dnb-app-switches"):
        add_control(v, html, "keep_free", controls["keep_free"])
        add_control(v, html, "show_folds", controls["show_folds"])


def history_part(v: Any, html: Any, controls: dict[str, AbstractControl]) -> None:
    """All states that can be gone to."""
    with html.Div(classes="dnb-app-states"), html.Button(raw_attrs=_STATE):
        html.Span("{{ s.mark }}", classes="dnb-app-mark", raw_attrs=['aria-hidden="true"'])
        html.Span("{{ s.title }}", classes="dnb-app-done")
        html.Span(f"{{{{ s.time ? {_TIME} : '' }}}}", classes="dnb-app-when")
    html.Div(_GO_HINT, classes="dnb-app-words")
