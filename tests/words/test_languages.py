"""The tables of languages, and the choice of one."""

from __future__ import annotations

import json
import re

import pytest
from words.sources import ROOT

import deformnb as dn
from deformnb.errors import DeformError
from deformnb.words import LANGUAGES, language, set_language, translate, word_table

OTHERS = [code for code in LANGUAGES if code != "en"]


@pytest.mark.parametrize("code", OTHERS)
def test_a_translation_has_the_values_of_its_key_and_is_no_other_key(code: str) -> None:
    table = word_table(code)
    for key, value in table.items():
        values = sorted(re.findall(r"\{\w+\}", key))
        assert len(set(values)) == len(values), key
        assert sorted(set(re.findall(r"\{\w+\}", value))) == values, key
        assert value == value.strip() != "", key
        assert table.get(value, value) == value, f"{key}: its translation would be translated again"


def test_keys_stand_in_the_order_of_the_alphabet() -> None:
    for code in OTHERS:
        text = (ROOT / "deformnb" / "words" / f"{code}.json").read_text("utf-8")
        assert text == json.dumps(dict(sorted(json.loads(text).items())), ensure_ascii=False, indent=0) + "\n"


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
