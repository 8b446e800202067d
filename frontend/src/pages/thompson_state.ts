// What the user has done on the page about Thompson's grids. It survives a reload, and is in a copy of the page.

import type { Vector2 } from "../types.ts";
import type { OwnDrawing } from "./own_drawing.ts";
import { includedState } from "./page_copy.ts";

export const STEPS = ["morph", "drag", "carp", "growth", "own"] as const;
export type StepName = (typeof STEPS)[number];

export interface ThompsonState {
  step: StepName;
  /** The number of the pair, from 0 */
  pair: number;
  /** Of the deformation: 0 none, 1 all of it */
  share: number;
  /** Places of the nodes that were dragged, by the number of the pair */
  dragged: Record<string, Vector2[]>;
  own: (OwnDrawing | null)[];
  /** A name for each copy that was given away: it does not take the edits of another one */
  copy: string;
}

const STORED = "deformnb.thompson"; // the key in the browser's storage

const BEGIN: ThompsonState = {
  step: "morph",
  pair: 0,
  share: 0,
  dragged: {},
  own: [null, null],
  copy: "",
};

function storedState(): ThompsonState | null {
  try {
    return JSON.parse(localStorage.getItem(STORED) ?? "null");
  } catch {
    return null; // a browser that stores nothing for a file
  }
}

/**
 * The state of the page: that of last time, else that in the page, else the first one.
 * @param pairs how many there are
 */
export function readState(pairs: number): ThompsonState {
  const included = includedState() as ThompsonState | null,
    stored = storedState();
  const isOwn =
    stored?.copy === (included?.copy ?? "") &&
    STEPS.includes(stored.step) &&
    stored.pair < pairs &&
    stored.own?.length === 2;
  return { ...BEGIN, ...(isOwn ? stored : included) };
}

/** Stores the state; false where the browser has no room, or stores nothing. */
export function storeState(state: ThompsonState): boolean {
  try {
    localStorage.setItem(STORED, JSON.stringify(state));
    return true;
  } catch {
    return false;
  }
}
