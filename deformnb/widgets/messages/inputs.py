"""Messages of the inputs: values, lists, tables, files, and the head of the studio."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from msgspec import Meta, Struct

from deformnb._typing import RecoveryCommand
from deformnb.io.files.texts import LONGEST_TABLE
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.widgets.messages.record import (
    LARGEST_NUMBER,
    Buffers,
    Channel,
    Fragment,
    Message,
    Phase,
    View,
    Whole,
)

# ---- values ----------------------------------------------------------------------------------------------------------

EditNumber: TypeAlias = Annotated[
    int, Meta(gt=-LARGEST_NUMBER, le=LARGEST_NUMBER, description="number, counted by the front end")
]


MOST_KEYS = 64
"""Key pictures at most."""


class ValueEdit(Message, frozen=True, kw_only=True, tag="edit"):
    """A value that is being changed or was changed."""

    seq: EditNumber
    view: View = ""
    phase: Annotated[Phase, Meta(description='"move" while something is dragged')]
    value: Annotated[Any, Meta(description="of the widget, which checks it")] = None


class ValueTaken(Message, frozen=True, kw_only=True, tag="done"):
    """Confirmation of a value."""

    seq: EditNumber
    view: View


class ValueRefused(Message, frozen=True, kw_only=True, tag="error"):
    """Refusal of a value."""

    view: View
    message: Annotated[str, Meta(description="why")]


VALUE: Channel[ValueEdit] = Channel(
    ("CurveEditor", "TransferEditor", "DepthKeys", "GridDrawing"), ValueEdit, (ValueTaken, ValueRefused)
)

# ---- lists -----------------------------------------------------------------------------------------------------------

LONGEST_ROW_NAME = 100
"""Characters of a name that a front end gives a row."""

RowAction: TypeAlias = Literal["choose", "switch", "rename", "up", "down", "double", "remove"]


class RowCommand(Message, frozen=True, kw_only=True, tag="act"):
    """A command for a row."""

    what: RowAction
    index: Annotated[Whole, Meta(description="of the row")]
    value: Annotated[
        Annotated[str, Meta(max_length=LONGEST_ROW_NAME)] | bool | None,
        Meta(description='whether it is on, for "switch"; a name, for "rename"'),
    ] = None
    version: Annotated[Whole, Meta(description="of the rows: a command for an earlier one is dropped")]

    def __post_init__(self) -> None:
        if not isinstance(self.value, {"switch": bool, "rename": str}.get(self.what, object)):
            raise ValueError("A switch is on or off, and a name is text")


class CommandDone(Message, frozen=True, kw_only=True, tag="done"):
    """The answer to a command: done or refused."""


LIST: Channel[RowCommand] = Channel(("ItemList",), RowCommand, (CommandDone,))


class RestoreCommand(Message, frozen=True, kw_only=True, tag="act"):
    """A pressed button."""

    what: Annotated[RecoveryCommand, Meta(description="which")]
    version: Annotated[Whole, Meta(description="of the offer: a command for an earlier one is dropped")]


class ResumeRequest(Message, frozen=True, kw_only=True, tag="resume"):
    """The session that a page has shown until its Python ended, and wants to go on with."""

    session: Annotated[str, Meta(min_length=1, max_length=100, description="name of its autosave")]


RESTORE: Channel[RestoreCommand | ResumeRequest] = Channel(
    ("RestoreBar",), RestoreCommand | ResumeRequest, (CommandDone,)
)


class SaveRequest(Message, frozen=True, kw_only=True, tag="save"):
    """The press of the button."""


class MenuRequest(Message, frozen=True, kw_only=True, tag="menu"):
    """An opened menu."""

    name: Literal["history", "examples", "export"]


HEAD: Channel[SaveRequest | MenuRequest] = Channel(("StudioHead",), SaveRequest | MenuRequest)


class BoxChoice(Message, frozen=True, kw_only=True, tag="choose"):
    """A chosen tab, or a section opened or closed."""

    box: Annotated[Whole, Meta(description="number of the tabs or the section")]
    index: Annotated[
        Whole | None, Meta(description="of the tab; 0 for a section that was opened, null for a closed one")
    ]


BOXES: Channel[BoxChoice] = Channel(("Boxes",), BoxChoice)

# ---- the table of points ---------------------------------------------------------------------------------------------

TableAction: TypeAlias = Literal[
    "cell", "add", "remove", "reset", "lock", "switch", "look", "paste", "undo", "redo", "seen"
]
PointField: TypeAlias = Literal["name", "active", "locked", "source", "target", "weight", "radius"]
LONGEST_CELL = 65536
"""Characters of a cell at most."""


class PointsCommand(Message, frozen=True, kw_only=True, tag="act"):
    """A command for points, or an edit of a cell."""

    view: View
    seq: EditNumber
    what: Annotated[TableAction, Meta(description='"seen" is whether the table is visible')]
    ids: Annotated[list[Whole], Meta(max_length=LARGEST_SET, description="of the points")]
    field: Annotated[PointField | Literal[""], Meta(description="of the cell")] = ""
    axis: Annotated[int, Meta(ge=0, le=2, description="of the cell")] = 0
    value: Annotated[
        str | bool | None, Meta(description="whether a switch is on or the table visible; else the text")
    ] = None

    @property
    def text(self) -> str:
        """The text that was written."""
        return str(self.value)

    @property
    def is_on(self) -> bool:
        """State of a switch, or visibility of the table."""
        return self.value is True

    def __post_init__(self) -> None:
        is_switch = self.what == "seen" or self.field in ("active", "locked")
        takes_text = self.what in ("paste", "cell", "add")
        if not isinstance(self.value, bool if is_switch else str if takes_text else type(None)):
            raise ValueError("A switch takes true or false, a cell and a paste text, and other commands no value")
        if isinstance(self.value, str) and len(self.value) > (LONGEST_TABLE if self.what == "paste" else LONGEST_CELL):
            raise ValueError("The text is too long")
        if (self.what == "cell") != (self.field != "") or (self.what == "cell" and len(self.ids) != 1):
            raise ValueError("A cell has a field and one point, and other commands have no field")


class PointsCommandDone(Message, frozen=True, kw_only=True, tag="done"):
    """The answer: done or refused."""

    view: View
    seq: EditNumber
    ok: Annotated[bool, Meta(description="whether it was done")]
    text: Annotated[str, Meta(description="a report of it")]


class TableAddress(Struct, frozen=True):
    """The fields by which a table answers a command that it refuses."""

    view: View
    seq: EditNumber


TABLE: Channel[PointsCommand] = Channel(
    ("PointsTable",), PointsCommand, (PointsCommandDone,), 2 * LONGEST_TABLE, TableAddress
)

# ---- files -----------------------------------------------------------------------------------------------------------

LARGEST_UPLOAD = 500_000_000
"""Bytes of one uploaded file at most."""

PIECE = 2**18
"""Bytes of a piece: with its message it is less than a front end may send in one message."""

LARGEST_DOWNLOAD = 128 * 2**20
"""Bytes of one download at most: a message of 256 MB was seen to break a front end."""

Upload: TypeAlias = Annotated[str, Meta(min_length=1, max_length=64, description="id of the upload")]


class CopyText(Message, frozen=True, kw_only=True, tag="copy"):
    """Put a text on the clipboard."""

    text: str
    note: Annotated[str, Meta(description="purpose")]


class Download(Message, frozen=True, kw_only=True, tag="download"):
    """Offer a file to the browser."""

    binary: ClassVar[Buffers] = Buffers("the file", 1, LARGEST_DOWNLOAD)

    name: Annotated[str, Meta(description="of the file")]


TRANSFER: Channel[Any] = Channel(("FileTransfer",), None, (CopyText, Download, Fragment))


class UploadBegin(Message, frozen=True, kw_only=True, tag="begin"):
    """A file that was chosen or dropped."""

    id: Upload
    name: Annotated[str, Meta(description="of the file")]
    size: Annotated[Whole, Meta(description="in bytes")]


class UploadPiece(Message, frozen=True, kw_only=True, tag="piece"):
    """The piece that was requested."""

    binary: ClassVar[Buffers] = Buffers("its bytes", 1, PIECE)

    id: Upload
    offset: Annotated[Whole, Meta(description="of its first byte")]


class UploadCancel(Message, frozen=True, kw_only=True, tag="cancel"):
    """An upload that the user has cancelled."""

    id: Upload


class PieceRequest(Message, frozen=True, kw_only=True, tag="next"):
    """A request for the next piece."""

    id: Upload
    offset: Annotated[int, Meta(description="of its first byte")]
    length: Annotated[int, Meta(description="in bytes")]


class UploadReading(Message, frozen=True, kw_only=True, tag="reading"):
    """A file that has arrived and is being read."""

    id: Upload
    share: Annotated[float, Meta(description="that is done, 0 to 1")]


class UploadDone(Message, frozen=True, kw_only=True, tag="done"):
    """The end of an upload: taken, cancelled or refused."""

    id: Upload


class UploadAddress(Struct, frozen=True):
    """The field by which a refused message names its upload."""

    id: Upload


UPLOAD: Channel[UploadBegin | UploadPiece | UploadCancel] = Channel(
    ("FileInput",),
    UploadBegin | UploadPiece | UploadCancel,
    (PieceRequest, UploadReading, UploadDone),
    answered_by=UploadAddress,
)
