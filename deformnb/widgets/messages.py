"""Messages between the widgets and their front ends: one table, from which ``docs/messages.md`` is written.

Most of a widget's state is synced traits. Messages are what must arrive in order, once, or with binary data. Whatever a
front end sends is checked by :mod:`deformnb.widgets.protocol` or by the widget itself before anything is done with it.
``python -m deformnb.widgets.messages`` prints the page of the documentation.
"""

from __future__ import annotations

from dataclasses import dataclass, field

TO_PYTHON, TO_FRONT_END = "to Python", "to the front end"


@dataclass(frozen=True)
class MessageKind:
    """One kind of message, a JSON object with binary buffers beside it.

    Parameters
    ----------
    name : its ``type``.
    way : :data:`TO_PYTHON` or :data:`TO_FRONT_END`.
    widgets : whose.
    about : what it is for, in a sentence.
    fields : of the object, by name, in words; a question mark behind a name means that it may be missing.
    buffers : what the binary buffers hold.
    """

    name: str
    way: str
    widgets: str
    about: str
    fields: dict[str, str] = field(default_factory=dict)
    buffers: str = ""


_SENDER = {"sender": "id of the window", "seq": "number of the message, counted by the sender"}
_VIEW = {"view": "id of the front end"}
_EDITORS, _INPUTS = "Editor, SpaceEditor", "CurveEditor, TransferEditor, DepthKeys"
_ROWS, _LIVE, _SERVED = "ItemList", "LiveView", "VolumeView"

MESSAGES: tuple[MessageKind, ...] = (
    # Editors
    MessageKind("greet", TO_PYTHON, _EDITORS, "A front end has opened; done answers it: Python listens",
                _SENDER),
    MessageKind("edit", TO_PYTHON, _EDITORS, "Control points that are being dragged or were edited",
                {**_SENDER, "phase": '"move" or "end"', "kind": "what was done, one of protocol.KINDS",
                 "joins": "whether it goes on with the edit before it", "next_id?": "least id that was never given",
                 "points": "all points", "drawn?": "pictures per second of the drag, and milliseconds to a picture"}),
    MessageKind("shapes", TO_PYTHON, "Editor", "Cuts or rigid parts that were edited",
                {**_SENDER, "what": '"cuts" or "parts"', "kind": "what was done, in words",
                 "shapes": "all shapes of that sort, as documents hold them",
                 "points?": "all points, where the edit has changed them too"}),
    MessageKind("choose", TO_PYTHON, "Editor", "A cut or rigid part that was chosen",
                {**_SENDER, "what": '"cuts", "parts" or null for none', "index": "place in the list",
                 "shape": "the shape without the pixels of a mask: its place may be another one by now"}),
    MessageKind("history", TO_PYTHON, _EDITORS, "A request to undo or redo", {**_SENDER, "way": '"undo" or "redo"'}),
    MessageKind("done", TO_FRONT_END, _EDITORS, "A message was taken in, and all callbacks have run", _SENDER),
    MessageKind("error", TO_FRONT_END, _EDITORS, "Something was refused or has failed", {"message": "why"}),
    MessageKind("draw", TO_FRONT_END, "Editor", "Start drawing a shape", {"tool": '"cut", "part" or "ground"'}),
    MessageKind("look", TO_FRONT_END, _EDITORS, "Bring a point into the middle", {"id": "of the point"}),
    # The editor in space
    MessageKind("hello", TO_PYTHON, "SpaceEditor", "A front end has opened and needs all pictures", _VIEW),
    MessageKind("look", TO_PYTHON, "SpaceEditor", "The place of the slices, or the projection, was changed",
                {**_VIEW, "cursor?": "(x, y, z)", "projection?": "name of it"}),
    MessageKind("seen", TO_PYTHON, "SpaceEditor", "The pictures of this number are shown", {**_VIEW, "seq": "number"}),
    MessageKind("pictures", TO_FRONT_END, "SpaceEditor", "The slices or projections that have changed",
                {"seq": "number", "view": "id of the one front end, or null for all",
                 "panes": "of each picture its index, raster, and which buffers it has",
                 "facts": "notes, and the folds of the map when nothing moves"},
                "of each pane its pixels, and depths and outlines where it has some"),
    # Inputs
    MessageKind("edit", TO_PYTHON, _INPUTS, "A value that is being changed or was changed",
                {"seq": "number, counted by the front end", **_VIEW, "phase": '"move" or "end"',
                 "value": "of the widget"}),
    MessageKind("done", TO_FRONT_END, _INPUTS, "A value was taken in", {"seq": "its number", **_VIEW}),
    MessageKind("error", TO_FRONT_END, _INPUTS, "A value was refused", {**_VIEW, "message": "why"}),
    MessageKind("act", TO_PYTHON, _ROWS, "A command for a row",
                {"what": "the command", "index": "of the row", "value": "for it", "version": "of the rows"}),
    MessageKind("done", TO_FRONT_END, _ROWS, "The command was done or refused"),
    MessageKind("act", TO_PYTHON, "PointsTable", "A command for points, or an edit of a cell",
                {**_VIEW, "seq": "number", "what": "the command", "ids": "of the points", "field?": "of the cell",
                 "axis?": "of the cell", "value?": "for it"}),
    MessageKind("done", TO_FRONT_END, "PointsTable", "It was done or refused",
                {**_VIEW, "seq": "its number", "ok": "whether it was done", "text": "why not"}),
    MessageKind("copy", TO_FRONT_END, "FileTransfer", "Put a text on the clipboard",
                {"text": "", "note": "what it is for"}),
    MessageKind("download", TO_FRONT_END, "FileTransfer", "Offer a file to the browser",
                {"name": "of the file"}, "the file"),
    MessageKind("act", TO_PYTHON, "RestoreBar", "A button was pressed",
                {"what": "which", "version": "of what it showed"}),
    MessageKind("done", TO_FRONT_END, "RestoreBar", "It was done or refused"),
    MessageKind("save", TO_PYTHON, "StudioHead", "The button was pressed"),
    # The live view, which draws in the front end
    MessageKind("hello", TO_PYTHON, _LIVE, "A front end has opened",
                {**_VIEW, "largest": "side of the largest 3D texture", "renderer": "name of the GPU",
                 "software": "whether the CPU draws", "background": '"dark" or "light"',
                 "voxels?": "that fit into its memory"}),
    MessageKind("chunk", TO_PYTHON, _LIVE, "A request for a piece of the volume", {**_VIEW, "id": "of the volume",
                                                                                  "index": "of the piece"}),
    MessageKind("chunk", TO_FRONT_END, _LIVE, "A piece of the volume",
                {**_VIEW, "id": "of the volume", "index": "of the piece", "start": "its first voxel"}, "voxels, gzip"),
    MessageKind("field", TO_FRONT_END, _LIVE, "The deformation as textures",
                {"view": "id of the one front end, or null for all", "seq": "number",
                 "follow": "index of the map that an editor moves, and the points and shapes it is of",
                 "box": "of the result",
                 "planar": "shapes and places of the maps of an extrusion", "space": "of a field in space",
                 "coarse": "whether it is coarser than it could be", "buffers": "names of the buffers"},
                "maps, weights, distances to cuts, samples in space"),
    MessageKind("seen", TO_PYTHON, _LIVE, "The deformation of this number is shown", {**_VIEW, "seq": "number"}),
    MessageKind("still", TO_PYTHON, _LIVE, "WebGL is missing: Python shall draw", {**_VIEW, "background": ""}),
    MessageKind("drawn", TO_FRONT_END, _LIVE, "Python draws for this front end", {**_VIEW, "info": "of the volume"}),
    MessageKind("drawn", TO_PYTHON, _LIVE, "A message to Python's renderer", {**_VIEW, "say": "as of a VolumeView"}),
    MessageKind("info", TO_FRONT_END, _LIVE, "Another volume is drawn by Python", {"info": "of the volume"}),
    MessageKind("screenshot", TO_FRONT_END, _LIVE, "A request for the picture that is shown", {"id": "of the request"}),
    MessageKind("screenshot", TO_PYTHON, _LIVE, "The picture", {**_VIEW, "id": "of the request"}, "PNG"),
    MessageKind("stats", TO_PYTHON, _LIVE, "Measurements, named in protocol.MEASURED", _VIEW),
    # The volume view, drawn by Python
    MessageKind("hello", TO_PYTHON, _SERVED, "A front end has opened", {**_VIEW, "width": "pixels", "height": "pixels",
                                                                       "background": '"dark" or "light"'}),
    MessageKind("size", TO_PYTHON, _SERVED, "The front end has another size", {**_VIEW, "width": "", "height": ""}),
    MessageKind("camera", TO_PYTHON, _SERVED, "The view was turned",
                {**_VIEW, "camera": "trait", "number": "of the change"}),
    MessageKind("seen", TO_PYTHON, _SERVED, "The frame of this number is shown", {**_VIEW, "seq": "number"}),
    MessageKind("bye", TO_PYTHON, _SERVED, "The front end was closed", _VIEW),
    MessageKind("frame", TO_FRONT_END, _SERVED, "A picture", {"seq": "number", "full": "whether in full resolution",
                                                             "camera": "number of the change that it shows",
                                                             "by": "id of the front end that made it"}, "JPEG"),
    MessageKind("notice", TO_FRONT_END, _SERVED, "A text over the picture", {"text": "empty for none"}),
    MessageKind("badge", TO_FRONT_END, _SERVED, "A remark about folds", {"text": "empty for none"}),
    MessageKind("trame", TO_FRONT_END, _SERVED, "Frames come from a server of trame", {"url": "of its page"}),
)
"""All kinds of messages."""


def as_markdown() -> str:
    """The page of the documentation."""
    lines = ["# Messages between Python and the front ends", "",
             "JSON objects with a `type`, and binary buffers beside them. The rest of a widget is synced traits.",
             "This page is written by `python -m deformnb.widgets.messages`.", ""]
    for widgets in dict.fromkeys(kind.widgets for kind in MESSAGES):
        lines += [f"## {widgets}", "", "| type | | fields | buffers |", "|---|---|---|---|"]
        for kind in (kind for kind in MESSAGES if kind.widgets == widgets):
            told = "; ".join(f"`{name}` {words}".strip() for name, words in kind.fields.items())
            lines.append(f"| `{kind.name}` | {kind.way}: {kind.about}. | {told} | {kind.buffers} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown(), end="")  # noqa: T201
