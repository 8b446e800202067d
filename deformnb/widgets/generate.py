"""Files that are written from the package: TypeScript of the front end, and pages of the documentation.

``python -m deformnb.widgets.generate`` writes them in a checkout; a test reports a stale one. The front end gets the
constants and names that both sides need, the bounds of parameters, and the types of all messages.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from deformnb import checks
from deformnb.analysis import folds
from deformnb.document.deformation import LOOPS, MODES
from deformnb.imaging import demo, occlusion, picking, projection
from deformnb.io.files import streams
from deformnb.io.volumes import headers, nifti
from deformnb.rbf import (
    conditioning,
    cross_validation,
    exactness,
    forward,
    interpolant,
    kernels,
    newton,
    regions,
    rigid,
    slits,
    stages,
    trends,
)
from deformnb.rbf.cuts import CUT_RULES
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.forward import DIRECTIONS
from deformnb.session import inputs as session_inputs
from deformnb.volume import transfer, units, volume
from deformnb.warping import foreground
from deformnb.widgets import camera, packed_volume, textures
from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.messages import editors, inputs, record, shapes, traits, views
from deformnb.widgets.messages.record import Channel, Message
from deformnb.widgets.messages.schema import CHANNELS, bounds, fields, interface, meaning, records_in, typescript, words
from deformnb.widgets.parameters import PARAMETERS, Number
from deformnb.widgets.parameters import as_markdown as parameters_page
from deformnb.widgets.vtk import folds as vtk_folds
from deformnb.words.glossary import as_markdown as glossary_page

CONSTANTS: dict[str, tuple[object, tuple[str, ...]]] = {
    "checks": (checks, ("LARGEST_COORDINATE",)),
    "volume/volume": (volume, ("ORTHONORMAL_TOLERANCE", "SPACING_LIMITS", "ONE_VALUE", "NO_VALUE")),
    "volume/units": (units, ("UNIT_METRES", "UNIT_WORDS", "UNIT_LOWER_WORDS", "NO_UNITS")),
    "volume/transfer": (
        transfer,
        (
            "HISTOGRAM_SLICES",
            "BINS",
            "OUTLIERS",
            "AIR_SHARE",
            "NEAR_AIR",
            "NEAR_TISSUE",
            "STRETCH",
            "FEW_VOXELS",
            "AIR_HU",
            "BONE_HU",
            "NOTHING_HU",
            "RESAMPLED",
            "FINEST",
        ),
    ),
    "rbf/conditioning": (
        conditioning,
        (
            "LARGEST_SET",
            "SAME_PLACE",
            "SAME_DISPLACEMENT",
            "LONGEST_SHARE",
            "COLLAPSED",
            "FAR_BEHIND",
            "SAME_DISTANCE",
            "NEAREST",
            "NEAREST_AND_EQUAL",
        ),
    ),
    "rbf/cross_validation": (cross_validation, ("MOST_LEFT_OUT",)),
    "rbf/exactness": (exactness, ("RESIDUAL", "ROUNDING", "MOST_MISSED")),
    "rbf/interpolant": (interpolant, ("MOST_GAIN", "STEEP")),
    "rbf/kernels": (kernels, ("TINY",)),
    "rbf/trends": (trends, ("NO_ANGLE", "FLAT", "THIN", "THIN_BEND", "SOFTNESS", "LEAST_SPREAD")),
    "rbf/regions": (regions, ("LARGEST_SHAPE",)),
    "rbf/rigid": (rigid, ("SAME_MOTION",)),
    "rbf/slits": (slits, ("MOST_SLITS",)),
    "rbf/stages": (stages, ("MOST_STAGES",)),
    "rbf/newton": (newton, ("SHORTEST_STEP",)),
    "rbf/forward": (forward, ("AIM", "FOUND", "MOST_NEWTON_STEPS", "SEEDS", "SEEDS_AROUND", "TRIED")),
    "analysis/folds": (folds, ("NEARLY_FOLDED",)),
    "warping/foreground": (foreground, ("LEAVES", "PICTURE_SIDES", "CUT_OFF", "LARGER_BOX", "LARGER_BOX_TIP")),
    "imaging/occlusion": (occlusion, ("AMBIENT_CELL", "AMBIENT_NEAR", "AMBIENT_FAR", "AMBIENT_AHEAD", "AMBIENT_EVEN")),
    "imaging/demo": (demo, ("SUBJECT_LEVEL", "SUBJECT_SHARE")),
    "imaging/picking": (picking, ("FAINT_VALUE",)),
    "imaging/projection": (projection, ("SATURATED", "METAL")),
    "io/files/streams": (streams, ("MOST_PACKED",)),
    "io/volumes/headers": (headers, ("HEADER_BYTES", "MOST_SKIPPED")),
    "io/volumes/nifti": (nifti, ("FIRST_VOXEL", "LABEL_INTENT", "MOST_EXTENSIONS")),
    "session/inputs": (session_inputs, ("SILHOUETTE_SMOOTHING",)),
    "widgets/camera": (camera, ("VIEW_AIR", "SMALLEST_SHARE")),
    "widgets/packed_volume": (packed_volume, ("MOST_VOXELS_SENT", "PACKED_CHUNK_BYTES")),
    "widgets/textures": (textures, ("MAP_SIZE", "MOST_REGIONS", "CUT_MARGIN", "CUT_STEPS")),
    "widgets/vtk/folds": (vtk_folds, ("MOST_BENDS",)),
    "widgets/messages/record": (record, ("LONGEST_EDIT",)),
    "widgets/messages/editors": (editors, ("LONGEST_KIND", "MOST_CHANGES", "MOST_NAMED", "WINDOWS_AROUND")),
    "widgets/messages/shapes": (shapes, ("MOST_PARTS",)),
    "widgets/messages/inputs": (inputs, ("LONGEST_ROW_NAME", "MOST_KEYS")),
    "widgets/messages/views": (views, ("LARGEST_SIDE", "MOVIE_PIECE")),
}
"""The modules, and the constants of each that the front end needs too; their reasons are there."""

NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "KERNELS": ("Kernel", tuple(sorted(kernels.BUILT_IN))),
    "TRENDS": ("Trend", tuple(trends.TRENDS)),
    "DIRECTIONS": ("Direction", tuple(DIRECTIONS)),
    "EXTRUSIONS": ("Extrusion", tuple(EXTRUSIONS)),
    "CUT_RULES": ("CutRule", tuple(CUT_RULES)),
    "MODES": ("Mode", tuple(MODES)),
    "LOOPS": ("Loop", tuple(LOOPS)),
    "OVERLAYS": ("Overlay", traits.OVERLAYS),
    "SHOWS": ("Shows", tuple(camera.SHOWS)),
    "COMPARISONS": ("Comparison", tuple(camera.COMPARISONS)),
}
"""Names that both sides know: of each list the type of one, and the names."""


def as_typescript() -> str:
    """The module of the front end.

    Examples
    --------
    >>> "export const MOST_STAGES = 64;" in as_typescript()
    True
    """
    lines = ["// Written by: python -m deformnb.widgets.generate. Change the modules of the package that it names."]
    for name, (module, constants) in CONSTANTS.items():
        lines += ["", f"// deformnb/{name}.py"]
        lines += [_constant(constant, getattr(module, constant)) for constant in constants]
    lines += ["", "// Kernels and trends in their order, without the formulas: deformnb/rbf/kernels.py, trends.py"]
    lines += [_table("KERNEL_FACTS", {name: _kernel_facts(kernels.KERNELS[name]) for name in _built_in()})]
    lines += [_table("TREND_FACTS", {name: {"title": t.title, "order": t.order} for name, t in trends.TRENDS.items()})]
    lines += ["", "// Names that the registries of the package have."]
    for name, (kind, names) in NAMES.items():
        lines.append(f"export const {name} = {json.dumps(names)} as const;")
        lines.append(f"export type {kind} = (typeof {name})[number];")
    lines += [
        "",
        "// Bounds of numbers that a user sets: deformnb/widgets/parameters.py",
        "export const PARAMETER_BOUNDS = {",
    ]
    for name, parameter in PARAMETERS.items():
        if isinstance(parameter, Number):
            numbers = {key: getattr(parameter, key) for key in ("low", "high", "step", "digits")}
            lines.append(f"  {name}: {_object(numbers)},")
    lines += ["} as const;", f"export type ParameterName = {' | '.join(json.dumps(name) for name in PARAMETERS)};"]
    lines += ["", "// Messages: deformnb/widgets/messages", *_messages()]
    return "\n".join(lines) + "\n"


def _built_in() -> list[str]:
    return [name for name in kernels.KERNELS if name in kernels.BUILT_IN]


def _kernel_facts(kernel: type[kernels.AbstractKernel]) -> dict[str, Any]:
    """Facts of a kernel for front ends; ``share`` is the usual of its shares."""
    share, gaps = kernel.shares[len(kernel.shares) // 2], kernel.gaps
    return {"title": kernel.title, "order": kernel.order, "compact": kernel.compact, "share": share, "gaps": gaps}


def _table(name: str, rows: dict[str, dict[str, Any]]) -> str:
    lines = [f"  {key}: {_object(row)}," for key, row in rows.items()]
    return "\n".join([f"export const {name} = {{", *lines, "};"])


def _object(row: dict[str, Any]) -> str:
    """An object; Python writes an infinite number as JavaScript does."""
    return f"{{ {', '.join(f'{key}: {json.dumps(value)}' for key, value in row.items())} }}"


def _constant(name: str, value: Any) -> str:
    is_by_number = isinstance(value, dict) and all(isinstance(key, int) for key in value)
    is_fixed = is_by_number or (isinstance(value, tuple) and not any(isinstance(item, str) for item in value))
    return f"export const {name} = {json.dumps(value)}{' as const' if is_fixed else ''};"


def _records() -> list[type]:
    needed = [part for channel in CHANNELS for message in channel.all for part in records_in(message)]
    return [*dict.fromkeys([*needed, *(part for kind in _ALSO for part in records_in(kind))])]


def _messages() -> Iterator[str]:
    sent = {message for channel in CHANNELS for message in channel.to_front_end}
    for kind in _records():
        yield ""
        yield interface(kind, is_received=issubclass(kind, Message) and kind not in sent)
    for name, union in UNIONS.items():
        yield ""
        yield f"/** {' or '.join(part.__name__ for part in get_args(union))}. */"
        yield f"export type {name} = {typescript(union)};"
    for channel in CHANNELS:
        for way, messages in (("ToPython", channel.incoming_records), ("ToFrontEnd", channel.to_front_end)):
            if messages:
                yield ""
                yield f"/** Any message of {', '.join(channel.widgets)}. */"
                yield f"export type {channel.widgets[0]}{way} = {' | '.join(m.__name__ for m in messages)};"


UNIONS: dict[str, Any] = {"RegionData": shapes.RegionData}
"""Names of unions that the front end needs, in addition to those of all messages of a widget."""

# Shapes of field values that are plain dictionaries when they are sent.
_ALSO: tuple[Any, ...] = (
    editors.PaneContent,
    shapes.CutData,
    shapes.PartData,
    views.CameraData,
)


def messages_page() -> str:
    """The page of the documentation about messages."""
    lines = [
        "# Messages between Python and the front ends",
        "",
        "JSON objects with a `type`, and binary buffers next to them. The rest of a widget is synced traits.",
        "A question mark behind a name means that it may be missing. A message that is wrong is one line in the log.",
        "This page is written by `python -m deformnb.widgets.generate`.",
        "",
    ]
    for channel in CHANNELS:
        lines += [f"## {', '.join(channel.widgets)}", "", "| type | | fields | buffers |", "|---|---|---|---|"]
        lines += list(_rows(channel))
        lines.append("")
    lines += ["## Data", "", "| name | | fields |", "|---|---|---|"]
    data = [kind for kind in _records() if not issubclass(kind, Message)]
    lines += [f"| `{kind.__name__}` | {_about(kind)} | {_fields(kind)} |" for kind in data]
    return "\n".join(lines) + "\n"


def _rows(channel: Channel[Any]) -> Iterator[str]:
    for way, messages in (("to Python", channel.incoming_records), ("to the front end", channel.to_front_end)):
        for message in messages:
            about = f"{way}: {_about(message)}"
            yield f"| `{message.tag()}` | {about} | {_fields(message)} | {message.binary.about} |"


def _about(kind: type) -> str:
    return str(kind.__doc__).splitlines()[0]


def _fields(kind: type) -> str:
    said = []
    for name, hint, has_default in fields(kind):
        notes = "; ".join(part for part in (meaning(hint), bounds(hint)) if part)
        said.append(f"`{name}{'?' if has_default else ''}` ({words(hint)}) {notes}".strip().replace("|", "\\|"))
    return "; ".join(said)


def files() -> Mapping[Path, str]:
    """Paths in a checkout, and their contents."""
    root = SOURCES.parents[1]
    return {
        SOURCES / "generated.ts": as_typescript(),
        root / "docs" / "messages.md": messages_page(),
        root / "docs" / "parameters.md": parameters_page(),
        root / "docs" / "glossary.md": glossary_page(),
    }


if __name__ == "__main__":
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
