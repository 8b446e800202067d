"""Messages of the views of a volume: one that draws in the front end, and one whose pictures Python draws."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, NotRequired, TypeAlias, TypedDict

from msgspec import UNSET, Meta, Struct, UnsetType, structs

from deformnb.widgets.messages.record import (
    LARGEST_NUMBER,
    LONGEST_ID,
    Buffers,
    Channel,
    Finite,
    Fragment,
    Message,
    Place2,
    Place3,
    Seen,
    Shade,
    View,
    Views,
    Whole,
)

LARGEST_SIDE = 4096
"""Pixels along a side of a picture that Python draws at most."""

MOVIE_PIECE = 2**18
"""Bytes of a piece of a movie's frame: with its message it is less than a front end may send in one message."""

LARGEST_SENT_PICTURE = 2**26
"""Bytes of a picture that a front end sends at most: eight times that of noise in 1600 x 1200."""

Request: TypeAlias = Annotated[int, Meta(ge=1, le=LARGEST_NUMBER, description="number of the request")]
Side: TypeAlias = Annotated[int, Meta(ge=1, le=LARGEST_SIDE, description="pixels")]
Movie: TypeAlias = Annotated[str, Meta(max_length=LONGEST_ID, description="id of the movie")]
FieldBuffers = Buffers("maps, weights, distances to cuts, samples in space: those named in the field buffers", None)


class CameraData(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera, as the trait; the entries that are missing are those of the home view."""

    direction: Place3 | UnsetType | None = UNSET
    up: Place3 | UnsetType | None = UNSET
    zoom: Finite | UnsetType | None = UNSET
    pan: Place2 | UnsetType | None = UNSET
    perspective: bool | UnsetType | None = UNSET

    def value(self) -> dict[str, Any]:
        """The entries that are there."""
        return {name: entry for name, entry in structs.asdict(self).items() if entry is not UNSET}


Vector2: TypeAlias = Annotated[list[Any], Meta(extra={"typescript": "[number, number]"})]
Vector3: TypeAlias = Annotated[list[Any], Meta(extra={"typescript": "[number, number, number]"})]


class BoxData(TypedDict):
    """A box along the axes of a volume, in its own frame."""

    low: Vector3
    high: Vector3


class FramesData(TypedDict):
    """Moments of an animation."""

    count: int
    duration: Annotated[float, Meta(description="in seconds")]


# ---- drawn by Python -------------------------------------------------------------------------------------------------


class AbstractSize(Message, frozen=True, kw_only=True):
    """The size of a front end."""

    view: View
    width: Side
    height: Side
    background: Shade | UnsetType = UNSET
    origin: Annotated[
        Annotated[str, Meta(max_length=2048)] | UnsetType,
        Meta(description="address of the page, where frames come from a server"),
    ] = UNSET


class Resized(AbstractSize, frozen=True, kw_only=True, tag="size"):
    """The new size of a front end."""


class ServedHello(AbstractSize, frozen=True, kw_only=True, tag="hello"):
    """The greeting of a new front end."""


class CameraMoved(Message, frozen=True, kw_only=True, tag="camera"):
    """A camera that the user has changed."""

    view: View
    camera: CameraData
    number: Annotated[Whole, Meta(description="of the change")]


class EditView(Message, frozen=True, kw_only=True, tag="edit_view"):
    """The wish to edit the picture that the camera sees."""

    view: View
    camera: CameraData
    middle: Annotated[Place3 | UnsetType, Meta(description="place in space in the middle of the view")] = UNSET
    scale: Annotated[Finite | UnsetType, Meta(description="CSS pixels of a unit of length")] = UNSET


class SurfaceRequest(Message, frozen=True, kw_only=True, tag="surface"):
    """A request for the first visible surface along a ray in space."""

    view: View
    id: Request
    start: Place3
    ray: Annotated[Place3, Meta(description="its direction, away from the viewer")]


class SurfaceFound(Message, frozen=True, kw_only=True, tag="surface"):
    """The first visible surface along a ray."""

    view: View
    id: Annotated[int, Meta(description="number of the request")]
    place: Annotated[Vector3 | None, Meta(description="in space; null where nothing is seen")] = None


class Closed(Message, frozen=True, kw_only=True, tag="bye"):
    """The end of a front end."""

    view: View


class FrameSent(Message, frozen=True, kw_only=True, tag="frame"):
    """A picture."""

    binary: ClassVar[Buffers] = Buffers("JPEG, or two that alternate", None)

    seq: Annotated[int, Meta(description="number")]
    full: Annotated[bool, Meta(description="whether in full resolution")]
    camera: Annotated[int, Meta(description="number of the change that it shows")]
    by: Annotated[str, Meta(description="id of the front end that made it")]


class Notice(Message, frozen=True, kw_only=True, tag="notice"):
    """A text over the picture."""

    text: Annotated[str, Meta(description="empty for none")]


class Badge(Message, frozen=True, kw_only=True, tag="badge"):
    """A remark about folds."""

    text: Annotated[str, Meta(description="empty for none")]


class TrameAddress(Message, frozen=True, kw_only=True, tag="trame"):
    """The address of a server of trame, where frames come from."""

    view: View
    url: Annotated[str, Meta(description="of its page")]


ServedMessage: TypeAlias = ServedHello | Resized | CameraMoved | EditView | SurfaceRequest | Seen | Closed
SERVED: Channel[ServedMessage] = Channel(
    ("VolumeView",), ServedMessage, (FrameSent, SurfaceFound, Notice, Badge, TrameAddress, Fragment)
)

# ---- drawn in the front end ------------------------------------------------------------------------------------------


class LiveHello(Message, frozen=True, kw_only=True, tag="hello"):
    """The greeting of a new front end."""

    view: View
    largest: Annotated[int, Meta(ge=0, le=2**16, description="side of the largest 3D texture; 0 where it cannot draw")]
    renderer: Annotated[str, Meta(max_length=1000, description="name of the GPU")] = ""
    software: Annotated[bool, Meta(description="whether the CPU draws")] = True
    background: Shade | UnsetType = UNSET
    voxels: Annotated[
        Annotated[int, Meta(ge=1, le=LARGEST_NUMBER)], Meta(description="that fit into its memory, as far as known")
    ] = LARGEST_NUMBER


class ChunkRequest(Message, frozen=True, kw_only=True, tag="chunk"):
    """A request for a piece of the volume."""

    view: View
    id: Annotated[str, Meta(max_length=200, description="of the volume")]
    index: Annotated[Whole, Meta(description="of the piece")]


class Chunk(Message, frozen=True, kw_only=True, tag="chunk"):
    """A piece of the volume."""

    binary: ClassVar[Buffers] = Buffers("voxels, gzip", 1)

    view: View
    id: Annotated[str, Meta(description="of the volume")]
    index: Annotated[int, Meta(description="of the piece")]
    start: Annotated[int, Meta(description="its first voxel")]
    lag: Annotated[
        int | UnsetType,
        Meta(description="voxels after the first so many are differences from those so many before"),
    ] = UNSET


class PointsFollowed(Message, frozen=True, kw_only=True, tag="follows"):
    """The front end follows the points of an editor in space: it computes their displacement itself while they move."""

    view: View
    sender: Annotated[str, Meta(max_length=LONGEST_ID, description="of the edits of its window")]


class StillRequest(Message, frozen=True, kw_only=True, tag="still"):
    """A request to draw in Python, without WebGL."""

    view: View
    background: Shade | UnsetType = UNSET


class ToServerRenderer(Message, frozen=True, kw_only=True, tag="drawn"):
    """A message to Python's renderer."""

    view: View
    say: Annotated[ServedMessage, Meta(description="as of a VolumeView")]


class Screenshot(Message, frozen=True, kw_only=True, tag="screenshot"):
    """The picture."""

    binary: ClassVar[Buffers] = Buffers("PNG", 1, LARGEST_SENT_PICTURE)

    view: View
    id: Request


class MoviePiece(Message, frozen=True, kw_only=True, tag="movie_piece"):
    """A part of a frame."""

    binary: ClassVar[Buffers] = Buffers("bytes of a PNG", 1, LARGEST_SENT_PICTURE)

    view: View
    id: Movie
    index: Annotated[Whole, Meta(description="of the frame")]
    offset: Annotated[Whole, Meta(description="of its first byte")]
    size: Annotated[int, Meta(ge=1, le=LARGEST_SENT_PICTURE, description="bytes of the whole frame")]


class MovieFailed(Message, frozen=True, kw_only=True, tag="movie_failed"):
    """A frame that cannot be drawn."""

    view: View
    id: Movie
    message: Annotated[str, Meta(description="why")]


class Measurements(Message, frozen=True, kw_only=True, tag="stats"):
    """Measurements of the front end; those that it has not made are left out."""

    view: View
    drag_ms: Annotated[Finite | None, Meta(description="median of quick pictures")] = None
    full_ms: Annotated[Finite | None, Meta(description="of the full picture")] = None
    passes: Annotated[Finite | None, Meta(description="of the full picture")] = None
    frames: Annotated[Finite | None, Meta(description="that were drawn")] = None
    scale: Annotated[Finite | None, Meta(description="share of the full width that quick pictures have")] = None
    width: Annotated[Finite | None, Meta(description="pixels")] = None
    height: Annotated[Finite | None, Meta(description="pixels")] = None
    received: Annotated[Finite | None, Meta(description="bytes")] = None
    edits: Annotated[Finite | None, Meta(description="fits in the front end")] = None
    edit_ms: Annotated[Finite | None, Meta(description="of a fit in the front end")] = None
    sides: Annotated[Any, Meta(description="of a page without Python: sides of the box that tissue exceeds")] = None

    def numbers(self) -> dict[str, float]:
        """Those that were made."""
        fields = {name: getattr(self, name) for name in self.__struct_fields__ if name not in ("view", "sides")}
        return {name: float(value) for name, value in fields.items() if value is not None}


class PlaneData(TypedDict):
    """A plane in the volume's frame: its origin, two directions and the normal."""

    origin: Vector3
    u: Vector3
    v: Vector3
    n: Vector3


class PlaneCutData(TypedDict):
    """Cuts of a plane, but for the distances to them, which are a buffer."""

    shape: Annotated[Vector3, Meta(description="cuts, rows, columns")]
    origin: Vector2
    spacing: Vector2
    sides: Annotated[list[list[bool]], Meta(description="of each region, whether it is inside of each cut")]
    rule: Annotated[str, Meta(description="a name of CUT_RULES")]
    regions: Annotated[list[dict[str, Any]], Meta(extra={"typescript": "RegionData[]"})]
    id: Annotated[str, Meta(description="of the distances, which seldom change")]


class PlanarData(TypedDict):
    """Maps of an extrusion."""

    shape: Annotated[Vector3, Meta(description="layers, rows, columns; the layers of a region are neighbours")]
    origin: Annotated[Vector2, Meta(description="of the maps in the plane")]
    spacing: Vector2
    depth: Annotated[Vector2, Meta(description="first and last depth that the weights are for")]
    isReplicated: Annotated[bool, Meta(description="whether the weights are 1 at every depth")]
    cut: PlaneCutData | None
    softness: Annotated[float, Meta(description="width of the ramp of opacity at a cut")]
    plane: PlaneData


class SpaceCutData(TypedDict):
    """Cuts of an earlier step, sampled in space."""

    regions: int
    rule: Annotated[str, Meta(description="a name of CUT_RULES")]
    softness: float
    slope: Annotated[float, Meta(description="largest change of the displacement over a length")]


class SpaceData(TypedDict):
    """Samples of a field in space."""

    shape: Annotated[Vector3, Meta(description="along x, y, z")]
    origin: Vector3
    spacing: Vector3
    cut: NotRequired[SpaceCutData | None]


class FollowData(TypedDict):
    """The moving part of a field that follows an editor."""

    index: Annotated[int, Meta(description="of the map")]
    points: Annotated[list[Any], Meta(description="that the maps are of", extra={"typescript": "PointData[]"})]
    shapes: Annotated[
        NotRequired[dict[str, Any]],
        Meta(description="that they are of", extra={"typescript": "{ cuts: CutData[]; parts: PartData[] }"}),
    ]


class MovedData(TypedDict):
    """Points in space whose fit a field is."""

    points: Annotated[list[Any], Meta(extra={"typescript": "PointData[]"})]
    shape: Annotated[Vector3, Meta(description="nodes of the field while they move")]


class FieldContent(Message, frozen=True, kw_only=True):
    """A deformation as textures, without its message."""

    binary: ClassVar[Buffers] = FieldBuffers

    box: Annotated[BoxData, Meta(description="of the result")]
    planar: Annotated[PlanarData | None, Meta(description="maps of an extrusion")] = None
    space: Annotated[SpaceData | None, Meta(description="samples of a field that is no extrusion")] = None
    coarse: Annotated[bool, Meta(description="whether it is coarser than it could be")] = False
    frames: Annotated[FramesData | UnsetType, Meta(description="of an animation")] = UNSET
    buffers: Annotated[list[str], Meta(description="names of the buffers")] = []  # noqa: RUF012  # a Struct copies it


class FieldMaps(FieldContent, frozen=True, kw_only=True, tag="field"):
    """The deformation as textures."""

    view: Views = None
    seq: Annotated[int, Meta(description="number, to be confirmed by seen unless it is 0")]
    follow: Annotated[FollowData | None, Meta(description="what an editor moves")]
    moved: Annotated[
        MovedData | None, Meta(description="data of a fit in the front end while it moves; null where Python fits")
    ] = None


class MovieFrame(FieldContent, frozen=True, kw_only=True, tag="movie_frame"):
    """A request for a frame of a movie, with the deformation of its moment as textures."""

    view: View
    id: Movie
    index: Annotated[int, Meta(description="of the frame")]
    size: Annotated[Vector2, Meta(description="width and height in pixels")]
    looks: Annotated[dict[str, Any], Meta(description="camera, projection and the like, as the traits")]


class MovieEnd(Message, frozen=True, kw_only=True, tag="movie_end"):
    """The end of a movie: no more frames are needed."""

    view: View
    id: Movie


class DrawnByPython(Message, frozen=True, kw_only=True, tag="drawn"):
    """Notice that Python draws for this front end."""

    view: View
    info: Annotated[dict[str, Any], Meta(description="of the volume, as the trait volume_info")]


class VolumeInfo(Message, frozen=True, kw_only=True, tag="info"):
    """Notice of another volume, drawn by Python."""

    info: Annotated[dict[str, Any], Meta(description="of the volume, as the trait volume_info")]


class ScreenshotRequest(Message, frozen=True, kw_only=True, tag="screenshot"):
    """A request for the picture that is shown."""

    id: Request


LiveMessage: TypeAlias = (
    LiveHello
    | ChunkRequest
    | Seen
    | PointsFollowed
    | EditView
    | StillRequest
    | ToServerRenderer
    | Screenshot
    | MoviePiece
    | MovieFailed
    | Measurements
    | Closed
)
LIVE: Channel[LiveMessage] = Channel(
    ("LiveView",),
    LiveMessage,
    (Chunk, FieldMaps, DrawnByPython, VolumeInfo, ScreenshotRequest, MovieFrame, MovieEnd, Fragment),
)
