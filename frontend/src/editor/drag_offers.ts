// What gets a drag further that was stopped before tissue folds: each way is tried, those that get further become
// buttons of a message, and one of them moves on to where the pointer was, as one edit.

import { MOST_STAGES } from "../generated.ts";
import type { FitChange } from "../sync/edits.ts";
import type { Frames } from "./frames.ts";
import type { Messages } from "./messages.ts";

/** A drag that was stopped: the state at each share of its way, and the share at which it stands. */
export interface StoppedDrag<S> {
  make: (share: number) => S;
  share: number;
}

/** A way of a stopped drag under other settings, or with other points or parts; null where there is none. */
export type Way<S> = (share: number) => S | null;
/** A way that gets further, and how far. */
export type FoldOffer<S> = { name: string; way: Way<S>; share: number };

/** What shows the offers, and takes the focus back. */
export interface OffersHost {
  frames: Pick<Frames, "guard" | "invalidate">;
  messages: Pick<Messages, "announce" | "set">;
  stage: { focus(): void };
}

const SUPPORTS = [1.5, 2, 3, 4, 6, 8]; // of the reach of points
export const FOLLOWERS = [1.6, 2.4, 3.5, 5]; // of the length of the drag: how far the tissue around follows
const FURTHER = 0.05; // of the drag: less is not offered
const TURNS = 5; // of the bisection of a way that does not reach the end
const LOOK_AGAIN = 150, // ms: from one look at the volumes to the next, and until a picture is drawn at rest
  LONGEST_REFINEMENT = 4000, // ms
  LONGEST_WAIT = 500, // ms for an idle moment
  UNFINISHED = ".dnb-view[data-drawing]";
const NAMES: Record<string, [label: string, tip: string]> = {
  support: ["Larger support", "Points reach farther, so that the tissue around follows"],
  stages: ["In stages", "The same drag in several smaller steps, one after the other"],
  rigid: ["Move rigidly", "The tissue around moves as a rigid part; along a cut, one half of it"],
  corners: ["Free the corners", "The points that hold the corners of the picture are removed"],
  points: ["More points", "Points around let the tissue follow, less and less far away"],
};

/** The same drag with a larger support and with more stages. */
export function fitWays<S extends object>(
  make: (share: number) => S,
  reach: number,
  stages: number,
): Record<string, Way<S & { fit?: FitChange }>[]> {
  const counts: number[] = [];
  for (let count = 2 * stages; count <= MOST_STAGES; count *= 2) counts.push(count);
  const withFit = (fit: FitChange) => (share: number) => ({ ...make(share), fit });
  return {
    support: reach > 0 ? SUPPORTS.map((factor) => withFit({ support: factor * reach })) : [],
    stages: counts.map((count) => withFit({ stages: count })),
  };
}

/** Offers of the editor of a picture, or in space, whose states are S. */
export abstract class DragOffers<S> {
  isShown = false;
  isTrying = false;
  #turn = 0; // of the drag that is tried; another one ends the trial
  readonly #host: OffersHost;

  constructor(host: OffersHost) {
    this.#host = host;
  }

  /** Ways of a stopped drag by their names, of each the first choices first. */
  protected abstract ways(stopped: StoppedDrag<S>): Record<string, Way<S>[]>;

  /** Whether a state folds tissue. */
  protected abstract isRefused(state: S): boolean;

  /** Whether something is dragged again. */
  protected abstract get isBusy(): boolean;

  /** Make the edit of a way. */
  protected abstract apply(state: S, name: string): void;

  /** Withdraw the offers: another edit begins. */
  drop() {
    this.#turn += 1;
    this.isTrying = false;
    this.isShown = false;
    this.#host.messages.set("offers", "");
  }

  /** Offer what gets further than a drag that was stopped. */
  propose(stopped: StoppedDrag<S>) {
    this.drop();
    void this.#try(stopped, this.#turn);
  }

  /** Try one way after the other in idle time, when all is drawn; another edit ends it. */
  async #try(stopped: StoppedDrag<S>, turn: number) {
    const found: FoldOffer<S>[] = [];
    this.isTrying = true;
    await drawnPage();
    for (const [name, ways] of Object.entries(this.ways(stopped))) {
      let best: FoldOffer<S> | null = null;
      for (const way of ways) {
        const share = await this.#shareOf(way, Math.max(stopped.share, best?.share ?? 0), turn);
        if (share === null) return;
        if (share > stopped.share + FURTHER && share > (best?.share ?? 0)) best = { name, way, share };
        if (share === 1) break;
      }
      if (best) found.push(best);
    }
    this.isTrying = false;
    this.#host.frames.guard(() => this.#show(found, stopped.share));
  }

  /** How far a way gets; 0 where it gets no further than another one, null where another edit has begun. */
  async #shareOf(way: Way<S>, known: number, turn: number): Promise<number | null> {
    const isOver = () => turn !== this.#turn || this.isBusy;
    const isFree = async (share: number) => {
      await idleMoment();
      if (isOver()) return false;
      const state = way(share);
      return state !== null && !this.isRefused(state);
    };
    if (await isFree(1)) return 1;
    if (isOver()) return null;
    if (known + FURTHER >= 1 || !(await isFree(known + FURTHER))) return isOver() ? null : 0;
    let low = known + FURTHER,
      high = 1;
    for (let k = 0; k < TURNS; k++) {
      const middle = (low + high) / 2;
      if (await isFree(middle)) low = middle;
      else high = middle;
      if (isOver()) return null;
    }
    return low;
  }

  // ---- the message ---------------------------------------------------------------------------------------------------

  #show(offers: FoldOffer<S>[], share: number) {
    const { frames, messages, stage } = this.#host,
      end = offers.length ? "Continue:" : "Drag less far, or hold fewer points";
    const actions = offers.map((offer) => {
      const [label, tip] = NAMES[offer.name]!,
        text = offer.share === 1 ? label : `${label}: ${Math.round(100 * offer.share)} %`;
      return { name: offer.name, text, tip, act: () => frames.guard(() => this.take(offer)) };
    });
    this.isShown = true;
    messages.set("offers", `Stopped before tissue folds, at ${Math.round(100 * share)} % of the drag. ${end}`, {
      kind: "warning",
      actions,
      closed: () => stage.focus(),
    });
    frames.invalidate();
  }

  /** Continue the drag by one of the ways, as one edit. */
  take({ name, way, share }: FoldOffer<S>) {
    const state = way(share);
    this.drop();
    this.#host.stage.focus();
    if (!state) return;
    this.apply(state, name);
    this.#host.messages.announce(`${NAMES[name]![0]}: done`);
  }
}

/** An idle moment of the page: each check fits all points, and waits for the pointer and for pictures. */
function idleMoment() {
  return new Promise<unknown>((resume) => {
    if ("requestIdleCallback" in globalThis) requestIdleCallback(resume, { timeout: LONGEST_WAIT });
    else setTimeout(resume);
  });
}

/** The page with no volume under way: the last pictures of a drag come before what might continue it. */
async function drawnPage() {
  const end = performance.now() + LONGEST_REFINEMENT;
  do await new Promise((resume) => setTimeout(resume, LOOK_AGAIN));
  while (document.querySelector(UNFINISHED) && performance.now() < end);
}
