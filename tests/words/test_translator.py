"""The tables of words: complete for the sources, and translated equally in Python and in the front ends."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scripts import run_script
from words.sources import LESSONS, PACKAGE, ROOT, own_table, python_texts, reads_as_words, script_texts, shape, wildcard

from deformnb.widgets.bundle import SOURCES
from deformnb.words import LANGUAGES, Translator, translate, word_table

PACKAGES = (PACKAGE, LESSONS)
OTHERS = [code for code in LANGUAGES if code != "en"]

SHOWN = [
    *(PACKAGE / "widgets" / "studio").rglob("*.py"),
    *(PACKAGE / "widgets" / "inputs").glob("*.py"),
    PACKAGE / "widgets" / "parameters.py",
    PACKAGE / "widgets" / "camera.py",
    *(path for path in LESSONS.glob("*.py") if path.stem != "command"),
    PACKAGE / "session" / "examples.py",
    PACKAGE / "document" / "edits.py",
]
"""Modules of Python whose words are seen in a studio or a lesson. Texts of other modules may be keys, and need not."""

ERRORS_ONLY = ("maths", "formats", "volume", "webgl")
"""Folders of the front end whose words are errors, most of them those of Python, which stay English."""

CONSTANTS = "generated.ts"
"""The module of constants and types, whose texts are names of units, of registries and in headers of files."""

NOT_SEEN = re.compile(
    r"""
    use\ strict | .*dnb-.* | [#.]?[\w-]+:.* | <.* | .*\bstyle=.* | .*[{}]\ ?/\ ?\{.*   # styles, classes, markup
    | (Arrow(Left|Right|Up|Down)|Page(Up|Down)?|Home|End|Enter|Escape|Tab|Delete|Backspace|AltGraph)  # keys of events
    | (Alt|Shift|Control)\+.+ | [A-Z][a-z]+([A-Z]\w*)+ | row\ wrap | jupyter-.* | linear-gradient.*   # names of code
    | Studio\(.* | Editor\(.* | \w+\(\{.*                                                              # of repr
""",
    re.VERBOSE | re.DOTALL,
)


ELSEWHERE = {
    "Antigonia",
    "Polyprion",
    "Argyropelecus",
    "Sternoptyx",
    "Pseudopriacanthus",
    "Scorpaena",
    "Orthagoriscus",  # animals have the same names everywhere
    # Parts of errors.
    "a dictionary of direction, up, zoom, pan and perspective",
    "one of {}",
    "three rising pairs of shares from 0 to 1",
    "a formula in z or a tuple of numbers",
    "rising numbers from 0 to 1",
    "the page has no {} of {}",
    "the client makes no widgets itself",
    "an edit could not be sent:",
    "there is no model {}",
    "a volume or labels ({}), names of labels ({}), landmarks ({}) or a session ({})",
    # Of a page of the documentation, of repr, and names of jobs.
    " times the volume's diagonal",
    "# Parameters",
    "## Buttons",
    ", on a logarithmic scale",
    "warm up",
    "result box",
    "own grid",
    "the first drawing",
    "the second drawing",
    "xMidYMid meet",
    "from deformnb_lessons import",
    'from deformnb import set_language\n\nset_language("{}")\n',
    "offset points",
    "upper right",
    "DepthKeys(({}), selected={})",
    (
        "What can be set in the studio and, partly, in an exported page, by the names that code uses. This page is "
        "written by `python -m deformnb.widgets.generate`."
    ),
}
"""Texts of these modules that no studio shows."""


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, set[str]]:
    """Shapes of all texts, by the modules they are in."""
    found: dict[Path, set[str]] = {
        path: {text for _, text in python_texts(path, with_errors=package == LESSONS)}  # which pupils see
        for package in PACKAGES
        for path in package.rglob("*.py")
    }
    for path, text in script_texts(SOURCES, tmp_path_factory.mktemp("lowered")):
        found.setdefault(path, set()).add(text)
    return found


def package_of(module: Path) -> Path:
    """The package whose table has the words of a module; those of the front end are the core's."""
    return LESSONS if module.is_relative_to(LESSONS) else PACKAGE


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
@pytest.mark.parametrize("code", OTHERS)
def test_all_words_that_are_seen_are_in_the_table(code: str, package: Path, texts: dict[Path, set[str]]) -> None:
    table = own_table(package, code) | own_table(PACKAGE, code)
    keys, translator = list(table), Translator(table)

    def is_known(text: str) -> bool:
        """Check whether it is a key, consists of keys, or becomes one with its values or in a longer text."""
        whole, part, form = text.replace("{}", "5"), text.strip(_MARKS), wildcard(text)
        return (
            translator.knows(whole)
            or translator.knows(whole.strip(_MARKS))
            or any(map(form.fullmatch, keys))
            or (" " in part and any(part in shape(key) for key in keys))
        )

    scripts = {
        path
        for path in texts
        if path.suffix == ".ts" and path.name != CONSTANTS and path.parent.name not in ERRORS_ONLY
    }
    missing = {
        f"{path.relative_to(ROOT)}: {text}"
        for path in {*SHOWN, *scripts}
        if package_of(path) == package
        for text in texts[path]
        if reads_as_words(text) and text not in ELSEWHERE and not NOT_SEEN.fullmatch(text) and not is_known(text)
    }
    assert not missing, "\n".join([f"add to {package.name}/words/{code}.json:", *sorted(missing)])


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
@pytest.mark.parametrize("code", OTHERS)
def test_no_key_is_left_over(code: str, package: Path, texts: dict[Path, set[str]]) -> None:
    known = {text for path, found in texts.items() if package_of(path) == package for text in found}
    tables = [path.read_text("utf-8") for path in package.rglob("*.json") if path.parent.name != "words"]
    if package == PACKAGE:
        tables.append((PACKAGE / "volume" / "transfer.py").read_text("utf-8"))  # docstrings describe the presets
    in_tooltips = [text.replace(" + ", "+") for text in known]
    all_text = "\n".join([*known, *in_tooltips, *tables]).casefold()
    forms = [wildcard(text) for text in known if "{}" in text]

    def is_used(key: str) -> bool:
        """Check whether it is made of texts of the sources, or by one of them with its values."""
        parts = [part for part in shape(key).casefold().split("{}") if part.strip(_MARKS)]
        return all(part.strip(_MARKS) in all_text for part in parts) or any(form.fullmatch(key) for form in forms)

    left = [key for key in own_table(package, code) if not is_used(key)]
    assert left == [], "\n".join([f"remove from {package.name}/words/{code}.json, or follow the source:", *left])


_MARKS = " ,;.:"


CASES = [
    "Undo",
    "Undo (Ctrl+Z)",
    "3 points",
    "32 points, 28 dragged \u00b7 no folds",
    'move "tail"',
    'rename "Undo"',
    "Undo: move 3 points",
    "  Redo\n",
    "Keep\u00a0fold-free",
    "B: select several: band, taps",
    "Other words",
    "There are unsaved edits. Save the session in a.json (Ctrl+S)",
    "Node 1,2 of the grid",
    "12",
    "",
    "x",
    "a.nii: Undo",
    "Point 4 corner, at 3, 5, not dragged",
    "Point 4, at 3, 5, not dragged",
    "Save the session in $& and $1.json (Ctrl+S)",
    "Point 4 Undo, at 3, 5, dragged 3 right, 2 down, locked",
    "65.05 to 105, 16500 mm\u00b2",
    "How far it is dragged, mm",
    "How far it is dragged, in the volume's unit",
    (
        'the system is nearly singular (closest are point 6 ("move 1") and point 26): the map misses '
        "its targets by up to 0.3; a smaller support, a Wendland kernel or a little smoothing would not; control "
        "points 2 and 4 are pulled past each other: the map folds there"
    ),
]


def test_front_ends_translate_as_python_does() -> None:
    script = """({ table, texts }) => {
      const translator = new Translator(table);
      return texts.map((text) => translator.translate(text));
    }"""
    for code in OTHERS:
        table, translator = word_table(code), Translator(word_table(code))
        given = CASES + [key.replace("{n}", "3").replace("{text}", "x y") for key in table]
        found = run_script(("ui/words.ts",), script, {"table": table, "texts": given})
        assert found == [translator.translate(text) for text in given]


def test_each_sentence_of_a_text_is_translated_whatever_marks_are_within_it() -> None:
    table = {
        "one; two": "eins; zwei",
        "three. four": "drei. vier",
        "{n} of {text}: old, new": "{n} zu {text}: alt, neu",
    }
    german = Translator({**table, "near": "nah", "far": "fern"})
    for text, wanted in (
        ("one; two; near", "eins; zwei; nah"),
        ("near; one; two; three. four", "nah; eins; zwei; drei. vier"),
        ("near. three. four. one; two", "nah. drei. vier. eins; zwei"),
        ("3 of far: old, new; one; two; far", "3 zu fern: alt, neu; eins; zwei; fern"),
        ("near; other words; far", "near; other words; far"),
    ):
        assert german.translate(text) == wanted


def test_what_a_user_has_named_stays_as_it_is() -> None:
    assert translate('rename "Undo"', "de") == "\u201eUndo\u201c umbenennen"
    assert translate("Save the session in Undo (Ctrl+S)", "de") == "Sitzung in Undo speichern (Strg+S)"
