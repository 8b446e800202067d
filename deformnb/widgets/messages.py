"""Messages between the widgets and their front ends: a type for each, from which ``docs/messages.md`` is written.

Most of a widget's state is synced traits. Messages are what must arrive in order, once, or with binary data. Python
makes each message that it sends as one of these types, which mypy checks; whatever a front end sends is checked by
:mod:`deformnb.widgets.edit_messages` or by the widget itself before anything is done with it.
``python -m deformnb.widgets.messages`` prints the page of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NotRequired,
    TypeAlias,
    TypedDict,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

TO_PYTHON, TO_FRONT_END = "to Python", "to the front end"

Window: TypeAlias = Annotated[str, "id of the window"]
Counted: TypeAlias = Annotated[int, "number of the message, counted by the sender"]
View: TypeAlias = Annotated[str, "id of the front end"]
Views: TypeAlias = Annotated[str | None, "id of the one front end, or null for all"]
Phase: TypeAlias = Literal["move", "end"]
Shade: TypeAlias = Literal["dark", "light"]


class PointData(TypedDict):
    """A control point, with two coordinates on a picture and three in space; a radius of null is the one of all."""

    id: int
    name: NotRequired[str]
    source: list[float]
    target: list[float]
    active: NotRequired[bool]
    weight: NotRequired[float]
    locked: NotRequired[bool]
    radius: NotRequired[float | None]


# ---- editors ---------------------------------------------------------------------------------------------------------


class Greeting(TypedDict):
    """A front end has opened; done answers it: Python receives."""

    type: Literal["greet"]
    sender: Window
    seq: Counted


class PointsEdit(TypedDict):
    """Control points that are being dragged or were edited."""

    type: Literal["edit"]
    sender: Window
    seq: Counted
    phase: Phase
    kind: Annotated[str, "what was done, one of edit_messages.KINDS"]
    joins: Annotated[NotRequired[bool], "whether it goes on with the edit before it"]
    next_id: Annotated[NotRequired[int], "least id that was never given"]
    points: Annotated[list[PointData], "all points"]
    part: Annotated[
        NotRequired[dict[str, Any]],
        "index and motion (matrix and shift, or null at rest) of a rigid part that is being dragged",
    ]
    drawn: Annotated[
        NotRequired[dict[str, float]], "hz, pictures per second of the drag, and ms, milliseconds to a picture"
    ]


class ShapesEdit(TypedDict):
    """Cuts or rigid parts that were edited."""

    type: Literal["shapes"]
    sender: Window
    seq: Counted
    what: Literal["cuts", "parts"]
    kind: Annotated[str, "what was done, in words"]
    shapes: Annotated[list[dict[str, Any]], "all shapes of that sort, as documents hold them"]
    points: Annotated[NotRequired[list[PointData]], "all points, where the edit has changed them too"]
    joins: Annotated[NotRequired[bool], "true where such edits in quick succession are undone as one"]


class ShapeChoice(TypedDict):
    """A cut or rigid part that was chosen."""

    type: Literal["choose"]
    sender: Window
    seq: Counted
    what: Annotated[Literal["cuts", "parts"] | None, "null for none"]
    index: Annotated[NotRequired[int], "place in the list"]
    shape: Annotated[
        NotRequired[dict[str, Any]], "the shape without the pixels of a mask: its place may be another one by now"
    ]


class HistoryRequest(TypedDict):
    """A request to undo or redo."""

    type: Literal["history"]
    sender: Window
    seq: Counted
    way: Literal["undo", "redo"]


class EditDone(TypedDict):
    """A message was taken in, and all callbacks have run."""

    type: Literal["done"]
    sender: Window
    seq: Counted


class EditRefused(TypedDict):
    """Something was refused or has failed."""

    type: Literal["error"]
    message: Annotated[str, "why"]


class WandRequest(TypedDict):
    """The wand was used; the trait wand has the answer."""

    type: Literal["wand"]
    what: Annotated[Literal["preview", "part", "cut", "stop"], "what becomes of it"]
    place: Annotated[list[float], "that was clicked, of the original picture"]
    tolerance: Annotated[float, "in the unit of the picture's values"]
    rule: Annotated[Literal["near", "brighter", "darker"], "which values are selected"]
    through: Annotated[bool, "whether in the volume instead of in the picture"]


class DrawShape(TypedDict):
    """Start drawing a shape."""

    type: Literal["draw"]
    tool: Literal["cut", "part", "fixed"]


class ProposedParts(TypedDict):
    """Other rigid parts that control points contradict: ask what becomes of those."""

    type: Literal["parts"]
    parts: Annotated[list[dict[str, Any]], "all parts, as documents hold them"]
    kind: Annotated[str, "what is done, in words"]


class ShowPoint(TypedDict):
    """Bring a point into the middle."""

    type: Literal["look"]
    id: Annotated[int, "of the point"]


# ---- the editor in space ---------------------------------------------------------------------------------------------


class PicturesWanted(TypedDict):
    """A front end has opened and needs all pictures."""

    type: Literal["hello"]
    view: View


class SlicesMoved(TypedDict):
    """The place of the slices, or the projection, was changed."""

    type: Literal["look"]
    view: View
    cursor: Annotated[NotRequired[list[float]], "(x, y, z)"]
    projection: Annotated[NotRequired[str], "name of it"]


class Seen(TypedDict):
    """What has this number is shown or being drawn, so that the next may come."""

    type: Literal["seen"]
    view: View
    seq: Annotated[int, "number"]


class Pictures(TypedDict):
    """The slices or projections that have changed."""

    type: Literal["pictures"]
    seq: Annotated[int, "number"]
    view: Views
    panes: Annotated[list[dict[str, Any]], "of each picture its index, raster, and which buffers it has"]
    facts: Annotated[dict[str, Any], "notes, and the folds of the map when nothing moves"]


# ---- inputs ----------------------------------------------------------------------------------------------------------


class ValueEdit(TypedDict):
    """A value that is being changed or was changed."""

    type: Literal["edit"]
    seq: Annotated[int, "number, counted by the front end"]
    view: View
    phase: Phase
    value: Annotated[Any, "of the widget"]


class ValueTaken(TypedDict):
    """A value was taken in."""

    type: Literal["done"]
    seq: Annotated[int, "its number"]
    view: View


class ValueRefused(TypedDict):
    """A value was refused."""

    type: Literal["error"]
    view: View
    message: Annotated[str, "why"]


class RowCommand(TypedDict):
    """A command for a row."""

    type: Literal["act"]
    what: Annotated[str, "the command"]
    index: Annotated[int, "of the row"]
    value: Annotated[Any, "for it"]
    version: Annotated[int, "of the rows"]


class CommandDone(TypedDict):
    """The command was done or refused."""

    type: Literal["done"]


class PointsCommand(TypedDict):
    """A command for points, or an edit of a cell."""

    type: Literal["act"]
    view: View
    seq: Annotated[int, "number"]
    what: Annotated[str, "the command"]
    ids: Annotated[list[int], "of the points"]
    field: Annotated[NotRequired[str], "of the cell"]
    axis: Annotated[NotRequired[int], "of the cell"]
    value: Annotated[NotRequired[Any], "for it"]


class PointsCommandDone(TypedDict):
    """It was done or refused."""

    type: Literal["done"]
    view: View
    seq: Annotated[int, "its number"]
    ok: Annotated[bool, "whether it was done"]
    text: Annotated[str, "why not"]


class CopyText(TypedDict):
    """Put a text on the clipboard."""

    type: Literal["copy"]
    text: str
    note: Annotated[str, "what it is for"]


class Download(TypedDict):
    """Offer a file to the browser."""

    type: Literal["download"]
    name: Annotated[str, "of the file"]


class UploadBegin(TypedDict):
    """A file was chosen or dropped."""

    type: Literal["begin"]
    id: Annotated[str, "of the upload"]
    name: Annotated[str, "of the file"]
    size: Annotated[int, "in bytes"]


class UploadPiece(TypedDict):
    """The piece that was requested."""

    type: Literal["piece"]
    id: Annotated[str, "of the upload"]
    offset: Annotated[int, "of its first byte"]


class UploadCancel(TypedDict):
    """The user has given the upload up."""

    type: Literal["cancel"]
    id: Annotated[str, "of the upload"]


class PieceRequest(TypedDict):
    """A request for the next piece."""

    type: Literal["next"]
    id: Annotated[str, "of the upload"]
    offset: Annotated[int, "of its first byte"]
    length: Annotated[int, "in bytes"]


class UploadReading(TypedDict):
    """The file has come and is being read."""

    type: Literal["reading"]
    id: Annotated[str, "of the upload"]
    share: Annotated[float, "that is done, 0 to 1"]


class UploadDone(TypedDict):
    """The file was taken, cancelled or refused."""

    type: Literal["done"]
    id: Annotated[str, "of the upload"]


class RestoreCommand(TypedDict):
    """A button was pressed."""

    type: Literal["act"]
    what: Annotated[str, "which"]
    version: Annotated[int, "of what it showed"]


class SaveRequest(TypedDict):
    """The button was pressed."""

    type: Literal["save"]


# ---- the live view, which draws in the front end ---------------------------------------------------------------------


class LiveHello(TypedDict):
    """A front end has opened."""

    type: Literal["hello"]
    view: View
    largest: Annotated[int, "side of the largest 3D texture"]
    renderer: Annotated[str, "name of the GPU"]
    software: Annotated[bool, "whether the CPU draws"]
    background: Shade
    voxels: Annotated[NotRequired[int], "that fit into its memory"]


class ChunkRequest(TypedDict):
    """A request for a piece of the volume."""

    type: Literal["chunk"]
    view: View
    id: Annotated[str, "of the volume"]
    index: Annotated[int, "of the piece"]


class Chunk(TypedDict):
    """A piece of the volume."""

    type: Literal["chunk"]
    view: View
    id: Annotated[str, "of the volume"]
    index: Annotated[int, "of the piece"]
    start: Annotated[int, "its first voxel"]
    lag: Annotated[NotRequired[int], "voxels after the first so many are differences from those so many before"]


class FieldContent(TypedDict):
    """A deformation as textures, without its message."""

    box: Annotated[dict[str, list[float]], "of the result"]
    planar: Annotated[dict[str, Any] | None, "shapes and places of the maps of an extrusion"]
    space: Annotated[dict[str, Any] | None, "of a field in space"]
    coarse: Annotated[bool, "whether it is coarser than it could be"]
    frames: Annotated[NotRequired[dict[str, float]], "count and duration, of an animation"]
    buffers: Annotated[list[str], "names of the buffers"]


class FieldMaps(FieldContent):
    """The deformation as textures."""

    type: Literal["field"]
    view: Views
    seq: Annotated[int, "number"]
    follow: Annotated[Any, "index of the map that an editor moves, and the points and shapes it is of"]
    moved: Annotated[Any, "points in space whose fit it is, and nodes of it while they move; null where Python fits"]


class PointsFollowed(TypedDict):
    """The front end follows the points of an editor in space: it makes their displacement itself while they move."""

    type: Literal["follows"]
    view: View
    sender: Annotated[str, "of the edits of its window"]


class StoredFieldMaps(FieldContent):
    """The deformation as textures, as an exported page holds it, where no Python sends any."""

    type: Literal["field"]
    seq: Annotated[int, "always 0"]
    follow: Annotated[Any, "index of the map that the editor moves, without points"]


class StillRequest(TypedDict):
    """WebGL is missing: Python shall draw."""

    type: Literal["still"]
    view: View
    background: Shade


class DrawnByPython(TypedDict):
    """Python draws for this front end."""

    type: Literal["drawn"]
    view: View
    info: Annotated[dict[str, Any], "of the volume"]


class ToServerRenderer(TypedDict):
    """A message to Python's renderer."""

    type: Literal["drawn"]
    view: View
    say: Annotated[dict[str, Any], "as of a VolumeView"]


class VolumeInfo(TypedDict):
    """Another volume is drawn by Python."""

    type: Literal["info"]
    info: Annotated[dict[str, Any], "of the volume"]


class ScreenshotRequest(TypedDict):
    """A request for the picture that is shown."""

    type: Literal["screenshot"]
    id: Annotated[int, "of the request"]


class Screenshot(TypedDict):
    """The picture."""

    type: Literal["screenshot"]
    view: View
    id: Annotated[int, "of the request"]


class MovieFrame(FieldContent):
    """A request for a frame of a movie, with the deformation of its moment as textures."""

    type: Literal["movie_frame"]
    view: View
    id: Annotated[str, "of the movie"]
    index: Annotated[int, "of the frame"]
    size: Annotated[list[int], "width and height in pixels"]
    looks: Annotated[dict[str, Any], "camera, projection and the like, as the traits"]


class MoviePiece(TypedDict):
    """A part of a frame."""

    type: Literal["movie_piece"]
    view: View
    id: Annotated[str, "of the movie"]
    index: Annotated[int, "of the frame"]
    offset: Annotated[int, "of its first byte"]
    size: Annotated[int, "bytes of the whole frame"]


class MovieFailed(TypedDict):
    """A frame cannot be drawn."""

    type: Literal["movie_failed"]
    view: View
    id: Annotated[str, "of the movie"]
    message: Annotated[str, "why"]


class MovieEnd(TypedDict):
    """No more frames are wanted."""

    type: Literal["movie_end"]
    view: View
    id: Annotated[str, "of the movie"]


class Measurements(TypedDict):
    """Measurements, named in edit_messages.MEASURED."""

    type: Literal["stats"]
    view: View


# ---- the volume view, drawn by Python --------------------------------------------------------------------------------


class ServedHello(TypedDict):
    """A front end has opened."""

    type: Literal["hello"]
    view: View
    width: Annotated[int, "pixels"]
    height: Annotated[int, "pixels"]
    background: Shade
    origin: Annotated[NotRequired[str], "address of the page, where frames come from a server"]


class Resized(TypedDict):
    """The front end has another size."""

    type: Literal["size"]
    view: View
    width: Annotated[int, "pixels"]
    height: Annotated[int, "pixels"]


class CameraMoved(TypedDict):
    """The view was turned."""

    type: Literal["camera"]
    view: View
    camera: Annotated[dict[str, Any], "as the trait"]
    number: Annotated[int, "of the change"]


class Closed(TypedDict):
    """The front end was closed."""

    type: Literal["bye"]
    view: View


class FrameSent(TypedDict):
    """A picture."""

    type: Literal["frame"]
    seq: Annotated[int, "number"]
    full: Annotated[bool, "whether in full resolution"]
    camera: Annotated[int, "number of the change that it shows"]
    by: Annotated[str, "id of the front end that made it"]


class Notice(TypedDict):
    """A text over the picture."""

    type: Literal["notice"]
    text: Annotated[str, "empty for none"]


class Badge(TypedDict):
    """A remark about folds."""

    type: Literal["badge"]
    text: Annotated[str, "empty for none"]


class TrameAddress(TypedDict):
    """Frames come from a server of trame."""

    type: Literal["trame"]
    view: View
    url: Annotated[str, "of its page"]


# ---- the table -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MessageKind:
    """One kind of message, a JSON object with binary buffers beside it.

    Parameters
    ----------
    shape : its type; the docstring says what it is for.
    way : :data:`TO_PYTHON` or :data:`TO_FRONT_END`.
    widgets : whose.
    buffers : what the binary buffers hold.
    """

    shape: Any
    way: str
    widgets: str
    buffers: str = ""

    @property
    def name(self) -> str:
        """Its ``type``."""
        (name,) = get_args(get_type_hints(self.shape)["type"])
        return str(name)

    @property
    def about(self) -> str:
        """What it is for, in a sentence."""
        return str(self.shape.__doc__)

    def fields(self) -> Iterator[tuple[str, str, str]]:
        """Name, type and meaning of each entry; a question mark behind a name means that it may be missing."""
        for name, hint in get_type_hints(self.shape, include_extras=True).items():
            if name == "type":
                continue
            inner, *meaning = (hint.__origin__, *hint.__metadata__) if get_origin(hint) is Annotated else (hint,)
            is_optional = get_origin(inner) is NotRequired
            kind = get_args(inner)[0] if is_optional else inner
            yield f"{name}?" if is_optional else name, type_words(kind), "".join(map(str, meaning))


_WORDS = {
    str: "text",
    int: "whole number",
    float: "number",
    bool: "true or false",
    NoneType: "null",
    Any: "any JSON",
    PointData: "points",
}


def type_words(hint: Any) -> str:
    """A type of JSON in words.

    Examples
    --------
    >>> type_words(Literal["move", "end"] | None), type_words(list[float]), type_words(dict[str, Any])
    ('"move" or "end" or null', 'list of numbers', 'object')
    """
    kind, inner = get_origin(hint), get_args(hint)
    if kind is Literal:
        return " or ".join(f'"{value}"' for value in inner)
    if kind in (Union, UnionType):
        return " or ".join(map(type_words, inner))
    if kind is list:
        words = type_words(inner[0])
        return f"list of {words}" if words.endswith("s") else f"list of {words}s"
    return "object" if kind is dict else _WORDS[hint]


_EDITORS = "Editor, SpaceEditor"
_INPUTS = "CurveEditor, TransferEditor, DepthKeys, GridDrawing"
_SPACE, _ROWS, _TABLE, _FILES, _RESTORE = "SpaceEditor", "ItemList", "PointsTable", "FileTransfer", "RestoreBar"
_UPLOAD = "FileInput"
_LIVE, _SERVED = "LiveView", "VolumeView"

MESSAGES: tuple[MessageKind, ...] = (
    MessageKind(Greeting, TO_PYTHON, _EDITORS),
    MessageKind(PointsEdit, TO_PYTHON, _EDITORS),
    MessageKind(ShapesEdit, TO_PYTHON, "Editor"),
    MessageKind(ShapeChoice, TO_PYTHON, "Editor"),
    MessageKind(WandRequest, TO_PYTHON, "Wand"),
    MessageKind(HistoryRequest, TO_PYTHON, _EDITORS),
    MessageKind(EditDone, TO_FRONT_END, _EDITORS),
    MessageKind(EditRefused, TO_FRONT_END, _EDITORS),
    MessageKind(DrawShape, TO_FRONT_END, "Editor"),
    MessageKind(ProposedParts, TO_FRONT_END, "Editor"),
    MessageKind(ShowPoint, TO_FRONT_END, _EDITORS),
    MessageKind(PicturesWanted, TO_PYTHON, _SPACE),
    MessageKind(SlicesMoved, TO_PYTHON, _SPACE),
    MessageKind(Seen, TO_PYTHON, _SPACE),
    MessageKind(Pictures, TO_FRONT_END, _SPACE, "of each pane its pixels, and depths and outlines where it has some"),
    MessageKind(ValueEdit, TO_PYTHON, _INPUTS),
    MessageKind(ValueTaken, TO_FRONT_END, _INPUTS),
    MessageKind(ValueRefused, TO_FRONT_END, _INPUTS),
    MessageKind(RowCommand, TO_PYTHON, _ROWS),
    MessageKind(CommandDone, TO_FRONT_END, _ROWS),
    MessageKind(PointsCommand, TO_PYTHON, _TABLE),
    MessageKind(PointsCommandDone, TO_FRONT_END, _TABLE),
    MessageKind(CopyText, TO_FRONT_END, _FILES),
    MessageKind(Download, TO_FRONT_END, _FILES, "the file"),
    MessageKind(UploadBegin, TO_PYTHON, _UPLOAD),
    MessageKind(UploadPiece, TO_PYTHON, _UPLOAD, "its bytes"),
    MessageKind(UploadCancel, TO_PYTHON, _UPLOAD),
    MessageKind(PieceRequest, TO_FRONT_END, _UPLOAD),
    MessageKind(UploadReading, TO_FRONT_END, _UPLOAD),
    MessageKind(UploadDone, TO_FRONT_END, _UPLOAD),
    MessageKind(RestoreCommand, TO_PYTHON, _RESTORE),
    MessageKind(CommandDone, TO_FRONT_END, _RESTORE),
    MessageKind(SaveRequest, TO_PYTHON, "StudioHead"),
    MessageKind(LiveHello, TO_PYTHON, _LIVE),
    MessageKind(ChunkRequest, TO_PYTHON, _LIVE),
    MessageKind(Chunk, TO_FRONT_END, _LIVE, "voxels, gzip"),
    MessageKind(FieldMaps, TO_FRONT_END, _LIVE, "maps, weights, distances to cuts, samples in space"),
    MessageKind(Seen, TO_PYTHON, _LIVE),
    MessageKind(PointsFollowed, TO_PYTHON, _LIVE),
    MessageKind(StillRequest, TO_PYTHON, _LIVE),
    MessageKind(DrawnByPython, TO_FRONT_END, _LIVE),
    MessageKind(ToServerRenderer, TO_PYTHON, _LIVE),
    MessageKind(VolumeInfo, TO_FRONT_END, _LIVE),
    MessageKind(ScreenshotRequest, TO_FRONT_END, _LIVE),
    MessageKind(Screenshot, TO_PYTHON, _LIVE, "PNG"),
    MessageKind(MovieFrame, TO_FRONT_END, _LIVE, "maps, weights, distances to cuts, samples in space"),
    MessageKind(MoviePiece, TO_PYTHON, _LIVE, "bytes of a PNG"),
    MessageKind(MovieFailed, TO_PYTHON, _LIVE),
    MessageKind(MovieEnd, TO_FRONT_END, _LIVE),
    MessageKind(Measurements, TO_PYTHON, _LIVE),
    MessageKind(ServedHello, TO_PYTHON, _SERVED),
    MessageKind(Resized, TO_PYTHON, _SERVED),
    MessageKind(CameraMoved, TO_PYTHON, _SERVED),
    MessageKind(Seen, TO_PYTHON, _SERVED),
    MessageKind(Closed, TO_PYTHON, f"{_LIVE}, {_SERVED}"),
    MessageKind(FrameSent, TO_FRONT_END, _SERVED, "JPEG"),
    MessageKind(Notice, TO_FRONT_END, _SERVED),
    MessageKind(Badge, TO_FRONT_END, _SERVED),
    MessageKind(TrameAddress, TO_FRONT_END, _SERVED),
)
"""All kinds of messages."""


def as_markdown() -> str:
    """The page of the documentation."""
    lines = [
        "# Messages between Python and the front ends",
        "",
        "JSON objects with a `type`, and binary buffers beside them. The rest of a widget is synced traits.",
        "A question mark behind a name means that it may be missing.",
        "This page is written by `python -m deformnb.widgets.messages`.",
        "",
    ]
    for widgets in dict.fromkeys(kind.widgets for kind in MESSAGES):
        lines += [f"## {widgets}", "", "| type | | fields | buffers |", "|---|---|---|---|"]
        for kind in (kind for kind in MESSAGES if kind.widgets == widgets):
            told = "; ".join(f"`{name}` ({words}) {meaning}".strip() for name, words, meaning in kind.fields())
            lines.append(f"| `{kind.name}` | {kind.way}: {kind.about} | {told} | {kind.buffers} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown(), end="")  # noqa: T201
