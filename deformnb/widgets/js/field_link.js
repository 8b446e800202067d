// Follows an Editor in the same page: what it has fitted is sampled here, by rbf.js, and nothing goes to Python.

class FieldLink {
  /** apply(planar) is called with what RayCaster.setPlanar takes. */
  constructor(model, apply) {
    Object.assign(this, { model, apply, base: null, editor: null, bus: null, count: 0, ms: 0, isMoving: false });
    this.undo = [];
  }

  async follow(reference) {
    this.close();
    if (!reference) return;
    const ticket = (this.ticket = {});
    const editor = typeof reference === "string"
      ? await this.model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (this.ticket !== ticket) return; // another one was chosen meanwhile
    this.editor = editor;
    const bus = (this.bus = busOf(editor)), uid = editor.get("uid");
    holdBus(bus); // the editor's own view may go and come back
    const moved = (event) => this.refit(event.detail);
    bus.addEventListener("deformnb:points", moved);
    this.undo.push(() => bus.removeEventListener("deformnb:points", moved), () => releaseBus(bus, uid));
    // An editor that is not drawn on this page publishes nothing; its traits still change.
    const changed = () => { if (!bus.latest) this.refit({ points: editor.get("points"), settings: settingsOf(editor) }); };
    for (const name of ["points", "kernel", "support", "trend", "smoothing", "strength"]) {
      editor.on(`change:${name}`, changed);
      this.undo.push(() => editor.off(`change:${name}`, changed));
    }
    this.again();
  }

  /** What the editor shows now; Python's maps may be older. */
  again() {
    if (!this.editor || !this.base) return;
    this.refit(this.bus.latest || { points: this.editor.get("points"), settings: settingsOf(this.editor) });
  }

  /** Samples a fit on the raster of the maps that Python has sent, in place of one of them. */
  refit({ points, settings, fit, phase }) {
    if (!this.base) return;
    const start = performance.now(), { shape, origin, spacing } = this.base, [, rows, columns] = shape;
    let found = fit;
    try {
      found = found === undefined ? rbfFit(points, settings) : found;
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      found = null; // the editor says what is wrong
    }
    if (!found) return; // the last good picture stays
    const maps = this.base.maps.slice(), index = this.model.get("editor_map") || 0;
    maps.set(rbfOnRaster(found, { shape: [rows, columns], origin, spacing }), index * rows * columns * 2);
    this.base = { ...this.base, maps };
    this.isMoving = phase === "move";
    this.count += 1;
    this.ms = performance.now() - start;
    this.apply(this.base);
  }

  close() {
    for (const step of this.undo) step();
    this.undo = [];
    this.ticket = null;
    this.editor = null;
    this.bus = null;
  }
}
