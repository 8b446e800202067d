// The moments of an animation in a live view: all maps came in one message, and a player in the same window chooses one.
//
// The maps are stacked, time is their third axis: the blend of a GPU between two texels is computed
// here, once for a picture instead of once for every sample of every ray. Nothing is sent to Python.

import type { FieldMaps, FramesData } from "../generated.ts";
import { floatsOf } from "../sync/buffers.ts";
import { FollowedModel } from "../sync/bus.ts";
import type { Bus, Model, TimeDetail } from "../types.ts";
import type { PlanarField } from "../webgl/types.ts";
import type { Bytes, Field } from "./types.ts";

/** Maps of all moments */
export type Moments = { count: number; duration: number; maps: Float32Array; planar: PlanarField };

export class TimeLink {
  frames: Moments | null = null;
  bus: Bus | null = null;
  player: Model | null = null;
  followed: FollowedModel;

  /** @param show takes the map of a new moment; while it plays only quick pictures are drawn */
  constructor(
    model: Model,
    readonly show: (planar: PlanarField, isPlaying: boolean) => void,
  ) {
    this.followed = new FollowedModel(model);
  }

  async follow(reference: string | Model | null) {
    if (reference === this.followed.reference) return; // following again removes no listener
    this.close();
    const found = await this.followed.choose(reference);
    if (!found) return;
    const { model: player, bus } = found;
    this.player = player;
    this.bus = bus;
    this.followed.hear(bus, "deformnb:time", ({ detail }) => this.#show(detail));
    // A player that is not drawn in this window has no clock here; its traits still change.
    const changed = () => {
      if (!bus.clock) this.#show({ time: player.get("time"), isPlaying: false });
    };
    player.on("change:time", changed);
    this.followed.ends.push(() => player.off("change:time", changed));
    if (this.frames) this.#show({ time: this.time, isPlaying: false });
  }

  /** The moment that is shown now. */
  get time(): number {
    return this.bus?.moment?.time ?? this.player?.get("time") ?? 0;
  }

  /**
   * Take a message of Python: maps of `count` moments, the first at 0, the last at `duration`. Returns the field.
   */
  take({ box, planar }: FieldMaps, { count, duration }: FramesData, [maps, weights]: [Bytes, Bytes]): Field {
    const all = floatsOf(maps);
    this.frames = {
      count,
      duration,
      maps: all,
      planar: { ...planar!, cut: null, maps: all, weights: floatsOf(weights) },
    };
    return { box, planar: planarAt(this.frames, this.time), space: null };
  }

  /** Discard the moments: a different field is shown. */
  drop() {
    this.frames = null;
  }

  #show({ time, isPlaying }: TimeDetail) {
    if (this.frames) this.show(planarAt(this.frames, time), isPlaying);
  }

  close() {
    this.followed.end();
    this.player = this.bus = null;
  }
}

function planarAt({ planar, maps, count, duration }: Moments, time: number) {
  return { ...planar, maps: mapAt(maps, count, duration > 0 ? (time / duration) * (count - 1) : 0) };
}

/** The map between two of `count`, blended linearly and clamped to the first and the last. */
function mapAt(maps: Float32Array, count: number, position: number) {
  const size = maps.length / count,
    p = Math.max(0, Math.min(count - 1, position));
  const k = Math.min(Math.floor(p), count - 2);
  if (count === 1 || p === k) return maps.subarray((count === 1 ? 0 : k) * size, (count === 1 ? 1 : k + 1) * size);
  const share = p - k,
    result = new Float32Array(size),
    first = k * size,
    next = first + size;
  for (let i = 0; i < size; i++) result[i] = (1 - share) * maps[first + i]! + share * maps[next + i]!;
  return result;
}
