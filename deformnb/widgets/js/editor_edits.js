// The editor's edits of points: drags, nudges, new points. EditorPage is this, the hand's further tools, and the model.

const HOLD_LEAST = 0.05; // of det J, before which a hand is stopped that must not fold the map
const HOLD_WORK = 6e4, HOLD_NODES = [9, 33]; // evaluations of a kernel for one look, on a lattice of so many nodes a side

class EditorEdits extends EditorShapes {
  // The next list of points, unless it cannot be fitted while the present one can: then it is said why. `kind` is
  // what Python hears; edits with the same `join` in quick succession are undone as one.
  edit(points, kind = "move", join = null) {
    if (this.isLocked || samePoints(points, this.points)) return false;
    if (!this.error && !this.accepts(points)) return false;
    if (JSON.stringify(points).length > LONGEST_EDIT) {
      this.say("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    this.sender.edit(points, kind, join); // which tells all views, this one too
    return true;
  }

  accepts(points, shapes = this.shapes) {
    try { layeredFit(points, { ...this.settings, ...shapes, previous: this.layered }); } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      this.say(error.message, true);
      this.handles.blink(points.filter((p) => error.message.includes(rbfLabel(p))).map((p) => p.id));
      return false;
    }
    return true;
  }

  stepHistory(way) {
    if (this.drag0 || this.isLocked || !this.sender.step(way)) return;
    this.speak(way === "undo" ? "undone" : "redone");
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  get isHolding() { return this.drag0 !== null; }

  beginDrag() {
    if (this.isLocked) return;
    this.drag0 = this.points;
    this.least0 = null;
    this.stopNote = "";
    this.wasTold = false;
  }

  // `id` is the point under the hand; a loose hand is not held to the grid.
  drag(ids, dx, dy, what, id = null, isLoose = false) {
    if (!this.drag0) return;
    if (!ids.length) { this.tellLocked([id]); return; }
    const f = (what === "target" ? this.netNodes.pull : 1) / this.view.k;
    const way = this.snappedWay(id, [f * dx, f * dy], what, isLoose), lead = this.sideOfPoint(id);
    this.show((t) => this.symmetric(this.drag0, movedPoints(this.drag0, ids, t * way[0], t * way[1], what), lead));
  }

  // Points on their way, `make(1)` of them, or as far as parts and folds let them go; `make(0)` is where they began.
  show(make) {
    const wanted = this.withoutFolds(make);
    const allowed = this.shapes.parts.length ? this.allowedShare(this.drag0, wanted) : { share: 1, held: [] };
    this.points = allowed.share < 1 ? allowed.points : wanted;
    this.handles.lock(allowed.held.map(({ point }) => point.id));
    if (allowed.held.length) this.tellHeld(allowed.held[0]);
    this.rate.moved(performance.now());
    this.changed(true);
    this.isLive = true;
  }

  tellHeld({ point, part }) {
    const why = part.motion ? "has a motion of its own" : "is fixed";
    this.hint(`${rbfLabel(point)} cannot go into ${partLabel(part)}, which ${why}`);
  }

  // ---- folds --------------------------------------------------------------------------------------------------------

  // The smallest det J that these points make; minus infinity where they cannot be fitted.
  leastOf(points) {
    try {
      const layered = layeredFit(points, { ...this.settings, previous: this.layered }), [few, many] = HOLD_NODES;
      const nodes = Math.max(few, Math.min(many, Math.floor(Math.sqrt(HOLD_WORK / (layered.count + 1)))));
      return foldsOf(layered, this.box, nodes, probesOf(layered, HOLD_WORK / 4)).least;
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }

  // Whether the map folds with these points, and did not before: what is folded already may stay so.
  wouldFold(points) {
    this.least0 ??= this.leastOf(this.drag0);
    return this.leastOf(points) < Math.min(HOLD_LEAST, this.least0) - 1e-9;
  }

  // As far along the way as the map stays free of folds, if that is asked for.
  withoutFolds(make) {
    const wanted = make(1);
    this.stopNote = "";
    if (!this.model.get("stop_at_folds") || !this.wouldFold(wanted)) return wanted;
    this.stopNote = "Stopped before the picture folds; T lets points go on";
    let low = 0, high = 1;
    for (let turn = 0; turn < 8; turn++) {
      const middle = (low + high) / 2;
      if (this.wouldFold(make(middle))) high = middle;
      else low = middle;
    }
    return make(low);
  }

  endDrag(isCancelled, kind = "move") {
    const before = this.drag0, points = this.points;
    this.drag0 = null;
    this.sender.drawn = this.rate.taken();
    this.handles.lock([]);
    if (!before) return;
    this.points = before;
    if (!isCancelled && this.edit(points, kind)) return;
    this.points = this.sender.points; // Python may have moved them meanwhile
    this.changed();
    if (this.wasTold) this.sender.move(this.points); // Python has seen the drag, and now that it is no more
  }

  // ---- single edits -------------------------------------------------------------------------------------------------

  // The same edit on the other side of the mirror, if there is one, and what is locked left where it is.
  change(points, kind, join = null) { return this.edit(this.symmetric(this.points, points, 0, kind === "add"), kind, join); }

  // Those that may be changed, with what goes along with them; it is said if there are none.
  freed(ids) {
    const free = freeIds(this.points, withRims(this.points, ids));
    if (ids.length && !free.length) this.tellLocked(ids);
    return free;
  }

  tellLocked(ids) {
    const p = this.points.find((q) => q.id === ids[0]);
    if (p) this.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  nudge(focused, [dx, dy], pixels, what) {
    const ids = focused !== null && !this.selected.has(focused) ? [focused] : [...this.selected];
    if (ids.length === 0) { this.panBy(-dx * pixels * 4, -dy * pixels * 4); return; }
    if (focused !== null && !this.selected.has(focused)) this.select([focused]);
    const [du, dv] = this.model.get("raster").spacing, free = this.freed(ids);
    this.change(movedPoints(this.points, free, dx * pixels * du, dy * pixels * dv, what), "nudge", `nudge ${ids}`);
    if (ids.length === 1) this.speak(pointLabel(this.points.find((p) => p.id === ids[0])));
  }

  // What is seen at places of the picture, as the source of a point there; null in a gap. Dragged `strength` times, a
  // feature must come from target + D to be seen at the target.
  sourcesOf(layered) {
    const strength = this.model.get("strength") || 1;
    return (target) => {
      const [da, db, opacity] = layered ? placeOf(layered, ...target, 1e-9) : [0, 0, 1];
      return opacity < 0.5 ? null : [target[0] + da / strength, target[1] + db / strength];
    };
  }

  placeAt([x, y]) { return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k]; }

  onView([a, b]) { return [this.view.k * a + this.view.x, this.view.k * b + this.view.y]; }

  // A new point takes hold of what is seen there: its source is where the map looks, so nothing moves.
  addAt([x, y], isLoose = false) {
    const near = this.points.map((p) => [Math.hypot(this.onView(p.target)[0] - x, this.onView(p.target)[1] - y), p.id])
      .sort((p, q) => p[0] - q[0])[0];
    if (near && near[0] < NEAR) { this.select([near[1]]); this.handles.focus(near[1]); return near[1]; }
    const place = this.placeAt([x, y]), target = isLoose ? place : this.snappedPlace(place);
    const source = this.sourcesOf(this.isComparing ? null : this.layered)(target);
    if (source === null) { this.hint("This is a gap: there is nothing here to take hold of"); return null; }
    const id = nextId(this.points, this.sender.nextId);
    if (!this.change([...this.points, newPoint(id, source, target)], "add")) return id;
    this.select([id]);
    this.drawNow();
    this.handles.focus(id);
    this.speak(`${pointLabel(this.points.find((p) => p.id === id))}, added`);
    return id;
  }

  addInMiddle() { this.addAt([this.view.width / 2, this.view.height / 2]); }

  remove(wanted) {
    const ids = this.freed(wanted), at = this.points.findIndex((p) => p.id === ids[0]);
    const hadFocus = this.svg.contains(this.root.getRootNode().activeElement);
    if (!ids.length || !this.change(removedPoints(this.points, ids), "remove")) return;
    this.speak(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    const next = this.points[Math.min(at, this.points.length - 1)];
    this.drawNow();
    if (hadFocus && next) this.handles.focus(next.id);
    else if (hadFocus) this.focusStage();
  }
}
