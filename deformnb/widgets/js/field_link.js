// Follows an Editor in the same page: what it has fitted is sampled here, by cut_fits.js, and nothing goes to Python.
//
// Python's maps and the editor's points reach the page by different ways. Python's maps are shown as they are where
// they are of the points that the editor has now, where another map begins to be followed, or where Python shows
// something else; they give way where the editor has gone on since, so that no old picture flashes up.

const SHAPES = ["cuts", "cut_rule", "parts"];
const FOLLOWED = ["points", "kernel", "support", "chosen_support", "trend", "smoothing", "strength", "stages", ...SHAPES];

class FieldLink {
  /**
   * apply(planar, isDrawing) is called with what RayCaster.setPlanar takes. hand(isMoving) is told of a movement, and of
   * its end: it asks catchUp for the maps when it is drawing, for a hand moves more often than a volume is drawn.
   */
  constructor(model, apply, hand) {
    Object.assign(this, { model, apply, hand, awaited: null, base: null, reference: null, editor: null, bus: null,
      count: 0, ms: 0, isMoving: false, index: null, expected: null, settled: "" });
    this.undo = [];
  }

  async follow(reference) {
    if (reference === this.reference) return; // following again tears nothing down
    this.close();
    this.reference = reference;
    if (!reference) return;
    const ticket = (this.ticket = {});
    const editor = typeof reference === "string"
      ? await this.model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (this.ticket !== ticket) return; // another one was chosen meanwhile
    this.editor = editor;
    const bus = (this.bus = busOf(editor)), uid = editor.get("uid");
    holdBus(bus); // the editor's own view may go and come back
    const moved = (event) => this.moved(event.detail);
    bus.addEventListener("deformnb:points", moved);
    this.undo.push(() => bus.removeEventListener("deformnb:points", moved), () => releaseBus(bus, uid));
    // An editor that is not drawn on this page publishes nothing; its traits still change.
    const changed = () => { if (!bus.latest) this.moved(this.#traits()); };
    for (const name of FOLLOWED) {
      editor.on(`change:${name}`, changed);
      this.undo.push(() => editor.off(`change:${name}`, changed));
    }
    if (this.#isNewer()) this.refit(this.#newest());
  }

  /**
   * Python's maps, with what the editor has shown since in place of one of them. follow: {index, points, shapes} if
   * Python follows the editor, with the points, cuts and parts that the maps are of; null if it shows something else.
   */
  merged(planar, follow) {
    const isSwitch = Boolean(follow) && this.index !== null && this.index !== follow.index;
    this.base = planar;
    this.expected = follow ? madeKey(follow.points, follow.shapes ?? this.#shapes()) : null;
    if (follow) this.index = follow.index;
    if (!planar || !this.editor) return planar;
    const isMoving = Boolean(this.bus.latest && this.bus.latest.phase === "move");
    if (isMoving || (follow && !isSwitch && this.#isNewer())) {
      const newer = this.#sampled(this.#newest());
      if (newer) return newer;
    }
    this.settled = detailKey(this.#newest());
    return planar;
  }

  /** Whether the editor has other points than Python's maps. */
  #isNewer() {
    return this.expected === null || this.expected !== madeKey(pointsOf(this.bus, this.editor) || [], this.#shapes());
  }

  #shapes() { return Object.fromEntries(SHAPES.map((name) => [name, this.editor?.get(name) ?? null])); }

  #traits() { return { points: pointsOf(this.bus, this.editor), settings: settingsOf(this.editor) }; }

  /** What is on the way under the pointer, else what the editor's model holds. */
  #newest() {
    const { latest } = this.bus, traits = this.#traits();
    return latest && (latest.phase === "move" || pointsKey(latest.points) === pointsKey(traits.points || [])) ? latest : traits;
  }

  moved(detail) {
    const isMoving = detail.phase === "move";
    this.awaited = isMoving ? detail : null;
    this.hand(isMoving); // also of an end at which nothing is new: the view waits for one
    if (!isMoving && detailKey(detail) !== this.settled) this.refit(detail); // else Python's maps show it already
  }

  /** The maps of the newest movement, unless they have been made. */
  catchUp() {
    const { awaited } = this;
    this.awaited = null;
    if (awaited) this.refit(awaited, true);
  }

  /** Samples a fit on the raster of the maps that Python has sent, and shows it. */
  refit(detail, isDrawing = false) {
    const planar = this.#sampled(detail);
    if (planar) this.apply(planar, isDrawing);
  }

  #sampled({ points, settings, layered, phase }) {
    if (!this.base) return null;
    const start = performance.now();
    let found = null;
    try {
      const fits = layered === undefined ? layeredFit(points, settings) : layered;
      found = fits && withLayers(this.base, fits, settings, this.index ?? this.model.get("editor_map") ?? 0);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error; // the editor says what is wrong
    }
    if (!found) return null; // the last good picture stays
    this.base = found;
    this.isMoving = phase === "move";
    this.settled = "";
    this.count += 1;
    this.ms = performance.now() - start;
    return this.base;
  }

  close() {
    for (const step of this.undo) step();
    this.undo = [];
    this.ticket = null;
    this.awaited = null;
    this.editor = null;
    this.bus = null;
    this.reference = null;
    this.settled = "";
  }
}

/** Equal for points that give the same fit. */
function pointsKey(points) {
  return JSON.stringify(points.map((p) => [p.id, p.source, p.target, p.active !== false, p.weight ?? 1, p.radius ?? null]));
}

function madeKey(points, shapes) { return pointsKey(points) + JSON.stringify(SHAPES.map((name) => shapes[name])); }

function detailKey({ points, settings }) { return pointsKey(points || []) + JSON.stringify(settings); }
