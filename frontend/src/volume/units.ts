// Units of length, by the table and the rules of deformnb/volume/units.py.

import { shownText } from "../formats/reading.ts";
import { NO_UNITS, UNIT_LOWER_WORDS, UNIT_METRES, UNIT_WORDS } from "../generated.ts";
import { perAxis } from "../maths/axes.ts";

const WORDS: Record<string, string> = UNIT_WORDS,
  LOWER: Record<string, string> = UNIT_LOWER_WORDS;
const METRES: Record<string, number> = UNIT_METRES;

/** The symbol of a unit as a file names it; "" for words that mean none, null for other words. */
export function findUnit(text: string) {
  let word = text.replace(/\\u([0-9a-fA-F]{4})/g, (_, code) => String.fromCharCode(parseInt(code, 16))).trim();
  if (word.length > 1) word = word.replace(/^["']+|["']+$/g, "").trim();
  const lower = word.toLowerCase();
  if (NO_UNITS.includes(lower)) return "";
  if (Object.hasOwn(WORDS, word)) return WORDS[word]!;
  return Object.hasOwn(LOWER, lower) ? LOWER[lower]! : null;
}

/** The unit that a file states; one that is not known is reported in a note. */
export function statedUnit(text: string, notes: string[]) {
  const found = findUnit(text);
  if (found !== null) return found;
  const note = `the file gives lengths in '${shownText(text)}', which is no known unit; its numbers stay as they are`;
  if (!notes.includes(note)) notes.push(note);
  return "";
}

/** Ratio of one unit to another; 1 where either is not known. */
export function unitRatio(unit: string, to: string) {
  return unit && to ? METRES[unit]! / METRES[to]! : 1;
}

/**
 * The unit for axes x, y, z that have one each, and by how much the numbers of each are multiplied; with a note.
 */
export function commonUnit(units: string[], notes: string[]) {
  const unit = units.find((one) => one) ?? "",
    factors = perAxis((k) => unitRatio(units[k] ?? "", unit));
  if (new Set(units).size > 1) {
    const each = units.map((one, k) => "xyz"[k] + (one ? ` in ${one}` : " without a unit")).join(", ");
    notes.push(`the axes of the file are measured in different units (${each}); all are in ${unit} now`);
  }
  return { unit, factors };
}
