// The editor in space: three linked pictures with the same points. Joined behind the files that
// deformnb/widgets/editor/space_editor.py names.
// To Python: edit and history, by sender.js; hello, look, seen. From Python: pictures, error, done.

const SPACE_PROJECTIONS = { slice: "Slices", mip: "Maximum (MIP)", composite: "Composite", shaded: "Shaded" };
const SLOW_PICTURES = 500; // milliseconds after which it is said that pictures are being made
const LOOK_PATIENCE = 400; // milliseconds after which a place is sent though the pictures of the last one have not come

class SpaceEditorPage extends SpaceHand {
  constructor(model, el) {
    super();
    Object.assign(this, { model, id: Math.random().toString(36).slice(2, 12), bus: busOf(model), closed: new AbortController(),
      selected: new Set(model.get("selected")), drag0: null, isAdding: false, isSelecting: false, isComparing: false, isSpaceDown: false,
      frame: 0, facts: {}, looked: new Set(), waitingSince: -Infinity, pendingLook: null, shownCount: 0 });
    this.sender = senderOf(this.bus, model);
    this.selection = new RestingTrait(model, "selected");
    this.sender.receive();
    this.points = this.sender.points;
    this.panes = model.get("panes");
    this.cursor = [...model.get("cursor")];
    this.#build(el);
    this.#listen();
    this.guard(() => { this.layout(); this.showWaiting(); });
    model.send({ type: "hello", view: this.id });
    this.#expectPictures();
  }

  #build(el) {
    this.host = el;
    el.classList.add("dnb-ed-host");
    this.root = pageElement("div", "dnb-editor dnb-space", el, { tabindex: "-1", role: "group", ...OWN_KEYS });
    this.toolbar = new Toolbar(this, this.root, SPACE_GROUPS, SPACE_EDITOR_KEYS, SPACE_MORE);
    const group = pageElement("div", "dnb-ed-group", null);
    this.toolbar.root.insertBefore(group, this.toolbar.root.children[2]);
    this.chooser = pageElement("select", "dnb-sp-select", group, { "aria-label": "What the pictures show", ...OWN_KEYS });
    for (const [name, title] of Object.entries(SPACE_PROJECTIONS)) {
      pageElement("option", "", this.chooser, { value: name }).textContent = title;
    }
    this.row = pageElement("div", "dnb-sp-row", this.root);
    this.pictures = this.panes.map((_, k) => new SpacePane(this, k, this.row));
    this.gestures = this.pictures.map((pane) => new PaneGestures(this, pane));
    const veil = pageElement("div", "dnb-ed-veil", this.row);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" });
    this.input = pageElement("input", "dnb-ed-input", this.row, { type: "text", maxlength: "80", hidden: "",
      "aria-label": "name of the point", ...OWN_KEYS });
    this.tip = pageElement("div", "dnb-ed-hint", this.row, { hidden: "", "aria-hidden": "true" });
    this.alert = pageElement("div", "dnb-ed-alert", this.row, { role: "alert", hidden: "" });
    this.help = helpPanel(this.row, SPACE_EDITOR_KEYS);
    const status = pageElement("div", "dnb-ed-status", this.root);
    this.factsLine = pageElement("span", "dnb-ed-facts", status);
    this.foldFact = pageElement("span", "dnb-ed-folds", status);
    this.notes = pageElement("div", "dnb-ed-notes", status);
    this.spoken = pageElement("div", "dnb-ed-spoken", this.root, { "aria-live": "polite" });
    this.root.deformnb = this; // for tests and for whoever looks into the page
  }

  #listen() {
    const handlers = this.handlers = [];
    const on = (name, handler) => {
      const guarded = (...given) => this.guard(() => handler(...given));
      this.model.on(name, guarded);
      handlers.push([name, guarded]);
    };
    on("msg:custom", (message, buffers) => this.message(message, buffers ?? []));
    on("change:selected", () => { if (!this.selection.isAhead) this.select(this.model.get("selected"), false); });
    on("change:cursor", () => this.receiveCursor());
    on("change:panes", () => this.setPanes());
    on("change:theme", () => this.applyTheme());
    on("change:waiting", () => this.showWaiting());
    on("change:height", () => this.layout());
    for (const name of ["label", "projection", "shows_original", "read_only", "history", "mirror", "snap"]) on(`change:${name}`, () => this.invalidate());
    this.moved = (event) => this.guard(() => {
      const { origin, points, phase } = event.detail;
      if (origin === this.id || this.drag0) return;
      if (phase === "move") { this.points = points; this.invalidate(); } else this.receive();
    });
    this.bus.addEventListener("deformnb:points", this.moved);
    this.sender.greet();
    const heard = { points: () => this.receive(), status: () => this.showStatus(), history: () => this.invalidate() };
    this.unlisten = this.sender.listen((what) => this.guard(heard[what]));
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    const { signal } = this.closed, listen = (target, name, handler) => target.addEventListener(
      name, (event) => this.guard(() => handler(event)), { signal });
    listen(this.dark, "change", () => this.applyTheme());
    listen(this.chooser, "change", () => this.look({ projection: this.chooser.value }));
    listen(this.root, "keydown", (e) => { if (spaceKey(this, e)) { e.preventDefault(); e.stopPropagation(); } });
    listen(this.root, "keyup", (e) => {
      if (e.key === " ") this.isSpaceDown = false;
      if (/^(Arrow|Page)/.test(e.key)) this.lookAtRest();
    });
    listen(this.root, "focusout", (e) => { if (!this.root.contains(e.relatedTarget)) this.isSpaceDown = false; });
    listen(this.input, "keydown", (e) => {
      e.stopPropagation();
      if (e.key === "Enter" || e.key === "Escape") this.endRename(e.key === "Enter");
    });
    listen(this.input, "blur", () => this.endRename(true));
    this.observer = new ResizeObserver(() => this.guard(() => this.layout()));
    this.observer.observe(this.root);
    this.themes = new MutationObserver(() => this.guard(() => this.applyTheme()));
    this.themes.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
  }

  close() {
    this.sender.flush();
    this.unlisten();
    this.closed.abort();
    this.selection.close();
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.bus.removeEventListener("deformnb:points", this.moved);
    this.observer.disconnect();
    this.themes.disconnect();
    cancelAnimationFrame(this.frame);
    for (const timer of [this.slowTimer, this.lookTimer, this.tipTimer, this.alertTimer]) clearTimeout(timer);
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  // Whatever goes wrong in here is said in the widget, and the page goes on.
  guard(action) {
    try { return action(); } catch (error) {
      console.error(error);
      this.say(`The editor met an error: ${error.message}`);
      return undefined;
    }
  }

  // ---- what comes from Python ---------------------------------------------------------------------------------------

  message(message, buffers) {
    if (message?.type === "error") this.say(String(message.message), true);
    if (message?.type === "look") this.lookAt(message.id);
    if (message?.type === "pictures" && (!message.view || message.view === this.id)) this.receivePictures(message, buffers);
  }

  receivePictures({ seq, panes, facts }, buffers) {
    const parts = [...buffers];
    const bytes = (b) => (b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b));
    for (const pane of panes) {
      const pixels = bytes(parts.shift());
      const depths = pane.hasDepths ? new Float32Array(bytes(parts.shift()).slice().buffer) : null;
      this.pictures[pane.index].take(pane, pixels, depths, pane.shapes ? bytes(parts.shift()) : null);
    }
    this.#expectPictures(false);
    this.facts = { ...(facts.isBad ? { folds: this.facts.folds } : {}), folds: this.facts.folds, worst: this.facts.worst,
      ...facts };
    this.shownCount += 1;
    this.drawNow();
    if (seq) this.model.send({ type: "seen", view: this.id, seq });
    this.waitingSince = -Infinity;
    this.#sendLook();
  }

  set(name, value) {
    this.model.set(name, value);
    this.model.save_changes();
    this.invalidate();
  }

  receive() {
    const { points } = this.sender;
    if (this.drag0) { // Python has found where a new point takes hold; the hand keeps the rest
      this.drag0 = withSources(this.drag0, points);
      this.points = withSources(this.points, points);
      return;
    }
    if (samePoints(points, this.points)) return;
    this.points = points;
    this.select([...this.selected]);
    publishPoints(this.bus, { origin: this.id, points, settings: settingsOf(this.model), fit: null, phase: "end" });
    this.invalidate();
  }

  receiveCursor() {
    const given = this.model.get("cursor");
    if (this.looked.delete(JSON.stringify(given)) || this.pendingLook) return; // our own, or an older one
    this.cursor = [...given];
    this.invalidate();
  }

  setPanes() {
    this.panes = this.model.get("panes");
    for (const pane of this.pictures) { pane.picture = null; pane.isFitted = true; }
    this.layout();
  }

  get isWorkedIn() { return this.root.matches(":focus-within"); }

  get isWaiting() { return Boolean(this.model.get("waiting")); }

  get isLocked() { return this.isWaiting || this.model.get("read_only"); }

  get isSlice() { return this.model.get("projection") === "slice"; }

  // While Python makes something else, nothing here can be edited; a hand that is at it is as if it had not begun.
  showWaiting() {
    const { isWaiting } = this;
    if (isWaiting) {
      for (const gestures of this.gestures) gestures.cancel();
      this.endRename(false);
      this.setAdding(false);
    }
    this.row.classList.toggle("dnb-ed-waiting", isWaiting);
    this.row.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, this.model.get("waiting") || (this.isSlow ? "Making the pictures" : ""));
    this.invalidate();
  }

  // ---- where the slices lie -----------------------------------------------------------------------------------------

  // The first pictures of a large volume take seconds, and those of all of it too: nobody shall look at mere grey.
  #expectPictures(isExpected = true) {
    clearTimeout(this.slowTimer);
    if (isExpected) this.slowTimer = setTimeout(() => this.guard(() => { this.isSlow = true; this.showWaiting(); }), SLOW_PICTURES);
    else if (this.isSlow) {
      this.isSlow = false;
      this.showWaiting();
    }
  }

  // What Python shall show; `cursor` at the pace at which pictures come, and the newest only.
  look(what, isMoving = false) {
    this.pendingLook = { ...this.pendingLook, ...what, moving: isMoving };
    if ("projection" in what || "original" in what) this.#expectPictures();
    this.#sendLook();
  }

  #sendLook() {
    clearTimeout(this.lookTimer);
    if (!this.pendingLook) return;
    const now = performance.now(), since = now - this.waitingSince;
    if (since < LOOK_PATIENCE) {
      this.lookTimer = setTimeout(() => this.#sendLook(), LOOK_PATIENCE - since);
      return;
    }
    this.waitingSince = now;
    if (this.pendingLook.cursor) this.looked.add(JSON.stringify(this.pendingLook.cursor));
    if (this.looked.size > 20) this.looked.delete(this.looked.values().next().value);
    this.model.send({ type: "look", view: this.id, ...this.pendingLook });
    this.pendingLook = null;
  }

  lookAtRest() { if (this.isSlice) this.look({ cursor: this.cursor }, false); }

  setCursor(place, isMoving) {
    const next = this.panes.reduce((at, pane) => {
      const [a, b, c] = inPane(pane, at), [low, high] = pane.depths;
      return c < low || c > high ? fromPane(pane, [a, b, Math.max(low, Math.min(high, c))]) : at;
    }, place);
    this.cursor = next;
    this.look({ cursor: next }, isMoving);
    this.invalidate();
  }

  setDepth(pane, depth) {
    const [a, b] = inPane(pane.info, this.cursor);
    this.setCursor(fromPane(pane.info, [a, b, depth]), true);
  }

  scroll(pane, slices) {
    const { depths: [first], spacing } = pane.info, now = Math.round((pane.depth - first) / spacing[2]);
    this.setDepth(pane, first + (now + slices) * spacing[2]);
    this.lookAtRest();
  }

  // The cross-hair of a picture to a place on the screen: all of it, or one line only.
  moveCross(pane, at, line, isMoving) {
    const [a, b] = pane.toPlane(at), [a0, b0, c0] = inPane(pane.info, this.cursor);
    const place = this.isSlice || line ? [line === "h" ? a0 : a, line === "v" ? b0 : b, c0]
      : inPane(pane.info, pane.under(at)); // of the whole volume: what is seen there
    this.setCursor(fromPane(pane.info, place), isMoving);
  }

  goTo(id) {
    const p = this.points.find((q) => q.id === id);
    if (!p) return;
    this.select([id]);
    this.setCursor([...p.target], false);
    this.speak(`slices at ${p.name || `point ${id}`}`);
  }

  lookAt(id) {
    const p = this.points.find((q) => q.id === id);
    for (const pane of p ? this.pictures : []) pane.lookAt(p.target);
  }

  paneOf(node) { return this.pictures.find((pane) => pane.root.contains(node)) ?? this.pictures[0]; }
}

function render({ model, el }) {
  const page = new SpaceEditorPage(model, el);
  return () => page.close();
}

function initialize({ model }) {
  const bus = busOf(model), uid = model.get("uid");
  holdBus(bus);
  const sender = senderOf(bus, model), leave = () => sender.flush(); // a page that goes says its last word
  sender.attach(model);
  window.addEventListener("pagehide", leave);
  model.on("destroy", () => {
    window.removeEventListener("pagehide", leave);
    sender.detach(model);
    if (sender.models.length === 0) bus.sender = null;
    releaseBus(bus, uid);
  });
}

export default { initialize, render };
