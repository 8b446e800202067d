// What gets a drag further that was stopped before tissue folds: each way is tried, those that get further become
// buttons, and one of them moves on to where the pointer was, as one edit.

import { MOST_STAGES } from "../generated.ts";
import { cleanShapes, middleOf, newPoint } from "../maths/points.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import { cutSides, isInside } from "../maths/shapes.ts";
import type { FitChange } from "../sync/edits.ts";
import type { LineData, PartData, PicturePoint, Vector2 } from "../types.ts";
import type { MapState, StoppedDrag } from "./fold_stop.ts";
import { OptionBar } from "./option_bar.ts";
import type { EditorParts } from "./parts.ts";

/** A way of a stopped drag under other settings, or with other points or parts; null where there is none. */
type Way = (share: number) => MapState | null;
/** A way that gets further, and how far. */
export type FoldOffer = { name: string; way: Way; share: number };

const SUPPORTS = [1.5, 2, 3, 4, 6, 8]; // of the reach of points
const WIDTHS = [1.6, 2.4, 3.5, 5]; // of the length of the drag: how far the tissue around follows
const FURTHER = 0.05; // of the drag: less is not offered
const TURNS = 5; // of the bisection of a way that does not reach the end
const LOOK_AGAIN = 150, // ms: from one look at the volumes to the next, and until a picture is drawn at rest
  LONGEST_REFINEMENT = 4000, // ms
  LONGEST_WAIT = 500, // ms for an idle moment
  UNFINISHED = ".dnb-view[data-drawing]";
const RING = 8; // points that hold the tissue around, and that let it follow
const NAMES: Record<string, [label: string, tip: string]> = {
  support: ["Larger support", "Points reach farther, so that the tissue around follows"],
  stages: ["In stages", "The same drag in several smaller steps, one after the other"],
  rigid: ["Move rigidly", "The tissue around moves as a rigid part; along a cut, one half of it"],
  points: ["More points", "Points around let the tissue follow, less and less far away"],
};

/** Dependencies of the offers on the editor. */
export type OffersEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "points" | "map" | "picture" | "sender",
  "foldStop" | "points" | "shapes"
>;

export class FoldOffers {
  bar: OptionBar;
  words: HTMLSpanElement;
  buttons: HTMLSpanElement;
  offers: FoldOffer[] = [];
  isTrying = false;
  #turn = 0; // of the drag that is tried; another one ends the trial

  constructor(readonly editor: OffersEditor) {
    this.bar = new OptionBar(editor, "dnb-ed-options dnb-ed-fold-bar", "Ways to continue the drag");
    this.words = this.bar.text("", { role: "status" });
    this.buttons = this.bar.text("dnb-ed-fold-buttons");
    this.bar.button("\u2715", "Leave it there", () => {
      this.drop();
      editor.stage.focus();
    });
  }

  get isShown() {
    return !this.bar.element.hidden;
  }

  /** Withdraw the offers: another edit begins. False if there are none. */
  drop() {
    this.#turn += 1;
    this.isTrying = false;
    this.offers = [];
    const was = this.isShown;
    this.bar.element.hidden = true;
    return was;
  }

  /** Offer what gets further than a drag that was stopped. */
  propose(stopped: StoppedDrag) {
    this.drop();
    void this.#try(stopped, this.#turn);
  }

  /** Try one way after the other in idle time, when all is drawn; another edit ends it. */
  async #try(stopped: StoppedDrag, turn: number) {
    const { editor } = this,
      found: FoldOffer[] = [];
    this.isTrying = true;
    await drawnPage();
    for (const [name, ways] of Object.entries(this.#ways(stopped))) {
      let best: FoldOffer | null = null;
      for (const way of ways) {
        const share = await this.#shareOf(way, Math.max(stopped.share, best?.share ?? 0), turn);
        if (share === null) return;
        if (share > stopped.share + FURTHER && share > (best?.share ?? 0)) best = { name, way, share };
        if (share === 1) break;
      }
      if (best) found.push(best);
    }
    this.isTrying = false;
    editor.frames.guard(() => this.#show(found, stopped.share));
  }

  /** How far a way gets; 0 where it gets no further than another one, null where another edit has begun. */
  async #shareOf(way: Way, known: number, turn: number): Promise<number | null> {
    const { foldStop } = this.editor.tools,
      isOver = () => turn !== this.#turn || this.editor.points.isDragging;
    const isFree = async (share: number) => {
      await idleMoment();
      if (isOver()) return false;
      const state = way(share);
      return state !== null && !foldStop.isRefused(state);
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

  // ---- the ways ------------------------------------------------------------------------------------------------------

  #ways({ make }: StoppedDrag): Record<string, Way[]> {
    const { map } = this.editor,
      stages: number[] = [];
    for (let count = 2 * (map.settings.stages ?? 1); count <= MOST_STAGES; count *= 2) stages.push(count);
    const withFit =
      (fit: FitChange): Way =>
      (share) => ({ ...make(share), fit });
    return {
      support: map.reach > 0 ? SUPPORTS.map((factor) => withFit({ support: factor * map.reach })) : [],
      stages: stages.map((count) => withFit({ stages: count })),
      rigid: [(share) => this.#rigidly(make(share))],
      points: WIDTHS.map((width) => (share: number) => this.#withFollowers(make(share), make(1), width)),
    };
  }

  /** The points of a state that the drag has moved, as they were. */
  #moved({ points }: MapState) {
    const { start } = this.editor.tools.foldStop,
      was = new Map(start.points.map((p) => [p.id, p]));
    return points.flatMap((p) => {
      const before = was.get(p.id)?.target ?? p.source;
      const by: Vector2 = [p.target[0] - before[0], p.target[1] - before[1]];
      return p.active && Math.hypot(...by) > 0 ? [{ point: p, before, by }] : [];
    });
  }

  /** The tissue around the points that are moved as a rigid part that goes with them, or their side of a cut. */
  #rigidly(state: MapState): MapState | null {
    const moved = this.#moved(state),
      by = moved[0]?.by;
    if (!by || !moved.every((one) => [0, 1].every((c) => Math.abs(one.by[c]! - by[c]!) < 1e-6 * Math.hypot(...by)))) {
      return null; // they are turned or scaled
    }
    const cuts = state.shapes.cuts.filter(({ enabled }) => enabled),
      line = cuts.length === 1 ? cuts[0]!.region : null;
    return line?.kind === "line" && !line.stops ? this.#withSide(state, line, by) : this.#withDisc(state, by);
  }

  /** All points on the side of a cut on which some are moved, moved alike: nothing on that side bends. */
  #withSide(state: MapState, line: LineData, by: Vector2): MapState | null {
    const ids = new Set(this.#moved(state).map(({ point }) => point.id)),
      { start } = this.editor.tools.foldStop,
      was = new Map(start.points.map((p) => [p.id, p.target])),
      own = state.points.filter(({ id }) => ids.has(id)),
      side = cutSides(line, this.editor.picture.box).find((one) => own.every(({ source }) => isInside(one, source)));
    if (!side) return null;
    const points = state.points.map((p) => {
      const at = was.get(p.id);
      if (ids.has(p.id) || p.locked || !at || !isInside(side, p.source)) return p;
      return { ...p, target: [at[0] + by[0], at[1] + by[1]] as Vector2 };
    });
    return { ...state, points };
  }

  /** A disc around the points that are moved, in which no other point is, as a rigid part. */
  #withDisc(state: MapState, by: Vector2): MapState | null {
    const { box } = this.editor.picture,
      moved = this.#moved(state).map(({ point }) => point),
      isFromRest = moved.every(
        ({ source, target }) =>
          Math.hypot(target[0] - source[0] - by[0], target[1] - source[1] - by[1]) < 1e-6 * Math.hypot(...by),
      );
    if (!isFromRest || state.shapes.parts.some(({ enabled }) => enabled)) return null;
    const middle = middleOf(moved.map(({ source }) => ({ target: source }))),
      away = ({ source: [a, b] }: PicturePoint) => Math.hypot(a - middle[0], b - middle[1]),
      ids = new Set(moved.map(({ id }) => id)),
      room = Math.min(
        ...state.points.filter((p) => p.active && !ids.has(p.id)).map(away),
        0.6 * Math.hypot(box[1] - box[0], box[3] - box[2]),
      ),
      radius = Math.max(1.2 * Math.max(...moved.map(away)), 0.45 * room);
    if (!(radius > 0 && radius < room)) return null;
    const motion = {
      matrix: [
        [1, 0],
        [0, 1],
      ],
      shift: by,
    } as PartData["motion"];
    const [part] = cleanShapes(
      [{ region: { kind: "polygon", vertices: ringOf(middle, radius, 16) }, motion }],
      "parts",
    );
    const parts = [...state.shapes.parts, part!];
    return findConflicts(state.points, parts, 1).length ? null : { ...state, shapes: { ...state.shapes, parts } };
  }

  /**
   * The state with the tissue around the moved points carried along, less and less with the distance: the points there
   * follow, and new ones are set around.
   * @param width of the tissue that follows, in lengths of the whole drag
   */
  #withFollowers(state: MapState, end: MapState, width: number): MapState | null {
    const moved = this.#moved(state),
      all = this.#moved(end);
    if (!moved.length || !all.length) return moved.length ? null : state;
    const { editor } = this,
      { box } = editor.picture,
      radius = width * Math.max(...all.map(({ by }) => Math.hypot(...by))),
      ids = new Set(all.map(({ point }) => point.id));
    const pull = ([a, b]: Vector2): Vector2 => {
      let near = Infinity,
        by: Vector2 = [0, 0];
      for (const one of moved) {
        const away = Math.hypot(a - one.before[0], b - one.before[1]);
        if (away < near) {
          near = away;
          by = one.by;
        }
      }
      const weight = Math.max(0, 1 - (near / radius) ** 2) ** 2;
      return [weight * by[0], weight * by[1]];
    };
    const was = new Map(editor.tools.foldStop.start.points.map((p) => [p.id, p]));
    const points = state.points.map((p) => {
      const at = was.get(p.id)?.target;
      if (ids.has(p.id) || p.locked || !p.active || !at) return p;
      const [da, db] = pull(at);
      return da || db ? { ...p, target: [at[0] + da, at[1] + db] as Vector2 } : p;
    });
    const middle = middleOf(all.map(({ point, before }) => ({ ...point, target: before })));
    const spread = Math.max(...all.map(({ before: [a, b] }) => Math.hypot(a - middle[0], b - middle[1])));
    const layered = editor.map.fitOf(editor.tools.foldStop.start.points, editor.tools.foldStop.start.shapes),
      sourceOf = editor.map.sourcesOf(layered);
    let id = editor.points.nextId(state.points);
    for (const share of [0.5, 1]) {
      for (const at of ringOf(middle, spread + share * radius, RING, share === 1 ? 0.5 : 0)) {
        const isNear = points.some(({ target: [a, b] }) => Math.hypot(a - at[0], b - at[1]) < 0.3 * radius),
          isInside = at[0] >= box[0] && at[0] <= box[1] && at[1] >= box[2] && at[1] <= box[3];
        const source = isNear || !isInside ? null : sourceOf(at);
        if (source === null) continue;
        const [da, db] = pull(at);
        points.push(newPoint(id++, source, [at[0] + da, at[1] + db]));
      }
    }
    return { ...state, points };
  }

  // ---- the bar -------------------------------------------------------------------------------------------------------

  #show(offers: FoldOffer[], share: number) {
    const { editor } = this;
    this.offers = offers;
    const stand = Math.round(100 * share);
    this.words.textContent = offers.length
      ? `Stopped before tissue folds, at ${stand} % of the drag. Continue:`
      : `Stopped before tissue folds, at ${stand} % of the drag. Drag less far, or hold fewer points`;
    this.buttons.replaceChildren();
    for (const offer of offers) {
      const [label, tip] = NAMES[offer.name]!;
      const far = Math.round(100 * offer.share);
      const button = this.bar.button(
        offer.share === 1 ? label : `${label}: ${far} %`,
        label,
        () => this.take(offer),
        tip,
      );
      button.dataset.offer = offer.name;
      this.buttons.append(button);
    }
    this.bar.element.hidden = false;
    editor.messages.announce(this.words.textContent);
    editor.frames.invalidate();
  }

  /** Continue the drag by one of the ways, as one edit. */
  take({ name, way, share }: FoldOffer) {
    const { editor } = this,
      { foldStop, points: pointTools, shapes: shapeTools } = editor.tools,
      state = way(share);
    this.drop();
    foldStop.note = "";
    foldStop.stopped = null;
    editor.stage.focus();
    if (!state) return;
    if (state.shapes !== editor.points.shapes)
      shapeTools.edit("parts", state.shapes.parts, "move rigidly", { points: state.points });
    else pointTools.edit(state.points, "move", null, state.fit);
    editor.messages.announce(`${NAMES[name]![0]}: done`);
  }

  /** Hide the bar when a tool with options of its own is on, or nothing can be edited. */
  show() {
    if (this.isShown && (this.editor.points.isLocked || this.editor.picture.isBefore)) this.drop();
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

/** Places on a circle; `turn` of a step rotates them. */
function ringOf([a, b]: Vector2, radius: number, count: number, turn: number = 0): Vector2[] {
  return Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * (k + turn)) / count;
    return [a + radius * Math.cos(angle), b + radius * Math.sin(angle)];
  });
}
