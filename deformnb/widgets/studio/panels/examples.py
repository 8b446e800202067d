"""Examples to try: in the head's menu, and over the picture while nothing is deformed."""

from __future__ import annotations

from collections.abc import Callable

from deformnb.document.deformation import Deformation
from deformnb.session.examples import EXAMPLES, ExampleName, apply_example, fitting_examples
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, line
from deformnb.widgets.studio.controls import Guard, Panel, button, prose

_FIRST = "Or try an example:"
_MENU = "Each takes the place of the step that is edited; one undo takes it back."


class ExamplesPanel(Panel):
    """Buttons that apply an example.

    Parameters
    ----------
    is_start : shown only while nothing is deformed.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((16, 16, 24)))
    >>> panel = ExamplesPanel(session, lambda action: action() or True, is_start=True)
    >>> panel.buttons["bend"].click()
    >>> len(session.editing.points), panel.box.is_visible
    (15, False)
    """

    def __init__(self, session: Session, guard: Guard, *, is_start: bool = False) -> None:
        super().__init__(session, guard)
        self._is_start = is_start
        self.buttons = {
            name: button(example.title, example.tooltip, self._applier(name)) for name, example in EXAMPLES.items()
        }
        words = basic.HTML(prose(_FIRST if is_start else _MENU))
        self.box = column(words, line(*self.buttons.values(), flex_flow="row wrap"))
        self.refresh()

    def _applier(self, name: ExampleName) -> Callable[[], None]:
        def apply() -> None:
            self.guard(lambda: apply_example(self.session, name))
            self.refresh()

        return apply

    def arrange(self) -> None:
        fitting = fitting_examples(self.session)
        for name, made in self.buttons.items():
            basic.set_visible(made, name in fitting)
        if self._is_start:
            is_empty = self.session.editing.step.plane is not None and is_untouched(self.session.editing.deformation)
            basic.set_visible(self.box, is_empty)


def is_untouched(deformation: Deformation) -> bool:
    """Check that no point was dragged and that there is neither a cut nor a rigid part."""
    return not any(
        step.cuts or step.parts or any(m.displacement.any() for m in step.maps) for step in deformation.steps
    )
