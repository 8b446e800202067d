// What a page of the studio draws while a mouse moves, for benchmarks/studio.py: the times of pictures and views, with
// the resolution of each view, and the gaps between the page's frames. Nothing is read back, so that drawing costs what
// it does without these hooks.

(() => {
  const seen = (window.deformnbRates = { pictures: [], views: [], frames: [], isRunning: false });
  const now = () => performance.now();

  // A picture counts once a frame, however many calls it takes.
  let frame = -1;
  for (const name of ["putImageData", "drawImage"]) {
    const prototype = CanvasRenderingContext2D.prototype, original = prototype[name];
    prototype[name] = function counted(...given) {
      if (seen.isRunning && this.canvas.isConnected && this.canvas.closest?.(".dnb-editor, .dnb-space") && frame !== seen.frames.length) {
        frame = seen.frames.length;
        seen.pictures.push(now());
      }
      return original.apply(this, given);
    };
  }

  function watchViews() {
    for (const root of document.querySelectorAll(".dnb-view")) {
      const { loop, caster } = root.deformnb ?? {};
      if (!loop || loop.isWatched) continue;
      loop.isWatched = true;
      const { screen } = loop, show = screen.show.bind(screen);
      screen.show = () => {
        show();
        const name = screen.drawn[screen.layer], target = caster.gpu.targets[name];
        if (!target || !seen.isRunning) return;
        seen.views.push([now(), name, target.width / caster.size[0], target.height / caster.size[1]]);
      };
    }
  }

  const tick = (time) => {
    if (!seen.isRunning) return;
    seen.frames.push(time);
    requestAnimationFrame(tick);
  };
  seen.begin = () => {
    watchViews();
    Object.assign(seen, { pictures: [], views: [], frames: [], isRunning: true });
    frame = -1;
    requestAnimationFrame(tick);
  };
  seen.end = () => {
    seen.isRunning = false;
    const { pictures, views, frames } = seen;
    return { pictures, views, frames };
  };
  for (const type of ["pointerdown", "pointerup"]) {
    window.addEventListener(type, (event) => { seen[type] = event.timeStamp; }, true);
  }
  seen.moves = 0;
  window.addEventListener("pointermove", () => { seen.moves += 1; }, true);
})();
