// What the page itself sees, for benchmarks/latency.py: when a hand did something, and when pixels changed because of
// it. Put into every frame of the page before its own scripts. Times are milliseconds of the epoch, so that frames of
// one page agree.
//
// A picture counts when it is on its way to the screen: in the animation frame after the image was decoded, the canvas
// drawn, or WebGL had finished drawing. Each entry of `paints` is [time, place, kind].

(() => {
  const now = () => performance.timeOrigin + performance.now();
  const hooks = (window.deformnbLatency = { inputs: [], paints: [] });

  for (const type of ["pointerdown", "pointermove", "pointerup", "keydown"]) {
    window.addEventListener(type, (event) => { hooks.inputs.push([performance.timeOrigin + event.timeStamp, type]); }, true);
  }

  const placeOf = (element) => {
    if (window !== window.top) return "view"; // a view that is a page of its own
    if (element.closest(".dnb-editor")) return "editor";
    return element.closest(".jp-OutputArea, .jp-LinkedOutputView") ? "view" : "";
  };

  const waiting = new Map(); // at most one entry for each element and frame
  function painted(element, kind) {
    if (!element.isConnected || waiting.has(element)) return;
    const place = placeOf(element);
    if (!place) return;
    waiting.set(element, kind);
    requestAnimationFrame(() => { waiting.delete(element); hooks.paints.push([now(), place, kind]); });
  }

  // ---- images: the same picture again is no change --------------------------------------------------------------------

  const probe = Object.assign(document.createElement("canvas"), { width: 48, height: 36 });
  const plain = probe.getContext("2d", { willReadFrequently: true }), drawPlain = plain.drawImage.bind(plain);
  const seen = new WeakMap();
  function isNew(element, source) {
    try {
      drawPlain(source, 0, 0, probe.width, probe.height);
      const key = plain.getImageData(0, 0, probe.width, probe.height).data.join();
      const isSame = seen.get(element) === key;
      seen.set(element, key);
      return !isSame;
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
  for (const name of ["drawImage", "putImageData"]) {
    wrap(window.CanvasRenderingContext2D?.prototype, name, function after(source) {
      if (this === plain) return;
      const isPicture = name === "drawImage" && placeOf(this.canvas) === "view";
      if (!isPicture || isNew(this.canvas, source)) painted(this.canvas, "2d");
    });
  }
  wrap(window.ImageBitmapRenderingContext?.prototype, "transferFromImageBitmap", function after() {
    painted(this.canvas, "bitmap");
  });

  // WebGL draws later than it is told to: a fence says when it has.
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
