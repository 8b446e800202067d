"""Words among which one chooses: each closed registry has a Literal with its keys, and public functions name it.

``tests/wrong_words.py`` has a call with a wrong word for each of them; mypy, which checks that file with the package,
must find an error in each of its lines, since a remark that none is found is itself an error.
"""

from __future__ import annotations

import importlib
import inspect
import re
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import get_args

import pytest
from test_entrances import public

from deformnb.datasets.darcy import CELLS, HEADS, SCALES
from deformnb.datasets.registry import DATASETS
from deformnb.document.deformation import EASINGS, LOOPS, MODES
from deformnb.document.transplant import ALIGNMENTS
from deformnb.imaging.drawing import STYLES
from deformnb.imaging.figures import WHERE
from deformnb.imaging.movie_frames import FRAME_CONTENTS
from deformnb.imaging.projection import OF_CHANNELS, PROJECTIONS
from deformnb.imaging.render import RENDERERS
from deformnb.imaging.thompson import GRID_OVERLAYS
from deformnb.io.volumes.dicom import UNEVEN
from deformnb.io.volumes.ome_zarr import VERSIONS
from deformnb.rbf.cuts import CUT_RULES
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.forward import DIRECTIONS
from deformnb.rbf.kernels import BUILT_IN
from deformnb.rbf.rigid import HELD_POINT_RULES, WEIGHTS
from deformnb.rbf.support import SUPPORT_RULES
from deformnb.rbf.trends import TRENDS
from deformnb.registration.similarity import MEASURES
from deformnb.session.examples import EXAMPLES
from deformnb.volume.channels import CHANNEL_KINDS
from deformnb.volume.colour_maps import COLOUR_MAPS
from deformnb.volume.sampling import METHODS
from deformnb.volume.transfer import PRESETS
from deformnb.volume.views import VIEWS
from deformnb.widgets.studio.studio import VIEW_KINDS
from deformnb.widgets.view.stills import VIEW_METHODS
from deformnb.widgets.view.volume_view import TRANSPORTS

ROOT = Path(__file__).resolve().parent.parent

REGISTRIES: dict[str, Collection[str]] = {
    "AlignmentName": ALIGNMENTS,
    "CellRule": CELLS,
    "ChannelKind": CHANNEL_KINDS,
    "ChannelProjectionName": OF_CHANNELS,
    "ColourMapName": COLOUR_MAPS,
    "CutRuleName": CUT_RULES,
    "DatasetName": DATASETS,
    "EasingName": EASINGS,
    "ExampleName": EXAMPLES,
    "ExtrusionName": EXTRUSIONS,
    "FitDirection": DIRECTIONS,
    "FrameContent": FRAME_CONTENTS,
    "GridOverlay": GRID_OVERLAYS,
    "HeadSide": HEADS,
    "HeldPointRule": HELD_POINT_RULES,
    "KernelName": BUILT_IN,
    "LoopName": LOOPS,
    "MeasureName": MEASURES,
    "ModeName": MODES,
    "OmeZarrVersion": VERSIONS,
    "PointPlace": WHERE,
    "PresetName": PRESETS,
    "ProjectionName": PROJECTIONS,
    "RendererName": ("auto", *RENDERERS),
    "RigidWeightName": WEIGHTS,
    "SamplingName": METHODS,
    "ScaleName": SCALES,
    "StyleName": STYLES,
    "SupportRuleName": SUPPORT_RULES,
    "TransportName": TRANSPORTS,
    "TrendName": TRENDS,
    "UnevenSlices": UNEVEN,
    "ViewKind": VIEW_KINDS,
    "ViewMethodName": VIEW_METHODS,
    "ViewName": VIEWS,
}
"""The Literals of closed registries. One may register kernels, so parameters take any text beside KernelName."""

WITHOUT_A_REGISTRY = {"MaskForm", "RecoveryCommand"}

_ALIAS = re.compile(r"^(\w+): TypeAlias = (?:Annotated\[)?Literal\[", re.MULTILINE)


def aliases() -> dict[str, str]:
    """Module of each Literal that has a name; those of messages are compared with the front end elsewhere."""
    found = {}
    for file in sorted((ROOT / "deformnb").rglob("*.py")):
        if "messages" not in file.parts:
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            found |= dict.fromkeys(_ALIAS.findall(file.read_text(encoding="utf-8")), module)
    return found


def test_every_literal_has_its_registry() -> None:
    assert set(aliases()) - WITHOUT_A_REGISTRY == set(REGISTRIES)


@pytest.mark.parametrize("name", REGISTRIES)
def test_the_words_of_a_literal_are_the_keys_of_its_registry(name: str) -> None:
    words = get_args(getattr(importlib.import_module(aliases()[name]), name))
    assert len(words) == len(set(words))
    if name == "KernelName":
        assert set(words) == set(BUILT_IN)
    else:
        assert words == tuple(REGISTRIES[name])


FREE = {
    "about": "text of a page",
    "alternatives": "text",
    "code": "a language, for which anyone adds a table",
    "curve": "a formula",
    "dtype": "a type of NumPy",
    "label": "text of the history",
    "labels": "text",
    "language": "as code",
    "lessons": "an address",
    "memory": "a number with a unit",
    "name": "given by the user",
    "names": "given by the user",
    "own": "an expression",
    "path": "a file",
    "point": "a point by the name that the user gave it",
    "points": "as point",
    "like": "a file",
    "nodes": "a file",
    "scalars": "an array's name in pyvista",
    "series": "a series of DICOM",
    "source": "an expression, or a file",
    "suffix": "of a file",
    "text": "content of a file",
    "title": "text of a page",
    "unit": "a symbol or a name in several languages",
    "volume": "an expression",
}
"""Parameters that any text may fill, and what it is."""

ROWS = re.compile(r"^(lessons\.|datasets\.(registry|darcy)\.(Dataset|ThompsonGrid)\b|datasets\.phantoms\.Phantom\b)")
"""Classes of which the package itself makes the rows."""

OTHERS = {
    "errors.raise_missing_jax(what)": "words of a message",
    "document.json_regions.region_from_data(where)": "words of a message",
    "io.volumes.formats.FileDescription(format)": "text for people",
    "io.volumes.formats.Format(description)": "text for people",
    "document.deformation.VolumeReference(sha256)": "a checksum",
    "volume.transfer.TransferFunction.with_colors(stops)": "names of colours",
    "volume.volume.Volume.plot(method)": "as of project, in a package above that of volumes",
    "volume.plane.Picture(method)": "the projection of which it was made, also of other programs",
    "widgets.editor.editor.Editor.propose(kind)": "name of an edit",
    "widgets.embedded_page.EmbeddedPage(page)": "HTML",
    "widgets.view.live_view.LiveView.is_moved_in_client(sender)": "id of a widget",
}


def test_public_functions_take_a_literal_where_there_is_a_choice() -> None:
    open_texts = set()
    for one in public():
        try:
            parameters = inspect.signature(one).parameters.values()
        except (TypeError, ValueError):
            continue
        for given in parameters:
            where = f"{one.__module__.removeprefix('deformnb.')}.{one.__qualname__}({given.name})"
            words = re.split(r"[^\w.\[\]]+", given.annotation) if isinstance(given.annotation, str) else []
            is_open = "str" in words and not {"KernelName", "PathLike[str]", "os.PathLike[str]"} & set(words)
            if is_open and given.name not in FREE and not ROWS.match(where) and "deformnb_" not in where:
                open_texts.add(where)
    assert open_texts == set(OTHERS)


def test_a_wrong_word_of_every_literal_is_checked_by_mypy() -> None:
    text = (ROOT / "tests/wrong_words.py").read_text(encoding="utf-8")
    files = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]["files"]
    assert "tests/wrong_words.py" in files
    named = re.findall(r"# type: ignore\[[\w-]+\]  # (\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(set(REGISTRIES) - {"KernelName"})
