// Binary buffers of Python's messages, which hosts pass on as views of several kinds, and messages that are too large for
// one: their parts, in order, are put together again.

import type { Fragment } from "../generated.ts";
import type { ModelHandler } from "../types.ts";
import type { Bytes } from "../view/types.ts";

export function bytesOf(b: Bytes) {
  return b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b);
}

/** A copy as floats: the buffer of a message may start at an odd place, which a Float32Array refuses. */
export function floatsOf(b: Bytes) {
  return new Float32Array(bytesOf(b).slice().buffer);
}

/** A handler of messages that gets each of them whole. One whose first parts were missed is dropped. */
export function joinFragments(handler: ModelHandler): ModelHandler {
  let parts: Uint8Array<ArrayBuffer>[] = [];
  return (message: Fragment | { type: "" }, buffers: Bytes[] = []) => {
    if (message.type !== "fragment") return handler(message, buffers);
    if (message.index !== parts.length) parts = [];
    if (message.index !== parts.length) return undefined;
    parts.push(bytesOf(buffers[0]!));
    if (!message.message) return undefined;
    const joined = new Uint8Array(message.sizes.reduce((sum, size) => sum + size, 0));
    let at = 0;
    for (const part of parts.splice(0)) {
      joined.set(part, at);
      at += part.length;
    }
    at = 0;
    const whole = message.sizes.map((size) => {
      at += size;
      return new DataView(joined.buffer, at - size, size);
    });
    return handler(message.message, whole);
  };
}
