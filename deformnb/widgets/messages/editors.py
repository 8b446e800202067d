"""Messages of the editors of control points: on a picture and in space."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args

from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec.structs import force_setattr

from deformnb.rbf.regions import MaskForm
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.stages import MOST_STAGES
from deformnb.widgets.messages.points import Points
from deformnb.widgets.messages.record import (
    LONGEST_EDIT,
    Buffers,
    Channel,
    Counted,
    Finite,
    Fragment,
    Message,
    Place2,
    Place3,
    Seen,
    View,
    Views,
    Whole,
    Window,
)
from deformnb.widgets.messages.shapes import Motion, ShapeKind, Shapes, checked_shapes

Kind: TypeAlias = Literal[
    "move",
    "nudge",
    "add",
    "remove",
    "rename",
    "switch",
    "reset",
    "undo",
    "redo",
    "several",
    "lock",
    "turn",
    "scale",
    "brush",
    "open",
    "straighten",
    "apart",
]
"""Kinds of edits of points; "several" is more than one of them, which a busy kernel gets as one."""

KINDS = get_args(Kind)

SliceProjection: TypeAlias = Literal["slice", "mip", "composite", "shaded"]
"""Contents of the three pictures of an editor in space."""

WINDOWS_AROUND = 16
"""Widths of the window on either side of it that an editor's picture resolves: 65536 / 33 leave it 2000 steps."""

MOST_CHANGES = 50
"""Pixels by which the wand's region grows or shrinks at most, and the most often that it is smoothed."""

LONGEST_KIND = 80
"""Characters that describe an edit of shapes at most."""

_Words = Annotated[str, Meta(min_length=1, max_length=LONGEST_KIND)]


class FromWindow(Message, frozen=True, kw_only=True):
    """Any message of a window that shows the editor; ``seq`` counts those of a sender."""

    sender: Window
    seq: Counted


class Greeting(FromWindow, frozen=True, kw_only=True, tag="greet"):
    """A new front end; done answers it: Python receives."""


class MovedPart(Struct, frozen=True, kw_only=True):
    """A rigid part that is being dragged."""

    index: Annotated[Whole, Meta(description="its place among the parts")]
    motion: Annotated[Motion | None, Meta(description="null at rest")] = None


class FitChange(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Settings of the fit that an edit of points changes with them."""

    support: Annotated[
        Annotated[float, Meta(gt=0, lt=1e300)] | UnsetType | None, Meta(description="null is chosen by the points")
    ] = UNSET
    stages: Annotated[Annotated[int, Meta(ge=1, le=MOST_STAGES)] | UnsetType, Meta(description="their number")] = UNSET

    def as_dict(self) -> dict[str, Any]:
        """The settings that are changed, by the names of a step."""
        given = {"support": self.support, "stages": self.stages}
        return {name: value for name, value in given.items() if value is not UNSET}


class PointsEdit(FromWindow, frozen=True, kw_only=True, tag="edit"):
    """Control points that are being dragged or were edited."""

    phase: Annotated[Literal["move", "end"], Meta(description='"move" while something is dragged')]
    kind: Annotated[Kind, Meta(description="kind of the edit")]
    joins: Annotated[bool, Meta(description="whether it is one step of an undo with the edit before it")] = False
    next_id: Annotated[Whole, Meta(description="least id that was never given")] = 0
    points: Annotated[Points, Meta(description="all points after the edit")]
    part: Annotated[MovedPart | None, Meta(description="a rigid part that is being dragged")] = None
    fit: Annotated[FitChange | None, Meta(description="settings of the fit that the edit changes too")] = None
    drawn: Annotated[
        Any,
        Meta(
            description="hz, pictures per second of the drag that ends, and ms, milliseconds to a picture",
            extra={"typescript": "Record<string, number>"},
        ),
    ] = None

    def with_part(self, parts: tuple[RigidPart, ...]) -> tuple[RigidPart, ...]:
        """The rigid parts, that which is being dragged with its motion of now."""
        if self.part is None or self.part.index >= len(parts):
            return parts
        index, motion = self.part.index, self.part.motion
        return (*parts[:index], replace(parts[index], motion=motion), *parts[index + 1 :])


class ShapesEdit(FromWindow, frozen=True, kw_only=True, tag="shapes"):
    """Cuts or rigid parts that were edited."""

    what: ShapeKind
    kind: Annotated[_Words, Meta(description='name of the edit, such as "add cut"')]
    shapes: Annotated[Shapes, Meta(description="all shapes of that sort")]
    points: Annotated[Points | None, Meta(description="all points, where the edit has changed them")] = None
    joins: Annotated[bool, Meta(description="whether such edits in quick succession are one step of an undo")] = False

    def __post_init__(self) -> None:
        force_setattr(self, "shapes", Shapes(checked_shapes(self.what, self.shapes)))


class DrawnPart(FromWindow, frozen=True, kw_only=True, tag="part"):
    """A rigid part that was drawn in the slices; the traits parts and chosen_shape have it then."""

    form: Annotated[MaskForm, Meta(description="of its region")]
    middle: Annotated[Place3, Meta(description="of its region, (x, y, z)")]
    radii: Annotated[Place3, Meta(description="half its lengths along u, v and n of the first of panes")]


class ShapeChoice(FromWindow, frozen=True, kw_only=True, tag="choose"):
    """A cut or rigid part that was chosen."""

    what: Annotated[ShapeKind | None, Meta(description="null for none")]
    index: Annotated[Whole, Meta(description="place in the front end's list")] = 0
    shape: Annotated[
        dict[str, Any],
        Meta(
            description="the shape without the pixels of a mask: its place may be another one by now",
            extra={"typescript": "object"},
        ),
    ] = {}  # noqa: RUF012  # a Struct copies it


class HistoryRequest(FromWindow, frozen=True, kw_only=True, tag="history"):
    """A request to undo or redo, where Python owns the history."""

    way: Literal["undo", "redo"]


class EditDone(FromWindow, frozen=True, kw_only=True, tag="done"):
    """Confirmation of a message, after all callbacks have run."""


class EditRefused(Message, frozen=True, kw_only=True, tag="error"):
    """A refusal or a failure."""

    message: Annotated[str, Meta(description="why")]


class WandRequest(Message, frozen=True, kw_only=True, tag="wand"):
    """A use of the wand; the trait wand has the answer."""

    what: Annotated[Literal["preview", "part", "cut", "stop"], Meta(description="what becomes of it")]
    place: Annotated[Place2, Meta(description="that was clicked, of the original picture")]
    tolerance: Annotated[float, Meta(ge=0, lt=1e300, description="in the unit of the picture's values")]
    rule: Annotated[Literal["near", "brighter", "darker"], Meta(description="which values are selected")]
    through: Annotated[bool, Meta(description="whether in the volume instead of in the picture")]
    fill: Annotated[bool, Meta(description="whether holes are filled")] = True
    smooth: Annotated[int, Meta(ge=0, le=MOST_CHANGES, description="how often the outline is smoothed")] = 0
    grow: Annotated[
        int, Meta(ge=-MOST_CHANGES, le=MOST_CHANGES, description="pixels by which it grows, or shrinks below 0")
    ] = 0
    largest: Annotated[bool, Meta(description="whether only the largest piece is kept")] = False


class LargerBoxRequest(Message, frozen=True, kw_only=True, tag="larger_box"):
    """A request for a box of the result that holds all tissue."""


MOST_NAMED = 64
"""Points at most that a message of a pointer names."""

_Ids = Annotated[list[Whole], Meta(max_length=MOST_NAMED)]


class WindowPointer(Message, frozen=True, kw_only=True, tag="pointer"):
    """The pointer of a window, which all windows that show the editor receive."""

    window: Window
    at: Annotated[Place2 | None, Meta(description="on the picture; null away from it")] = None
    drags: Annotated[_Ids, Meta(description="ids of the points that it is dragging")] = []  # noqa: RUF012
    moved: Annotated[_Ids, Meta(description="ids of the points that it has moved now")] = []  # noqa: RUF012
    leaves: Annotated[bool, Meta(description="whether it is being closed")] = False


class DrawShape(Message, frozen=True, kw_only=True, tag="draw"):
    """Start drawing a shape."""

    tool: Literal["cut", "part", "fixed"]


class ProposedParts(Message, frozen=True, kw_only=True, tag="parts"):
    """Other rigid parts that control points contradict: the user decides what to do with those."""

    parts: Annotated[list[dict[str, Any]], Meta(description="all parts", extra={"typescript": "PartData[]"})]
    kind: Annotated[str, Meta(description="name of the edit")]


class ShowPoint(Message, frozen=True, kw_only=True, tag="look"):
    """Center a point."""

    id: Annotated[Whole, Meta(description="of the point")]


class ShowPart(Message, frozen=True, kw_only=True, tag="see"):
    """Show a part of the picture, or all of it."""

    middle: Annotated[list[float] | None, Meta(description="place in the middle of the view; null for all of it")]
    scale: Annotated[float, Meta(description="CSS pixels of a unit of length")] = 1.0


class PicturesWanted(Message, frozen=True, kw_only=True, tag="hello"):
    """A new front end, which needs all pictures."""

    view: View


class SlicesMoved(Message, frozen=True, kw_only=True, tag="look"):
    """The place or the contents of the slices were changed."""

    view: View
    cursor: Annotated[Place3 | UnsetType, Meta(description="(x, y, z)")] = UNSET
    projection: SliceProjection | UnsetType = UNSET
    original: Annotated[bool | UnsetType, Meta(description="whether the volume is shown without deformation")] = UNSET
    window: Annotated[
        Annotated[list[Finite], Meta(max_length=2, extra={"typescript": "[number, number] | []"})] | UnsetType,
        Meta(description="values that are black and white; empty for the automatic ones"),
    ] = UNSET
    moving: Annotated[bool, Meta(description="whether the movement continues: with fewer pixels")] = False


class PaneContent(Struct, frozen=True, kw_only=True):
    """One of the three pictures."""

    index: Annotated[int, Meta(description="which")]
    shape: Annotated[list[int], Meta(description="rows and columns", extra={"typescript": "[number, number]"})]
    spacing: Annotated[list[float], Meta(extra={"typescript": "[number, number]"})]
    origin: Annotated[list[float], Meta(extra={"typescript": "[number, number]"})]
    channels: Annotated[int, Meta(description="1 for grey values, 3 for colours")]
    hasDepths: Annotated[bool, Meta(description="whether a buffer with depths follows the pixels")]  # noqa: N815
    cuts: Annotated[
        list[int] | None,
        Meta(description="rows and columns of the buffer of cuts", extra={"typescript": "[number, number]"}),
    ]
    dets: Annotated[
        list[int] | None,
        Meta(
            description="rows and columns of the buffer of det J; null where nothing folds or the front end knows",
            extra={"typescript": "[number, number]"},
        ),
    ]


class Pictures(Message, frozen=True, kw_only=True, tag="pictures"):
    """The slices or projections that have changed."""

    binary: ClassVar[Buffers] = Buffers("of each pane its pixels, and depths, cuts and det J where it has some", None)

    seq: Annotated[int, Meta(description="number, to be confirmed by seen unless it is 0")]
    view: Views
    panes: Annotated[list[dict[str, Any]], Meta(extra={"typescript": "PaneContent[]"})]
    facts: Annotated[
        dict[str, Any],
        Meta(
            description="note, isBad, the folds of the map: folds, worst; the values that are black and white: window"
        ),
    ]


class WindowAddress(Struct, frozen=True):
    """The fields by which an editor answers a message that it refuses."""

    sender: Window
    seq: Counted


EditorMessage: TypeAlias = (
    Greeting | PointsEdit | HistoryRequest | ShapesEdit | ShapeChoice | WandRequest | WindowPointer | LargerBoxRequest
)
EDITOR: Channel[EditorMessage] = Channel(
    ("Editor",),
    EditorMessage,
    (EditDone, EditRefused, DrawShape, ProposedParts, ShowPart, ShowPoint, WindowPointer),
    LONGEST_EDIT,
    WindowAddress,
)

SpaceEditorMessage: TypeAlias = (
    Greeting | PointsEdit | HistoryRequest | ShapesEdit | ShapeChoice | DrawnPart | PicturesWanted | SlicesMoved | Seen
)
SPACE_EDITOR: Channel[SpaceEditorMessage] = Channel(
    ("SpaceEditor",),
    SpaceEditorMessage,
    (EditDone, EditRefused, ShowPoint, Pictures, Fragment),
    LONGEST_EDIT,
    WindowAddress,
)
