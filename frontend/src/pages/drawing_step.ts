// The first of two drawings, deformed, beside the second: by all nodes of the grids, by some that the user drags, or with
// the areas that grow and shrink.

import { AREA_COLOURS } from "../editor/overlays.ts";
import { layeredFit } from "../maths/cuts.ts";
import type { Growth } from "../maths/thompson.ts";
import { cellsOf, growthOf, pairPoints, progressOf, reachedNodes, twelveNodes } from "../maths/thompson.ts";
import { busOf } from "../sync/bus.ts";
import type { FitSettings, PicturePoint, PointsDetail, Values, Vector2 } from "../types.ts";
import { elementUnder } from "../ui/fingers.ts";
import { GoalDrawing } from "./goal_drawing.ts";
import type { LaidPair } from "./laid_pair.ts";
import { PAPER } from "./laid_pair.ts";
import type { Template } from "./opened_file.ts";
import { blobOf, dataOf, openVolume } from "./opened_file.ts";
import type { Room } from "./step_page.ts";
import { pageParts, StepPage } from "./step_page.ts";

export type DrawingMode = "morph" | "drag" | "growth";

/** What a step has to say about the deformation. */
export interface Report {
  words: string;
  /** 0 to 100, null where there is no score */
  percent: number | null;
}

/** What the steps of the page share. */
export interface StepTools {
  template: Template;
  widgets: Values;
  /** For a picture. */
  room: () => Room;
  report: (report: Report) => void;
}

// Thirds of an animal, from back to belly and from head to tail.
const PLACES = [
  ["on the upper side of the head", "on the upper side of the body", "on the upper side of the tail"],
  ["in the middle of the head", "in the middle of the body", "in the middle of the tail"],
  ["on the lower side of the head", "on the lower side of the body", "on the lower side of the tail"],
];
// The same of pictures that need not show an animal.
const PARTS = [
  ["at the upper left", "at the top", "at the upper right"],
  ["at the left", "in the middle", "at the right"],
  ["at the lower left", "at the bottom", "at the lower right"],
];
const EVEN = 1.1; // ratio of areas below which nothing has grown more than the rest
const FULL_OCTAVES = 1; // half and twice the area have the full colours
const MOST_ALPHA = 0.75;
const GOOD = 80; // percent from which a score is good

/** A sentence about where an animal has grown. */
function growthWords(pair: LaidPair) {
  const { most, least } = growthOf(pair.source, pair.target),
    times = ({ times: value }: Growth) =>
      value.toLocaleString(document.documentElement.lang, { minimumFractionDigits: 1, maximumFractionDigits: 1 }),
    places = pair.first.isFigure ? PLACES : PARTS,
    place = ({ row, column }: Growth) => places[row]![column]!;
  if (most.times < EVEN * least.times) return "No part has grown much more than the others.";
  return (
    `Compared with the whole, it has grown most ${place(most)}: ${times(most)} times the area.\n` +
    `It has grown least ${place(least)}: ${times(least)} times the area.`
  );
}

const KEYS = /^(Arrow|Tab|Escape|Shift|Control|Alt|Meta)/; // that move a point, or the focus

/** Leave of an editor the drags of its points: a finger beside them scrolls the page, and no point comes or goes. */
function allowDragsAlone(root: Element) {
  const stop = (event: Event) => event.stopPropagation(),
    listen = (name: string, isAllowed: (event: Event) => boolean) =>
      root.addEventListener(name, (event) => isAllowed(event) || stop(event), { capture: true });
  listen("pointerdown", (event) => {
    // A browser directs a finger to something near it, which may be too far away.
    const hit = elementUnder(root, event as PointerEvent)?.closest(".dnb-ed-target") ?? null;
    return hit !== null && root.contains(hit);
  });
  listen("keydown", (event) => {
    const { key, ctrlKey, metaKey } = event as KeyboardEvent;
    return KEYS.test(key) || ((ctrlKey || metaKey) && /^[zy]$/i.test(key));
  });
  for (const name of ["dblclick", "wheel", "contextmenu"]) listen(name, () => false);
}

/** The cells of the second grid in two colours: which have grown more than the whole, and which less. */
function areaDrawing({ source, target, goal: { width, height } }: LaidPair) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height }),
    c = canvas.getContext("2d")!;
  for (const { corners, times } of cellsOf(source, target)) {
    const strength = Math.min(1, Math.abs(Math.log2(times)) / FULL_OCTAVES),
      colour = times > 1 ? AREA_COLOURS.grows : AREA_COLOURS.shrinks;
    c.beginPath();
    for (const [a, b] of corners) c.lineTo(a + 0.5, b + 0.5);
    c.closePath();
    c.fillStyle = `rgba(${colour.join(", ")}, ${(MOST_ALPHA * strength).toFixed(3)})`;
    c.fill();
  }
  return canvas;
}

export class DrawingStep {
  page: StepPage | null = null;
  goal: GoalDrawing;
  pair: LaidPair | null = null;
  mode: DrawingMode = "morph";
  /** Called after a drag with the places of the dragged nodes. */
  moved: (targets: Vector2[]) => void = () => {};
  #number = 0; // of requests to show something

  constructor(
    readonly place: Element,
    readonly tools: StepTools,
  ) {
    this.goal = new GoalDrawing(place);
  }

  /**
   * Show a pair.
   * @param share of the deformation by all nodes
   * @param targets of the nodes that the user drags, null where none has moved
   */
  async show(pair: LaidPair, mode: DrawingMode, share: number, targets: Vector2[] | null) {
    this.#number += 1;
    const number = this.#number,
      { template, widgets, room } = this.tools,
      { signal } = new AbortController();
    const opened = await openVolume(pair.photograph.volume, pair.photograph, () => {}, signal),
      data = await dataOf(template, opened, "+z");
    const ghost = await (mode === "growth" ? blobOf(areaDrawing(pair)) : pair.goalPicture());
    if (number !== this.#number) return;
    const points = mode === "drag" ? this.#ownPoints(pair, targets) : pairPoints(pair);
    Object.assign(data, {
      controls: [],
      editor: {
        ...StepPage.splineTraits(data.editor, points),
        read_only: mode !== "drag",
        show_grid: false,
        stop_at_folds: false,
        overlay: "none",
        theme: "light", // drawings on paper
        ghost: new DataView(await ghost.arrayBuffer()),
        raster: { ...data.editor.raster, beyond: PAPER },
        ghost_opacity: mode === "growth" ? 1 : 0,
      },
    });
    const before = this.page,
      root = pageParts(this.place);
    root.classList.add(mode === "drag" ? "dnb-th-dragged" : "dnb-th-shown", "dnb-th-coming");
    this.place.prepend(root);
    this.pair = pair;
    this.mode = mode;
    const page = new StepPage(data, widgets, pair.first.name, root, room);
    this.page = page;
    page.setShare(mode === "morph" ? share : 1);
    await this.showGoal(pair);
    await page.open();
    root.classList.remove("dnb-th-coming"); // the one before is seen until then
    before?.close();
    if (number !== this.#number) return; // another step has been chosen meanwhile
    if (mode === "drag") {
      allowDragsAlone(root);
      this.#followDrags(page);
    }
    if (mode === "growth") this.tools.report({ words: growthWords(pair), percent: null });
    if (mode === "morph") this.tools.report({ words: "", percent: null });
  }

  /** Show the second drawing alone. */
  async showGoal(pair: LaidPair) {
    const caption = pair.second.title;
    this.goal.show(await pair.goalPicture(), pair.box, { caption, alt: caption });
  }

  #ownPoints(pair: LaidPair, targets: Vector2[] | null) {
    const points = pairPoints(pair, twelveNodes(pair.source));
    return points.map((p, k) => ({ ...p, target: targets?.[k] ?? p.source }));
  }

  #followDrags(page: StepPage) {
    const bus = busOf(page.editor);
    const follow = ({ detail }: CustomEvent<PointsDetail>) => {
      if (page === this.page) this.#judge(detail.points as PicturePoint[], detail.settings);
    };
    bus.addEventListener("deformnb:points", follow);
    page.closing.signal.addEventListener("abort", () => bus.removeEventListener("deformnb:points", follow));
    page.editor.on("change:points", () => this.moved(page.points.map((p) => p.target)));
    this.#judge(page.points, page.editor.get("settings"));
  }

  /** Compare dragged points with the second grid: the nodes that are dragged, and all. */
  #judge(points: PicturePoint[], settings: FitSettings) {
    const { pair, page } = this;
    if (!pair || !page) return;
    const flat = pair.target.flat(),
      chosen = twelveNodes(pair.source),
      goals = chosen.map((k) => flat[k]!);
    const own = progressOf(
      points.map((p) => p.source),
      points.map((p) => p.target),
      goals,
    );
    const all = progressOf(pair.source.flat(), reachedNodes(layeredFit(points, settings), pair.source), flat);
    const percent = Math.max(0, Math.round(own.percent)),
      isGood = percent >= GOOD;
    this.goal.mark(goals, isGood ? null : own.worst);
    page.editor.update({ marked: isGood ? [] : [points[own.worst]!.id] });
    const missing = own.distances[own.worst]!.toFixed(0),
      farthest = `Point ${own.worst + 1} is farthest from its place: ${missing} pixels of the drawing.`,
      others = `All ${flat.length} crossings of the grid, also those between your points: ${Math.round(all.percent)} %.`;
    this.tools.report({ words: isGood ? `You have drawn this animal.\n${others}` : farthest, percent });
  }

  setShare(share: number) {
    if (this.mode === "morph") this.page?.setShare(share);
  }

  /** Lay the second drawing over the first, or take it away. */
  setGhost(opacity: number) {
    this.page?.editor.update({ ghost_opacity: opacity });
  }

  /** Take the last drag back. */
  undo() {
    this.page?.undo();
  }

  /** Forget the page, so that another step has its room. */
  hide() {
    this.#number += 1;
    this.page?.close();
    this.page = null;
  }
}
