// The moments of an animation in a live view: all maps came at once, and a player in the same page says which is seen.
//
// The maps lie one behind the other, time is their third axis: what a card would blend between two texels is blended
// here, once for a picture instead of once for every sample of every ray. Nothing goes to Python.

import { busOf, holdBus, releaseBus } from "../sync/bus.js";
import { floatsOf } from "./volume_loader.js";

export class TimeLink {
  /** page: a LiveViewPage, whose field this changes. */
  constructor(page) {
    Object.assign(this, { page, frames: null, bus: null, player: null, reference: null, undo: [] });
  }

  async follow(reference) {
    if (reference === this.reference) return;
    this.close();
    this.reference = reference;
    if (!reference) return;
    const ticket = (this.ticket = {});
    const player = typeof reference === "string"
      ? await this.page.model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (this.ticket !== ticket) return; // another one was chosen meanwhile
    this.player = player;
    const bus = (this.bus = busOf(player)), uid = player.get("uid");
    holdBus(bus);
    const moved = (event) => this.#show(event.detail);
    bus.addEventListener("deformnb:time", moved);
    // A player that is not drawn on this page has no clock here; its traits still change.
    const changed = () => { if (!bus.clock) this.#show({ time: player.get("time"), isPlaying: false }); };
    player.on("change:time", changed);
    this.undo.push(() => bus.removeEventListener("deformnb:time", moved), () => player.off("change:time", changed),
      () => releaseBus(bus, uid));
    if (this.frames) this.#show({ time: this.time, isPlaying: false });
  }

  /** The moment that is seen now. */
  get time() { return this.bus?.moment?.time ?? this.player?.get("time") ?? 0; }

  /** What Python has sent: maps of `count` moments, the first at 0, the last at `duration`. Returns the field. */
  take({ box, planar, frames }, [maps, weights]) {
    this.frames = { ...frames, maps: floatsOf(maps), planar: { ...planar, weights: floatsOf(weights) } };
    return { box, planar: this.planarAt(this.time), space: null };
  }

  /** Something else is shown. */
  drop() { this.frames = null; }

  planarAt(time) {
    const { planar, maps, count, duration } = this.frames;
    return { ...planar, maps: mapAt(maps, count, duration > 0 ? (time / duration) * (count - 1) : 0) };
  }

  #show({ time, isPlaying }) {
    const { page, frames } = this;
    if (!frames || !page.field) return;
    page.field = { ...page.field, planar: this.planarAt(time) };
    page.applyField();
    page.touch(isPlaying); // while it plays only quick pictures are drawn
    if (!isPlaying) page.still?.ask();
  }

  close() {
    for (const step of this.undo) step();
    Object.assign(this, { undo: [], ticket: null, player: null, bus: null, reference: null });
  }
}

/** The map between two of `count`, blended linearly and clamped to the first and the last. */
function mapAt(maps, count, position) {
  const size = maps.length / count, p = Math.max(0, Math.min(count - 1, position)), k = Math.min(Math.floor(p), count - 2);
  if (count === 1 || p === k) return maps.subarray((count === 1 ? 0 : k) * size, (count === 1 ? 1 : k + 1) * size);
  const share = p - k, result = new Float32Array(size), first = k * size, next = first + size;
  for (let i = 0; i < size; i++) result[i] = (1 - share) * maps[first + i] + share * maps[next + i];
  return result;
}
