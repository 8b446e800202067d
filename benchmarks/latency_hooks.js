// Times recorded in the page, for benchmarks/latency.py: of input events, and of the changes of pixels that follow
// them. Put into every frame of the page before its own scripts. Times are milliseconds of the epoch, so that frames of
// one page agree.
//
// A picture counts when it is on its way to the screen: in the animation frame after the image was decoded, the canvas
// drawn, or WebGL had finished drawing. An identical picture is no change. Each entry of `paints` is
// [time, place, kind]; the kind "grid" is of lines that an editor draws over its picture.

(() => {
  const now = () => performance.timeOrigin + performance.now();
  const hooks = (window.deformnbLatency = { inputs: [], paints: [] });

  for (const type of ["pointerdown", "pointermove", "pointerup", "keydown"]) {
    window.addEventListener(type, (event) => { hooks.inputs.push([performance.timeOrigin + event.timeStamp, type]); }, true);
  }

  const placeOf = (element) => {
    if (window !== window.top) return "view"; // a view that is a separate page
    if (element.closest(".dnb-editor")) return "editor";
    return element.closest(".jp-OutputArea, .jp-LinkedOutputView") ? "view" : "";
  };

  const waiting = new Map(); // at most one entry for each element, kind and frame
  function painted(element, kind) {
    const kinds = waiting.get(element) ?? new Set(), place = element.isConnected ? placeOf(element) : "";
    if (!place || kinds.has(kind)) return;
    waiting.set(element, kinds.add(kind));
    requestAnimationFrame(() => {
      kinds.delete(kind);
      hooks.paints.push([now(), place, kind]);
    });
  }

  // ---- images: the same picture again is no change --------------------------------------------------------------------

  const probe = Object.assign(document.createElement("canvas"), { width: 48, height: 36 });
  const plain = probe.getContext("2d", { willReadFrequently: true }), drawPlain = plain.drawImage.bind(plain);
  const seen = new WeakMap(); // by the element that shows it
  function differs(element, key) {
    const isSame = seen.get(element) === key;
    seen.set(element, key);
    return !isSame;
  }
  function isNew(element, source) {
    try {
      drawPlain(source, 0, 0, probe.width, probe.height);
      return differs(element, plain.getImageData(0, 0, probe.width, probe.height).data.join());
    } catch { return true; } // an image from elsewhere cannot be read
  }
  document.addEventListener("load", (event) => {
    const image = event.target;
    if (!(image instanceof HTMLImageElement) || image.naturalWidth < 64) return;
    if (isNew(image, image)) painted(image, "img");
  }, true);

  // ---- canvases -------------------------------------------------------------------------------------------------------

  function wrap(prototype, name, after) {
    const original = prototype?.[name];
    if (!original) return;
    prototype[name] = function wrapped(...given) {
      const result = original.apply(this, given);
      after.call(this, ...given);
      return result;
    };
  }

  // A number for some thousand of the pixels, which costs little relative to drawing them.
  function sumOf({ data }) {
    const step = 4 * Math.max(1, Math.floor(data.length / 4 / 4099)) + 1;
    let sum = data.length;
    for (let i = 0; i < data.length; i += step) sum = (Math.imul(sum, 31) + data[i]) | 0;
    return sum;
  }
  const sums = new WeakMap(); // of pixels that were put into a canvas off screen
  const drawn = window.CanvasRenderingContext2D?.prototype;
  wrap(drawn, "putImageData", function after(image) {
    const sum = sumOf(image);
    sums.set(this.canvas, sum);
    if (this.canvas.isConnected && placeOf(this.canvas) && differs(this.canvas, sum)) painted(this.canvas, "2d");
  });
  wrap(drawn, "drawImage", function after(source) {
    if (this === plain) return;
    const place = this.canvas.isConnected ? placeOf(this.canvas) : "";
    const isChange = place === "view" ? isNew(this.canvas, source)
      : place && sums.has(source) && differs(this.canvas, sums.get(source));
    if (isChange) painted(this.canvas, "2d");
  });
  wrap(window.ImageBitmapRenderingContext?.prototype, "transferFromImageBitmap", function after() {
    painted(this.canvas, "bitmap");
  });

  // The grid of an editor is lines on the canvas of its picture: others are drawn at once when one place differs.
  const grids = new WeakMap();
  wrap(drawn, "lineTo", function after(x, y) {
    let grid = grids.get(this);
    if (!grid) grids.set(this, (grid = { sum: 0, last: 0, isOpen: false, isGrid: placeOf(this.canvas) === "editor" }));
    if (!grid.isGrid) return;
    grid.sum = (Math.imul(grid.sum, 31) + Math.round(64 * x) + 7919 * Math.round(64 * y)) | 0;
    if (grid.isOpen) return;
    grid.isOpen = true;
    queueMicrotask(() => { // when all of them are drawn
      if (grid.sum !== grid.last) painted(this.canvas, "grid");
      Object.assign(grid, { last: grid.sum, sum: 0, isOpen: false });
    });
  });

  // WebGL draws asynchronously: a fence reports when it has.
  const targets = new WeakMap(), fences = new WeakSet();
  const gl2 = window.WebGL2RenderingContext?.prototype;
  wrap(gl2, "bindFramebuffer", function after(target, buffer) { targets.set(this, buffer); });
  for (const name of ["drawArrays", "drawElements", "blitFramebuffer"]) {
    wrap(gl2, name, function after() {
      if (targets.get(this) || fences.has(this) || !this.canvas.isConnected) return;
      fences.add(this);
      const fence = this.fenceSync(this.SYNC_GPU_COMMANDS_COMPLETE, 0);
      this.flush();
      const look = () => {
        if (this.isContextLost()) { fences.delete(this); return; }
        if (this.getSyncParameter(fence, this.SYNC_STATUS) !== this.SIGNALED) { setTimeout(look, 1); return; }
        this.deleteSync(fence);
        fences.delete(this);
        painted(this.canvas, "webgl");
      };
      setTimeout(look, 0);
    });
  }
})();
