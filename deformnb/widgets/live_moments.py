"""What a live view does to go through the moments of an animation by itself."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import ipywidgets
import traitlets

from deformnb.fields import AbstractField
from deformnb.time_maps import TimeMaps
from deformnb.volume import Grid


class AbstractMoments(traitlets.HasTraits):
    """A part of a live view: the frames of an animation, and the player that says which of them is seen."""

    player = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)

    _moments: TimeMaps | None = None

    @abstractmethod
    def _hold(self, field: AbstractField | None, output: Grid | None, followed: dict[str, Any] | None,
              moments: TimeMaps | None = None) -> None:
        """Show this from now on."""

    @abstractmethod
    def _offer(self) -> None:
        """Send what is shown, as soon as a page is ready for it."""

    @abstractmethod
    def _tell_stand_in(self) -> None:
        """Let whoever draws for pages that cannot draw what is shown now."""

    def play(self, maps: TimeMaps, player: Any, *, output: Grid | None = None) -> None:
        """Show the moments of an animation as a player in the same page goes through them.

        Parameters
        ----------
        maps : of :meth:`~deformnb.animation.Animation.stack`.
        player : a :class:`~deformnb.widgets.Player`.
        output : its box is what can be seen; default is the volume's own.

        Notes
        -----
        All frames are sent once; then nothing is, however often they are played. Whatever else is shown ends it. An
        editor that the view follows is followed on: what is dragged is seen at once, also beside a moment.
        """
        self._hold(None, output, None, maps)
        self.player = player
        self._offer()
        self._tell_stand_in()

    @property
    def moments(self) -> TimeMaps | None:
        """What a player goes through now, if anything."""
        return self._moments

    def _at_present(self, field: AbstractField | None) -> AbstractField | None:
        """What is seen now: the moment of the player, if it plays something, else a field."""
        return field if self._moments is None else self._moments.field(self.player.time)
