"""Parameters that a user sets: label, tooltip, range and choices of each, in one table for all front ends.

The studio makes ipywidgets of it, the exported page plain HTML controls (it gets the table as JSON), and
``docs/parameters.md`` is written from it (:mod:`deformnb.widgets.generate`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from deformnb.document.deformation import MODES, STEP_LABELS
from deformnb.imaging.projection import PROJECTIONS
from deformnb.rbf.cuts import CUT_RULES
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.fit_settings import SETTINGS
from deformnb.rbf.forward import DIRECTIONS
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.stages import MOST_STAGES
from deformnb.rbf.trends import TRENDS
from deformnb.volume.colour_maps import COLOUR_MAPS
from deformnb.volume.views import SIDES
from deformnb.widgets.camera import SHOWS
from deformnb.widgets.messages.traits import OVERLAYS

PAGE_CONTROLS = {
    "strength": "Strength",
    "kernel": "Kernel",
    "shows": "Compare",
    "density": "Grid",
    "reset": "Reset",
    "download": "Download points",
    "clip": "Clipping",
}
"""Controls of an exported page by name, with their labels."""


@dataclass(frozen=True)
class AbstractParameter(ABC):
    """One thing to set.

    Parameters
    ----------
    label : shown next to it.
    tooltip : one sentence that explains it.
    """

    label: str
    tooltip: str = ""

    @property
    @abstractmethod
    def values(self) -> str:
        """The values that it takes, in words."""


@dataclass(frozen=True)
class Choice(AbstractParameter):
    """One of several names.

    Parameters
    ----------
    registry : the names; those that are registered later are offered too.
    labels : of the names; a name without one has the title of its object, or itself.
    """

    registry: Iterable[str] = ()
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def options(self) -> list[tuple[str, str]]:
        """Pairs of name and label."""
        return [(name, self._label(name)) for name in self.registry]

    def _label(self, name: str) -> str:
        if name in self.labels:
            return self.labels[name]
        title = getattr(self.registry[name], "title", None) if isinstance(self.registry, Mapping) else None
        words = title if isinstance(title, str) else name.replace("_", " ")
        return words[:1].upper() + words[1:]

    @property
    def values(self) -> str:
        return ", ".join(label for _, label in self.options)

    @property
    def menu(self) -> list[tuple[str, str]]:
        """The options as ipywidgets takes them: label before name."""
        return [(label, name) for name, label in self.options]


@dataclass(frozen=True)
class Number(AbstractParameter):
    """A number between two others.

    Parameters
    ----------
    low, high, step : range and step of a slider; of the decimal logarithm, if ``is_log``.
    unit : of the number, in words; "diagonal" means shares of the volume's diagonal, which :func:`parameters` makes
        lengths.
    digits : behind the point; a number without any is whole.
    """

    low: float = 0.0
    high: float = 1.0
    step: float = 0.01
    unit: str = ""
    digits: int = 2
    is_log: bool = False

    @property
    def values(self) -> str:
        unit = {"diagonal": " times the volume's diagonal", "": ""}.get(self.unit, f" {self.unit}")
        return f"{self.low:g} to {self.high:g}{unit}" + (", on a logarithmic scale" if self.is_log else "")


@dataclass(frozen=True)
class Switch(AbstractParameter):
    """On or off."""

    @property
    def values(self) -> str:
        return "on, off"


@dataclass(frozen=True)
class Action:
    """A button: its label, and its effect."""

    label: str
    tooltip: str


def _label(name: str) -> str:
    """Label of a field of a step: its name in plain English."""
    return STEP_LABELS[name].capitalize()


PARAMETERS: dict[str, AbstractParameter] = {
    # Picture
    "view": Choice(
        "Side",
        "Where the picture is seen from; another side of a picture on which something was dragged begins a new step",
        SIDES,
        SIDES,
    ),
    "method": Choice("Projection", "Reduction of the depth to a picture", PROJECTIONS),
    "depth": Number("Slice", "Depth of the slice: 0 in front, 1 at the back", 0.0, 1.0, 0.005),
    "colour_map": Choice(
        "Colour map",
        "Colours of the grey values from black to white of the window; the bar next to "
        "the picture has the values, and handles that change the window",
        COLOUR_MAPS,
    ),
    "density": Number(
        "Grid", "Cells of the grid along the longer side of the picture; 0 for none", 0, 64, 1, "cells", 0
    ),
    "show_grid": Switch("Grid", "A grid that bends with the picture"),
    "drag_grid": Switch("Drag grid", "The nodes of the grid can be dragged: each becomes a point"),
    "show_radius": Switch("Radii", "The support radius of each point: how far it reaches"),
    "overlay": Choice(
        "Overlay",
        "Overlay on the picture; the key V cycles through them",
        OVERLAYS,
        {"folds": "Folds (red)", "area": "Area (green grows, purple shrinks)", "strain": "Principal strains"},
    ),
    # Interpolation
    "kernel": Choice(
        _label("kernel"),
        "How the influence of a point fades with distance; Wendland kernels end at the support radius",
        KERNELS,
    ),
    "trend": Choice(
        _label("trend"), "What all points do together (shift, turn, stretch), before the rest bends", TRENDS
    ),
    "support": Number(_label("support"), "How far a point reaches", 0.02, 4.0, 0.01, "diagonal", 3, is_log=True),
    "automatic_support": Switch("Automatic", "The points choose the support radius"),
    "smoothing": Number(
        _label("smoothing"), "0 meets every point; more is smoother and lets them miss", 0.0, 2.0, 0.01
    ),
    "strength": Number(
        _label("strength"),
        "1 as dragged, 0 not at all, more exaggerates, less than 0 in the opposite direction",
        -1.0,
        3.0,
        0.01,
    ),
    "stages": Number(
        _label("stages"),
        "Small maps applied one after the other; with more, longer drags are free of folds, and it takes longer",
        1,
        MOST_STAGES,
        1,
        digits=0,
    ),
    "direction": Choice(
        _label("direction"),
        "Backward fits where the result comes from; forward fits where the points go, and that map is inverted",
        DIRECTIONS,
    ),
    "keep_chosen": Switch("Chosen", "After every edit of the points, choose the fit that predicts them best"),
    "keep_free": Switch("Keep fold-free", "After every edit, choose the stages that leave no fold"),
    # In space
    "extrusion": Choice(
        _label("extrusion"),
        "Extrusion of the displacement of the picture into the depth",
        EXTRUSIONS,
        {
            "replicate": "Replicate: same at all depths",
            "modulate": "Modulate: times a curve f(z)",
            "interpolate": "Interpolate: between key pictures",
        },
    ),
    "mode": Choice(
        "Steps",
        "Composed in order each step deforms the result of those before; added up their displacements are summed",
        MODES,
        {"compose": "Compose in order", "blend": "Add up"},
    ),
    "cut_rule": Choice(
        "Sides seen",
        "The side that is visible where the two sides of a cut overlap",
        CUT_RULES,
        {"source": "Wherever they moved", "paper": "Own side only (paper)"},
    ),
    # Volume
    "projection": Choice(
        "Rendering", "How the volume is drawn", ("shaded", "composite", "mip"), {"mip": "Maximum (MIP)"}
    ),
    "shows": Choice(
        "Compare",
        "; ".join(f"{name.replace('_', ' ')}: {text}" for name, text in SHOWS.items())
        + "; the picture does the same, except two side by side or alternating",
        SHOWS,
    ),
    "movie_renderer": Choice(
        "Drawn by",
        "Renderer of the frames of a movie: the browser, as in its view, or "
        "Python; automatic takes the page where it has a graphics card",
        ("automatic", "page", "python"),
        {"automatic": "Automatic", "page": "This view", "python": "Python"},
    ),
    "slices": Switch(
        "Slices", "Three linked slices of the deformed volume in the place of the view; drag the cross-hair"
    ),
    "ambient_occlusion": Switch(
        "Ambient occlusion",
        "Hollows and deep places are darker, where the browser draws the volume shaded; VTK's pictures have none",
    ),
    "plane_frame": Switch(
        "Frame", "The frame of the picture in the volume: where its plane lies, and which direction is up"
    ),
    "show_folds": Switch("Folds in the volume", "Red stripes on tissue that is shown twice"),
}
"""All parameters by name; lengths are shares of the volume's diagonal."""

OF_THE_FIT = tuple(name for name in PARAMETERS if name in SETTINGS)
"""Settings of the fit that a user sets, in the order in which front ends show them."""

ACTIONS: dict[str, Action] = {
    "reset": Action("Reset", "The volume as it was, without points and steps; can be undone"),
    "hold_outline": Action(
        "Hold outline",
        "Points that stay along the outline: a drag then bends only the tissue around it, and not the whole body",
    ),
    "thompson": Action(
        "Grids",
        "Thompson's grids and your own: the picture on a regular grid next to the deformed one, "
        "whose nodes can be dragged",
    ),
    "auto_window": Action(
        "Automatic window", "Black and white of the picture from its values, instead of those set manually"
    ),
    "edit_view": Action(
        "Edit this view", "Edit on the picture that the volume shows now, from wherever it is turned to (key E there)"
    ),
    "set_back": Action("Set back", "The nearest of the six sides again, in place of this oblique view"),
    "turn_view": Action("Turn", "Edit on a picture that is turned by these angles"),
    "add_step": Action("Add step", "Deform once more from this side, after all other steps"),
    "take_back": Action("Limit to fold-free", "Take the last drag, or else the strength, back to where nothing folds"),
    "unfold": Action(
        "Unfold by stages", "The same drag in as many stages as leave no fold; every point still comes to its target"
    ),
    "best_prediction": Action(
        "Best prediction",
        "Choose kernel, trend, support radius, smoothing and direction of the "
        "fit by how well it predicts points that are left out",
    ),
    "fit_box": Action("As large as needed", "A box that contains all tissue dragged out of the volume's box"),
    "own_box": Action("The volume's own", "Tissue outside it is cut off"),
    "look_at": Action("", "Show it: a wrong place, two points swapped, or a drag that its neighbours do not follow"),
}
"""Buttons that several front ends have, by the name of their action."""


def parameters(diagonal: float) -> dict[str, AbstractParameter]:
    """The table for a volume, lengths in its unit.

    Parameters
    ----------
    diagonal : of the volume.

    Examples
    --------
    >>> parameters(100.0)["support"].high
    400.0
    """
    return {
        name: replace(p, low=p.low * diagonal, high=p.high * diagonal, unit="")
        if isinstance(p, Number) and p.unit == "diagonal"
        else p
        for name, p in PARAMETERS.items()
    }


def as_json(names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Some parameters as a front end without Python gets them.

    Examples
    --------
    >>> as_json(("smoothing",))["smoothing"]["high"]
    2.0
    """

    def plain(parameter: AbstractParameter) -> dict[str, Any]:
        if isinstance(parameter, Choice):
            return {"label": parameter.label, "tooltip": parameter.tooltip, "options": parameter.options}
        return dict(vars(parameter))

    return {name: plain(PARAMETERS[name]) for name in names}


def as_markdown() -> str:
    """The page of the documentation as Markdown."""
    rows = [f"| `{name}` | {p.label} | {p.values} | {p.tooltip}. |" for name, p in PARAMETERS.items()]
    buttons = [f"| `{name}` | {a.label} | {a.tooltip}. |" for name, a in ACTIONS.items() if a.label]
    about = (
        "What can be set in the studio and, partly, in an exported page, by the names that "
        "code uses. This page is written by `python -m deformnb.widgets.generate`."
    )
    lines = [
        "# Parameters",
        "",
        about,
        "",
        "| name | label | values | |",
        "|---|---|---|---|",
        *rows,
        "",
        "## Buttons",
        "",
        "| name | label | |",
        "|---|---|---|",
        *buttons,
    ]
    return "\n".join(lines) + "\n"
