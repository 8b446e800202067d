"""Menu of presets of colours and opacities, each with a picture of the volume in its colours."""

from __future__ import annotations

from typing import Any

import traitlets

from deformnb.volume.transfer import PRESETS
from deformnb.widgets.bundle import bundle
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.synced import SyncedWidget


class PresetMenu(SyncedWidget):
    """A menu of the presets of a transfer editor, with its pictures.

    Parameters
    ----------
    editor : makes the pictures of its volume.

    Attributes
    ----------
    value : name of a preset, or empty for colours of one's own.
    disabled : whether it takes no choice.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> editor = TransferEditor(PHANTOMS["bar"].make((8, 8, 8)), "bone")
    >>> menu = PresetMenu(editor)
    >>> menu.value = editor.preset_name
    >>> menu.value, list(menu.presets)[:2]
    ('bone', ['specimen', 'bone'])
    >>> menu.close()
    """

    _esm = bundle("preset_menu.js")
    _css = bundle("preset_menu.css")

    value = traitlets.Enum(["", *PRESETS], "").tag(sync=True)
    disabled = traitlets.Bool(False).tag(sync=True)
    presets = traitlets.Dict(read_only=True, help="what each preset shows, by its name").tag(sync=True)
    thumbnails = traitlets.Dict(help="as those of the editor").tag(sync=True)

    def __init__(self, editor: TransferEditor, **traits: Any) -> None:
        super().__init__(**traits)
        self.set_trait("presets", editor.presets)
        traitlets.dlink((editor, "thumbnails"), (self, "thumbnails"))
