// The moments of an animation in a live view: all maps came at once, and a player in the same window chooses one.
//
// The maps lie one behind the other, time is their third axis: what a GPU would blend between two texels is blended
// here, once for a picture instead of once for every sample of every ray. Nothing goes to Python.

import { FollowedModel } from "../sync/bus.js";
import { floatsOf } from "./volume_loader.js";

/** @import { Bus, Model, TimeDetail } from "../types.d.ts" */
/** @import { PlanarField } from "../webgl/types.d.ts" */
/** @import { Bytes, Field } from "./types.d.ts" */
/** @import { Message } from "./volume_loader.js" */

/** @typedef {{count: number, duration: number, maps: Float32Array, planar: PlanarField}} Moments maps of all moments */

/**
 * @typedef {object} PlayedView the live view whose field this changes
 * @property {Model} model
 * @property {Field | null} field
 * @property {{request(): void} | null} still
 * @property {() => void} applyField
 * @property {(held: boolean) => void} touch
 */

export class TimeLink {
  /** @param {PlayedView} view */
  constructor(view) {
    this.view = view;
    /** @type {Moments | null} */
    this.frames = null;
    /** @type {Bus | null} */
    this.bus = null;
    /** @type {Model | null} */
    this.player = null;
    this.followed = new FollowedModel(view.model);
  }

  /** @param {string | Model | null} reference */
  async follow(reference) {
    if (reference === this.followed.reference) return; // following again tears nothing down
    this.close();
    const found = await this.followed.choose(reference);
    if (!found) return;
    const { model: player, bus } = found;
    this.player = player;
    this.bus = bus;
    this.followed.hear(bus, "deformnb:time", ({ detail }) => this.#show(detail));
    // A player that is not drawn in this window has no clock here; its traits still change.
    const changed = () => { if (!bus.clock) this.#show({ time: player.get("time"), isPlaying: false }); };
    player.on("change:time", changed);
    this.followed.ends.push(() => player.off("change:time", changed));
    if (this.frames) this.#show({ time: this.time, isPlaying: false });
  }

  /**
   * The moment that is shown now.
   * @returns {number}
   */
  get time() { return this.bus?.moment?.time ?? this.player?.get("time") ?? 0; }

  /**
   * Takes what Python has sent: maps of `count` moments, the first at 0, the last at `duration`. Returns the field.
   * @param {Message} content
   * @param {Bytes[]} buffers
   * @returns {Field}
   */
  take({ box, planar, frames: { count, duration } }, [maps, weights]) {
    this.frames = { count, duration, maps: floatsOf(maps), planar: { ...planar, weights: floatsOf(weights) } };
    return { box, planar: planarAt(this.frames, this.time), space: null };
  }

  /** Forgets the moments: something else is shown. */
  drop() { this.frames = null; }

  /** @param {TimeDetail} moment */
  #show({ time, isPlaying }) {
    const { view, frames } = this;
    if (!frames || !view.field) return;
    view.field = { ...view.field, planar: planarAt(frames, time) };
    view.applyField();
    view.touch(isPlaying); // while it plays only quick pictures are drawn
    if (!isPlaying) view.still?.request();
  }

  close() {
    this.followed.end();
    this.player = this.bus = null;
  }
}

/**
 * @param {Moments} moments
 * @param {number} time
 */
function planarAt({ planar, maps, count, duration }, time) {
  return { ...planar, maps: mapAt(maps, count, duration > 0 ? (time / duration) * (count - 1) : 0) };
}

/**
 * The map between two of `count`, blended linearly and clamped to the first and the last.
 * @param {Float32Array} maps
 * @param {number} count
 * @param {number} position
 */
function mapAt(maps, count, position) {
  const size = maps.length / count, p = Math.max(0, Math.min(count - 1, position));
  const k = Math.min(Math.floor(p), count - 2);
  if (count === 1 || p === k) return maps.subarray((count === 1 ? 0 : k) * size, (count === 1 ? 1 : k + 1) * size);
  const share = p - k, result = new Float32Array(size), first = k * size, next = first + size;
  for (let i = 0; i < size; i++) result[i] = (1 - share) * maps[first + i] + share * maps[next + i];
  return result;
}
