// Pointer, wheel and keys of the live view: turn, move, zoom. One finger turns, two move and zoom.

const TURN = 2.6; // radians for a drag across the smaller side of the view
const KEY_TURN = Math.PI / 36;

export class Hands {
  constructor(page) {
    this.page = page;
    this.points = new Map();
    const { canvas } = page;
    const add = (name, handler, target = canvas) => {
      const guarded = (event) => { if (page.info) handler(event); };
      target.addEventListener(name, guarded, { passive: false });
      this.listeners.push([target, name, guarded]);
    };
    this.listeners = [];
    add("pointerdown", (e) => this.down(e));
    add("pointermove", (e) => this.move(e));
    for (const name of ["pointerup", "pointercancel"]) add(name, (e) => this.up(e));
    add("wheel", (e) => this.wheel(e));
    add("dblclick", (e) => { if (!page.spacePoints?.doubleClick(e)) page.reset(); });
    add("keydown", (e) => this.key(e));
    const lost = (e) => page.lost(e), back = () => page.restored();
    canvas.addEventListener("webglcontextlost", lost);
    canvas.addEventListener("webglcontextrestored", back);
    this.listeners.push([canvas, "webglcontextlost", lost], [canvas, "webglcontextrestored", back]);
  }

  get isBusy() { return this.points.size > 0; }

  /** The box of the picture, of two side by side the one at x, in CSS pixels. */
  box(x = 0) {
    const whole = this.page.canvas.getBoundingClientRect();
    const parts = this.page.shown === "side_by_side" ? 2 : 1, width = whole.width / parts;
    const part = Math.max(0, Math.min(parts - 1, Math.floor((x - whole.left) / width)));
    return { left: whole.left + part * width, top: whole.top, width, height: whole.height };
  }

  close() { for (const [target, name, handler] of this.listeners) target.removeEventListener(name, handler); }

  down(event) {
    if (event.button > 1) return; // the right button belongs to the browser
    this.page.canvas.setPointerCapture(event.pointerId);
    this.page.canvas.focus({ preventScroll: true });
    this.points.set(event.pointerId, [event.clientX, event.clientY]);
    this.moving = false;
  }

  move(event) {
    const before = this.points.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    const { camera } = this.page, box = this.box(), small = Math.min(box.width, box.height);
    if (this.points.size === 2) this.pinch(event.pointerId, before, now, box);
    else if (event.shiftKey || event.buttons === 4) this.pan(dx, dy, box);
    else if (event.altKey) camera.roll((-dx / small) * TURN);
    else camera.turn((dx / small) * TURN, (dy / small) * TURN);
    this.points.set(event.pointerId, now);
    this.moving = true;
    this.page.touch(true);
  }

  pan(dx, dy, box) {
    const { camera } = this.page, length = camera.height / box.height;
    camera.pan = [camera.pan[0] - dx * length, camera.pan[1] + dy * length];
  }

  pinch(id, before, now, box) {
    const [other] = [...this.points].filter(([key]) => key !== id).map(([, point]) => point);
    const distance = (p) => Math.max(8, Math.hypot(p[0] - other[0], p[1] - other[1]));
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2, box);
    this.zoom(distance(now) / distance(before));
  }

  up(event) {
    if (!this.points.delete(event.pointerId) || this.points.size) return;
    if (this.page.loop) this.page.loop.release();
    if (this.moving) this.page.writeCamera();
    else if (event.type === "pointerup") this.page.flicker.press(false);
  }

  /** Zooms by a factor, keeping the place under (x, y) of the page where it is. */
  zoom(factor, x = null, y = null) {
    const { camera } = this.page, box = this.box(x ?? 0);
    const full = camera.fit(this.page.corners(), this.page.aspect);
    const height = Math.min(8 * full, Math.max(full / 60, camera.height / factor)), change = camera.height - height;
    if (x !== null) {
      camera.pan[0] += change * ((x - box.left - box.width / 2) / box.height);
      camera.pan[1] -= change * ((y - box.top - box.height / 2) / box.height);
    }
    camera.height = height;
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1);
    this.zoom(Math.exp(-Math.max(-300, Math.min(300, pixels)) * 0.0016), event.clientX, event.clientY);
    this.page.touch();
    this.later();
  }

  /** One message to Python when the wheel or a key rests, not one for each notch. */
  later() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => { if (!this.page.closed) this.page.writeCamera(); }, 300);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { camera } = this.page, step = event.shiftKey ? 3 * KEY_TURN : KEY_TURN;
    const turns = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    if (event.key === " " && !this.page.flicker.press(true)) return;
    if (turns[event.key]) camera.turn(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoom(1.2);
    else if (event.key === "-") this.zoom(1 / 1.2);
    else if (event.key === "0") this.page.reset();
    else if (event.key !== " ") return;
    event.preventDefault(); // and not to the notebook, whose cells listen to the same keys
    event.stopPropagation();
    if (event.key === " ") return;
    this.page.touch();
    if (event.key !== "0") this.later();
  }
}
