"""Layout of the client: a bar, the picture, the volume, the controls of the table, and a status line below."""

from __future__ import annotations

from typing import Any

from deformnb.app.application import Application
from deformnb.app.files import DOWNLOADS, suffix_of
from deformnb.app.page_sections import (
    add_widget,
    diagnostics_section,
    display_section,
    history_section,
    points_section,
    settings_section,
)
from deformnb.widgets.parameters import ACTIONS
from deformnb.widgets.studio.panels.files import LARGER
from deformnb.widgets.web.remote_area import AREA

_TABS = (("settings", "Fit", settings_section), ("display", "Display", display_section),
         ("points", "Points", points_section), ("diagnostics", "Diagnostics", diagnostics_section),
         ("history", "History", history_section))
_BUTTONS = (("undo", "mdi-undo", "'Undo: ' + undo", "!undo"), ("redo", "mdi-redo", "'Redo: ' + redo", "!redo"),
            ("reset", "mdi-restore", "'Undeformed again'", "!undo && !redo"))
_LOST = (("restore", "Restore", "Go on with it; can be undone"),
         ("skip", "Skip", "Don't show again; it stays in the history"))
_ASKED = (("files.busy", "stop_file", "Stop"), ("files.doubt", "take_anyway", "Open anyway"),
          ("!files.busy", "forget_file", "Close"))
_THEME = "dnb_theme = dnb_theme === 'dark' ? 'light' : 'dark'"
_SAVE = "utils.download(dnb_document, trigger('save'), 'application/json')"


def build_page(server: Any, app: Application) -> None:
    """Give trame's server the page of an application.

    Parameters
    ----------
    server : trame's, before it starts.
    app : whose controls and names are shown.
    """
    from trame.ui.vuetify3 import VAppLayout
    from trame.widgets import html
    from trame_vuetify.widgets import vuetify3 as v

    name = app.session.volume.name or "volume"
    server.enable_module({"scripts": ["deformnb/app.js"], "styles": ["deformnb/app.css", "deformnb/widgets.css"],
                          "vue_use": ["deformnb_app"]})
    state = server.state
    state.trame__title = f"{name} - deformnb"
    state.update({"dnb_theme": "light", "dnb_name": name, "dnb_viewer": app.viewer, "dnb_sure": False,
                  "dnb_tab": _TABS[0][0], "dnb_views": app.volumes.views,
                  "dnb_document": f"{_plain(name)}-session.json"})
    state.trame__client_only = [*state.trame__client_only, "dnb_theme", "dnb_viewer", "dnb_sure", "dnb_tab",
                                "trame_error_report_msg"]
    shapes = " × ".join(str(n) for n in app.session.volume.shape[::-1])
    with VAppLayout(server) as layout:
        layout.root.theme = ("dnb_theme",)
        with v.VAppBar(density="compact", flat=True, classes="dnb-app-bar"):
            html.Div("deformnb", classes="dnb-app-brand")
            html.Div("{{ dnb_name }}", classes="dnb-app-name")
            html.Div(f"{shapes} voxels (x, y, z)", classes="dnb-app-soft")
            v.VSpacer()
            _buttons(v, html)
        with v.VMain(classes="dnb-app-back"), html.Div(classes="dnb-app-main"):
            _lost(v, html)
            with html.Section(classes="dnb-app-half", aria_label="Picture", __properties=["aria_label"]):
                add_widget("editor")
            with html.Section(classes="dnb-app-half", aria_label="Volume", __properties=["aria_label"]):
                _volume(html)
                _cut_off(v, html)
            with html.Aside(classes="dnb-app-panel", aria_label="Settings", __properties=["aria_label"]):
                _drawer(v, html, app)
        with v.VFooter(app=True, classes="dnb-app-foot", role="status", __properties=["role"]):
            html.Span("{{ facts }}")
            html.Span("{{ verdict }}", classes=("folded ? 'dnb-app-folded' : ''",))
            html.Span("{{ latency }}", classes="dnb-app-soft")
            html.Span("{{ notice }}", classes="dnb-app-notice", title=("notice",), __properties=["title"])
        _writing(v, html)
        with html.Div(classes="dnb-app-error", v_if=("error",), role="alert", __properties=["role"]):
            html.Span("{{ error }}")


def _lost(v: Any, html: Any) -> None:
    """Offer to a user who opens a volume on which something was lost."""
    with html.Div(classes="dnb-app-lost", v_if=("lost",), role="status", __properties=["role"]):
        html.Span("{{ lost }}")
        for name, title, hint in _LOST:
            v.VBtn(title, size="small", variant="flat" if name == "restore" else "text", color="primary",
                   click=f"trigger('{name}')", title=hint, __properties=["title"])
        v.VBtn("{{ dnb_sure ? 'Delete for good?' : 'Delete' }}", size="small", variant="text", color="primary",
               click="dnb_sure ? trigger('delete') : 0; dnb_sure = !dnb_sure", title="Remove its file",
               __properties=["title"])


def _cut_off(v: Any, html: Any) -> None:
    """A warning over the foot of the volume, so that no picture changes its size under the pointer."""
    with html.Div(classes="dnb-app-cut", role="status", __properties=["role"]):
        html.Span("{{ cut_off }}", v_if=("cut_off",))
        v.VBtn(LARGER[0], v_if=("cut_off",), size="small", variant="flat", color="primary", click="trigger('fit_box')",
               title=ACTIONS["fit_box"].tooltip, __properties=["title"])


def _volume(html: Any) -> None:
    from trame_client.widgets.core import AbstractElement
    from trame_rca.widgets import rca

    with html.Div(v_if=("dnb_viewer === 'live'",), classes="dnb-app-fill"):
        add_widget("live")
    with html.Div(v_else=True, classes="dnb-app-fill dnb-app-remote"):
        html.Div("VTK draws the first picture …", classes="dnb-app-waiting")
        rca.RemoteControlledArea(name=AREA, display="image", image_style=("dnb_image", {"width": "100%"}))
        AbstractElement("deformnb-remote", area=AREA, views=("dnb_views",))._attr_names.extend(["area", "views"])


def _buttons(v: Any, html: Any) -> None:
    for name, icon, title, disabled in _BUTTONS:
        v.VBtn(icon=icon, size="small", variant="text", click=f"trigger('{name}')", disabled=(disabled,),
               title=(title,), aria_label=(title,), __properties=["title", "aria_label"])
    v.VDivider(vertical=True, inset=True, classes="mx-2")
    v.VBtn("From the picture's side", prepend_icon="mdi-eye-outline", size="small", variant="text",
           click="trigger('front')", title="Look at the volume from where the picture was taken",
           __properties=["title"])
    _files(v, html)
    v.VBtn("Save", prepend_icon="mdi-content-save-outline", size="small", variant="tonal", color="primary", click=_SAVE,
           title="Save the session as a file", __properties=["title"])
    v.VBtn(icon=("dnb_theme === 'dark' ? 'mdi-weather-sunny' : 'mdi-weather-night'",), size="small", variant="text",
           click=_THEME, title="Light or dark", aria_label="Light or dark", classes="ml-1",
           __properties=["title", "aria_label"])


def _files(v: Any, html: Any) -> None:
    """A menu of files to take home, and a saved session to go on with."""
    from trame_client.widgets.core import AbstractElement

    part = AbstractElement("deformnb-files", files=("files",), raw_attrs=['v-slot="{ write, open }"'])
    part._attr_names += ["files"]
    with part:
        v.VBtn(icon="mdi-folder-open-outline", size="small", variant="text", click="open()",
               title="Open a session file", aria_label="Open a session file", __properties=["title", "aria_label"])
        with v.VMenu():
            with v.Template(v_slot_activator="{ props }"):
                v.VBtn("Export", v_bind="props", prepend_icon="mdi-download", size="small", variant="text",
                       disabled=("files.busy",), title="Write a file and download it",
                       __properties=["title"])
            with v.VList(density="compact"):
                for kind, title in DOWNLOADS.items():
                    v.VListItem(title=f"{title} ({suffix_of(kind)})", click=f"write('{kind}')")


def _writing(v: Any, html: Any) -> None:
    """File being written, and the question before a session of another volume is opened."""
    with html.Div(classes="dnb-app-lost dnb-app-file", v_if=("files.message || files.doubt",), role="status",
                  __properties=["role"]):
        html.Span("{{ files.doubt || files.message }}")
        v.VProgressLinear(v_if=("files.busy",), model_value=("100 * files.share",), height=6, rounded=True,
                          color="primary", classes="dnb-app-share", aria_label="written", __properties=["aria_label"])
        for shown, name, title in _ASKED:
            v.VBtn(title, v_if=(shown,), size="small", variant="text", color="primary", click=f"trigger('{name}')")


def _drawer(v: Any, html: Any, app: Application) -> None:
    with v.VTabs(v_model=("dnb_tab",), density="compact", grow=True, color="primary", classes="dnb-app-tabs"):
        for name, title, _ in _TABS:
            v.VTab(title, value=name, id=f"dnb-app-tab-{name}", __properties=["id"])
    for name, _, part in _TABS:
        with html.Div(v_if=(f"dnb_tab === '{name}'",), classes="dnb-app-part", role="tabpanel",
                      aria_labelledby=f"dnb-app-tab-{name}", __properties=["role", "aria_labelledby"]):
            part(v, html, app.parameters)


def _plain(name: str) -> str:
    """A file name of letters that every system takes."""
    stem = name.split(".", maxsplit=1)[0]
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in stem)[:80] or "volume"
