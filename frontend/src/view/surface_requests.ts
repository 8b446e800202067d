// Requests of a view without voxels: where a ray meets the volume, which Python finds.

import type { Ray } from "../maths/space_camera.ts";
import type { Vector3 } from "../types.ts";
import type { ViewMessages } from "./view_elements.ts";

export class SurfaceRequests {
  #count = 0;
  #waiting = new Map<number, (place: Vector3 | null) => void>();

  constructor(readonly messages: ViewMessages) {
    messages.on("msg:custom", (content) => {
      if (content.type !== "surface" || content.view !== messages.id) return;
      this.#waiting.get(content.id)?.(content.place);
      this.#waiting.delete(content.id);
    });
  }

  /** The first visible surface along a ray; null where nothing is seen. */
  find({ start, ray }: Ray): Promise<Vector3 | null> {
    this.#count += 1;
    const id = this.#count;
    this.messages.send({ type: "surface", id, start, ray });
    return new Promise((resolve) => {
      this.#waiting.set(id, resolve);
    });
  }
}
