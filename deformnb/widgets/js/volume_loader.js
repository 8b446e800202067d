// The voxels on their way from Python: packed pieces that are asked for, unpacked and put together.

const IN_FLIGHT = 2; // pieces on their way at once: the second hides the round trip of the first

const bytesOf = (b) => (b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b));
// A copy: the buffer of a message may start at an odd place, which a Float32Array refuses.
const floatsOf = (b) => new Float32Array(bytesOf(b).slice().buffer);

async function unpacked(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class VolumeLoader {
  /** info: shape, id and chunks of the volume; ask(index) asks for a piece; progress(share) hears how far it is. */
  constructor({ id, shape, chunks }, ask, progress) {
    Object.assign(this, { id, chunks, ask, progress, arrived: 0, asked: 0, isOver: false });
    this.values = new Uint8Array(shape[0] * shape[1] * shape[2]);
    progress(0);
    while (this.asked < Math.min(IN_FLIGHT, chunks)) ask(this.asked++);
  }

  /** Takes a piece; the values once all are here, else null. */
  async receive({ id, index, start }, packed) {
    if (id !== this.id || index !== Math.floor(index) || this.isOver) return null; // of a volume that is shown no longer
    const voxels = await unpacked(bytesOf(packed));
    if (this.isOver) return null;
    this.values.set(voxels, start);
    this.arrived += 1;
    this.progress(this.arrived / this.chunks);
    if (this.asked < this.chunks) this.ask(this.asked++);
    return this.arrived === this.chunks ? this.values : null;
  }

  close() { this.isOver = true; }
}
