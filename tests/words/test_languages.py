"""The tables of languages, and the choice of one."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from words.sources import LESSONS, PACKAGE, own_table

import deformnb as dn
import deformnb_lessons
from deformnb.errors import DeformError
from deformnb.words import LANGUAGES, add_tables, language, set_language, translate, word_table

OTHERS = [code for code in LANGUAGES if code != "en"]


@pytest.mark.parametrize("code", OTHERS)
def test_a_translation_has_the_values_of_its_key_and_is_no_other_key(code: str) -> None:
    assert deformnb_lessons.LESSONS  # it has added its words
    table = word_table(code)
    assert table.keys() >= own_table(LESSONS, code).keys()
    for key, value in table.items():
        values = sorted(re.findall(r"\{\w+\}", key))
        assert len(set(values)) == len(values), key
        assert sorted(set(re.findall(r"\{\w+\}", value))) == values, key
        assert value == value.strip() != "", key
        assert table.get(value, value) == value, f"{key}: its translation would be translated again"


def test_keys_stand_in_the_order_of_the_alphabet() -> None:
    for code in OTHERS:
        for package in (PACKAGE, LESSONS):
            text = (package / "words" / f"{code}.json").read_text("utf-8")
            assert text == json.dumps(dict(sorted(json.loads(text).items())), ensure_ascii=False, indent=0) + "\n"


def test_no_word_stands_in_two_tables() -> None:
    assert {path.stem for path in (LESSONS / "words").iterdir()} <= set(OTHERS)
    for code in OTHERS:
        assert own_table(PACKAGE, code).keys() & own_table(LESSONS, code).keys() == set()


def test_another_package_adds_words_and_changes_none(tmp_path: Path) -> None:
    assert translate("Undo the knot", "de") == "Undo the knot"
    (tmp_path / "de.json").write_text('{"Undo the knot": "Knoten lösen", "Undo": "Lösen"}', encoding="utf-8")
    add_tables(tmp_path)
    add_tables(tmp_path)
    assert translate("Undo the knot", "de") == word_table("de")["Undo the knot"] == "Knoten lösen"
    assert translate("Undo", "de") == "Rückgängig"
    assert word_table("en") == {}


def test_the_language_is_chosen_for_all_by_a_call_or_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    dn.set_language(None)
    monkeypatch.setenv("DEFORMNB_LANGUAGE", "de")
    assert language() == "de"
    dn.set_language("en")
    assert language() == "en"
    assert language("de") == "de"
    dn.set_language(None)
    assert language() == "de"
    dn.set_language("en")
    monkeypatch.setenv("DEFORMNB_LANGUAGE", "xx")
    with pytest.raises(DeformError, match="unknown language 'xx'; choose one of en \\(English\\), de \\(Deutsch\\)"):
        set_language("xx")
    assert translate("Undo") == "Undo"
    dn.set_language(None)
