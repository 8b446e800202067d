import assert from "node:assert/strict";
import test from "node:test";
import { bytesOf, joinFragments } from "../src/sync/buffers.ts";

const bytes = (...values) => new DataView(new Uint8Array(values).buffer);
const part = (index, message = null) => ({ type: "fragment", index, sizes: [3, 2], message });

function listener() {
  const received = [];
  const receive = joinFragments((message, buffers) => {
    received.push([message, buffers.map((b) => [...bytesOf(b)])]);
  });
  return { received, receive };
}

test("a message in parts comes whole, and others as they are", () => {
  const { received, receive } = listener();
  receive({ type: "field" }, [bytes(9)]);
  receive(part(0), [bytes(1, 2)]);
  receive(part(1), [new Uint8Array([3, 4]).buffer]); // hosts pass views of several kinds
  receive(part(2, { type: "chunk" }), [new Uint8Array([5])]);
  assert.deepEqual(received, [
    [{ type: "field" }, [[9]]],
    [
      { type: "chunk" },
      [
        [1, 2, 3],
        [4, 5],
      ],
    ],
  ]);
});

test("a message whose first parts were missed is dropped, and the next one comes", () => {
  const { received, receive } = listener();
  receive(part(1), [bytes(3, 4)]);
  receive(part(2, { type: "late" }), [bytes(5)]);
  receive(part(0), [bytes(1, 2)]); // its rest does not come
  receive(part(0), [bytes(6, 7, 8)]);
  receive(part(1, { type: "next" }), [bytes(9, 10)]);
  assert.deepEqual(received, [
    [
      { type: "next" },
      [
        [6, 7, 8],
        [9, 10],
      ],
    ],
  ]);
});
