// Edits that a page holds while Python is away, and their return.
//
// A page that has lost its Python keeps the studio: points, cuts and parts are still edited in it. When Python is back, it
// is either the same process, whose state counts but for edits that it has not received, or another one, which first
// takes up the session by its autosave; then the page's points replace those of the autosave, as an edit that can be
// undone, where both are of the same picture.

import type { RestoreBarToFrontEnd } from "../generated.ts";
import { samePoints, sameShapes } from "../maths/points.ts";
import { busOf } from "../sync/bus.ts";
import { setTrait } from "../sync/edits.ts";
import type { Model, Point, ShapeKind, Shapes } from "../types.ts";
import type { WidgetManager } from "./widget_manager.ts";

const PATIENCE = 30000; // ms for Python to take up the session
const SHAPES: ShapeKind[] = ["cuts", "parts"];

/** The state of an editor in this page. */
interface HeldEditor {
  points: Point[];
  shapes: Shapes;
  /** What the points lie on: they are places on no other picture */
  ground: string;
  isBehind: boolean;
}

export interface Held {
  /** Id of the studio's restore bar, which is another one in another process */
  bar: string;
  session: string;
  editors: Map<string, HeldEditor>;
  camera: unknown;
}

const isBar = (model: Model) => model.get("session") !== undefined && model.get("offer") !== undefined;
const isEditor = (model: Model) => model.get("uid") !== undefined && model.get("next_id") !== undefined;
const isView = (model: Model) => model.get("camera") !== undefined && model.get("shows") !== undefined;

/** Editors of a studio by what they are: one on pictures, one in space. */
const kindOf = (model: Model) => (model.get("front_only") === undefined ? "space" : "picture");

function groundOf(model: Model) {
  const { image, ...raster } = model.get("raster") ?? {}; // without the bytes of the picture
  return JSON.stringify([model.get("label"), raster]);
}

/** What a page would lose with the widgets of its manager. */
export async function hold(manager: WidgetManager): Promise<Held> {
  const models = await manager.models(),
    editors = new Map<string, HeldEditor>();
  for (const model of models.filter(isEditor)) {
    const { sender } = busOf(model);
    if (!sender) continue;
    const { points, shapes } = sender;
    editors.set(kindOf(model), { points, shapes, ground: groundOf(model), isBehind: sender.isBehind() });
  }
  const bar = models.find(isBar),
    camera = models.find(isView)?.get("camera");
  return { bar: manager.idOf(bar), session: bar?.get("session") ?? "", editors, camera };
}

/** Resolves with true once a condition holds, with false when the time is over. */
function until(model: Model, names: string, condition: () => boolean) {
  return new Promise<boolean>((resolve) => {
    const end = (isReached: boolean) => {
      clearTimeout(timer);
      model.off(names, look);
      resolve(isReached);
    };
    const look = () => {
      if (condition()) end(true);
    };
    const timer = setTimeout(() => end(condition()), PATIENCE);
    model.on(names, look);
    look();
  });
}

/** Let another Python take up the session of the page. */
async function resume(bar: Model, session: string) {
  await until(bar, "change:ready", () => bar.get("ready") === true);
  const answered = new Promise<void>((resolve) => {
    const receive = (content: RestoreBarToFrontEnd) => {
      if (content?.type !== "done") return;
      bar.off("msg:custom", receive);
      resolve();
    };
    bar.on("msg:custom", receive);
  });
  bar.send({ type: "resume", session });
  await answered;
}

function give(model: Model, { points, shapes }: HeldEditor) {
  const { sender } = busOf(model);
  if (!sender) return;
  for (const what of SHAPES) {
    if (!sameShapes(shapes[what], sender.shapes[what])) sender.editShapes(what, shapes[what], `edit ${what}`, points);
  }
  if (!samePoints(points, sender.points)) sender.edit(points, "several");
}

/**
 * Give a Python that is back what the page holds. Returns whether all of it could be given: what lies on another picture
 * cannot.
 */
export async function giveBack(manager: WidgetManager, held: Held) {
  const models = await manager.models(),
    bar = models.find(isBar);
  if (!bar) return true;
  const isSame = manager.idOf(bar) === held.bar;
  if (!isSame && held.session) await resume(bar, held.session);
  let isWhole = true;
  for (const model of models.filter(isEditor)) {
    const own = held.editors.get(kindOf(model));
    if (!own || (isSame && !own.isBehind)) continue;
    const hasGround = await until(model, "change:raster change:label", () => groundOf(model) === own.ground);
    if (hasGround) give(model, own);
    else isWhole = !own.isBehind && isWhole;
  }
  const view = models.find(isView);
  if (view && held.camera && !isSame) setTrait(view, "camera", held.camera);
  return isWhole;
}
