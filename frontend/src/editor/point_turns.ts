// Turning and scaling of control points.

import { formatLength } from "../maths/numbers.ts";
import { addRim, middleOf, rimOf, rotatePoints, turnOfKey } from "../maths/points.ts";
import type { PicturePoint, Vector2 } from "../types.ts";
import type { EditorParts } from "./parts.ts";

/** Points, ids of those that turn, the centre */
export type Turn = { points: PicturePoint[]; ids: number[]; about: Vector2 };

/** Dependencies of turning on the editor. */
export type TurnEditor = EditorParts<"messages" | "points" | "map", "brush" | "drag" | "points">;

export class PointTurns {
  constructor(readonly editor: TurnEditor) {}

  /** The points that a rotation of the selection moves. A single point gets a rim, which turns around it. */
  #turnables(): Turn | null {
    const { editor } = this,
      { points: pointTools } = editor.tools,
      points = editor.points.list,
      chosen = points.filter((p) => editor.points.selected.has(p.id) && !p.locked);
    if (!chosen.length) {
      pointTools.hintLocked([...editor.points.selected]);
      return null;
    }
    if (chosen.length > 1)
      return { points, ids: pointTools.movableIds(chosen.map((p) => p.id)), about: middleOf(chosen) };
    const [pin] = chosen as [PicturePoint],
      rim = rimOf(points, pin).filter((p) => !p.locked);
    if (rim.length) return { points, ids: rim.map((p) => p.id), about: pin.target };
    const room = points.reduce(
      (least, p) =>
        p.id === pin.id || !p.active
          ? least
          : Math.min(least, Math.hypot(p.target[0] - pin.target[0], p.target[1] - pin.target[1])),
      Infinity,
    );
    const id = editor.points.nextId(),
      distance = Math.min(editor.tools.brush.radius, 0.6 * room);
    const rimmed = addRim(points, pin, distance, id, editor.map.sourcesOf(editor.map.layered));
    return { points: rimmed, ids: rimmed.slice(points.length).map((p) => p.id), about: pin.target };
  }

  /**
   * Turn or scale by a key. Quick presses are undone as one.
   * @param way 1 or 1
   */
  turnKey(way: number, how: { isLarge: boolean; isScale: boolean }) {
    const { editor } = this,
      [angle, factor] = turnOfKey(way, how),
      turn = editor.points.isLocked ? null : this.#turnables();
    if (!turn) return;
    const kind = angle ? "turn" : "scale";
    editor.tools.points.changeAsFar(
      (share) => rotatePoints(turn.points, turn.ids, turn.about, share * angle, factor ** share),
      kind,
      `${kind} ${[...editor.points.selected]}`,
    );
    editor.messages.announce(
      angle ? `turned by ${formatLength((angle * 180) / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`,
    );
  }

  begin() {
    const turn = this.editor.points.isLocked ? null : this.#turnables();
    if (turn) this.editor.tools.drag.beginDrag();
    return turn;
  }

  /** Turn and scale since the drag began. */
  turnTo({ points, ids, about }: Turn, angle: number, factor: number) {
    const { messages, tools } = this.editor,
      { mirror } = tools.points;
    if (!tools.drag.drag0) return;
    tools.drag.show((before, t) => mirror.edit(before, rotatePoints(points, ids, about, t * angle, factor ** t)));
    messages.hint(factor === 1 ? `${formatLength((angle * 180) / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`);
  }
}
