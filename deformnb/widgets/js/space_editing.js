// What the editor in space draws and says, and its edits. SpaceEditorPage is this and the talk with Python.

const LEAST_HEIGHT = 140; // CSS pixels of a picture
const SPACE_FOLD_TIP = "Smallest factor by which volumes are stretched, on a coarse lattice: 1 keeps them; below 0 the " +
  "volume folds over itself";

const SPACE_GROUPS = [
  [["add", "Add", "Add points: click where", true],
    ["select", "Select", "Select several points: drag a band, or tap them", true],
    ["remove", "Delete", "Delete the selected points", false, "selection"],
    ["rename", "Rename", "Name the selected point", false, "one"],
    ["switch", "On/off", "Switch the selected points on or off", false, "selection"],
    ["lock", "Lock", "Lock the selected points, or free them", true, "selection"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken", false, "points"]],
  [["undo", "Undo", "Undo", false, "past"], ["redo", "Redo", "Redo", false, "future"]],
  [["go", "Go to", "Bring the slices to the selected point", false, "one"],
    ["compare", "Before", "Show the volume as it was", true]],
  [["zoom-out", "", "Zoom out"], ["zoom-in", "", "Zoom in"], ["fit", "Fit", "Show the whole pictures"]],
  [["more", "More", "More tools", false], ["help", "Keys", "Keys and gestures", true]],
];
const SPACE_MORE = [
  [["mirror", "Mirror", "Do the same on both sides of a plane", true],
    ["mirror-axis", "Mirror another way", "Lay the plane of the mirror across the next axis", false],
    ["snap", "Snap to a lattice", "Targets keep to the nodes of a lattice", true]],
  [["turn-left", "Turn left by 15\u00b0", "Turn the selected points to the left in the picture", false, "points_selected"],
    ["turn-right", "Turn right by 15\u00b0", "Turn the selected points to the right in the picture", false, "points_selected"]],
];

class SpaceEditing extends EditorDrawing {
  // ---- drawing ------------------------------------------------------------------------------------------------------

  layout() {
    this.applyTheme(); // a style sheet that comes late changes sizes as well
    this.root.setAttribute("aria-label", `Editor in space of ${this.model.get("label") || "Volume"}`);
    const widths = this.pictures.map((pane) => Math.max(100, pane.stage.clientWidth || 260)), most = this.model.get("height");
    const wanted = this.pictures.map(({ info: { box: [a0, a1, b0, b1] } }, k) => widths[k] * (b1 - b0) / (a1 - a0));
    const height = Math.round(Math.max(LEAST_HEIGHT, Math.min(most, Math.max(...wanted))));
    this.pictures.forEach((pane, k) => pane.layout(widths[k], height));
    this.drawNow();
  }

  draw() {
    if (this.pictures.map((pane) => pane.draw()).some(Boolean)) this.focusStage(); // no shortcut: all are drawn
    this.describe();
  }

  describe() {
    const { points, selected, facts } = this, off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one ? `point ${one.id}${one.name ? ` ${one.name}` : ""} at ${one.target.map(shownLength).join(", ")}`
      : selected.size ? `${selected.size} selected` : "";
    setText(this.factsLine, points.length ? [count, chosen].filter(Boolean).join(" \u00b7 ")
      : "No points yet: four or more in space bend the volume, one moves it");
    this.#describeFolds(points.length ? facts.folds : null);
    setText(this.notes, facts.note || this.#advice());
    this.notes.classList.toggle("dnb-ed-bad", Boolean(facts.isBad));
    this.notes.classList.toggle("dnb-ed-near", !facts.isBad && Boolean(facts.note));
    this.chooser.value = this.model.get("projection");
    const pressed = Object.entries({ add: this.isAdding, select: this.isSelecting,
      mirror: this.mirror.on, snap: this.model.get("snap") > 0, compare: this.model.get("shows_original"), help: !this.help.hidden,
      lock: selected.size > 0 && points.every((p) => p.locked || !selected.has(p.id)) });
    this.toolbar.update({ count: points.length, selected: selected.size, past: this.sender.canStep("undo"),
      future: this.sender.canStep("redo"), steps: this.model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name), readOnly: this.isLocked });
  }

  #describeFolds(folds) {
    const [least, share] = folds ?? [1, 0], value = `min det J ${least.toFixed(2)}`;
    this.foldFact.classList.toggle("dnb-ed-bad", least <= 0);
    this.foldFact.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    const words = least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds" : "\u2713 no folds";
    setText(this.foldFact, folds ? `${words} (${value})` : "");
    setAttributes(this.foldFact, { title: folds ? SPACE_FOLD_TIP : "" });
  }

  // What can be done next, where there is nothing to remark.
  #advice() {
    if (this.model.get("read_only")) return "These points are shown only";
    if (this.points.length === 0) return "Double-click a picture to add a point; click to bring the slices there; ? lists all keys";
    if (this.selected.size === 0) {
      const wheel = this.isSlice ? "goes through the slices" : "zooms";
      return `Drag a disc to move what lies under it; the wheel ${wheel}; ? lists all keys`;
    }
    return "Arrows move the selected points, J brings the slices to them, Delete removes them, Home puts them back";
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  edit(points, kind = "move", join = null) {
    if (this.isLocked || samePoints(points, this.points)) return false;
    if (JSON.stringify(points).length > LONGEST_EDIT) {
      this.say("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    this.sender.edit(points, kind, join); // which tells all views, this one too
    return true;
  }

  stepHistory(way) {
    if (this.drag0 || this.isLocked || !this.sender.step(way)) return;
    this.speak(way === "undo" ? "undone" : "redone");
  }

  beginDrag() { if (!this.isLocked) this.drag0 = this.points; }

  drag(ids, way, what, id) {
    if (this.drag0) this.show(this.symmetric(this.drag0, movedInSpace(this.drag0, ids, way, what), this.sideOfPoint(id)));
  }

  // Points on their way.
  show(points) {
    this.points = points;
    publishPoints(this.bus, { origin: this.id, points: this.points, settings: settingsOf(this.model), fit: null, phase: "move" });
    this.sender.move(this.points);
    this.invalidate();
  }

  endDrag(isCancelled, kind = "move") {
    const before = this.drag0, points = this.points;
    this.drag0 = null;
    if (!before) return;
    this.points = before;
    if (!isCancelled && this.edit(points, kind)) return;
    this.points = this.sender.points; // Python may have moved them meanwhile
    publishPoints(this.bus, { origin: this.id, points: this.points, settings: settingsOf(this.model), fit: null, phase: "end" });
    this.sender.move(this.points); // Python has seen the drag, and now that it is no more
    this.invalidate();
  }

  #chosen(id) { return id !== null && !this.selected.has(id) ? [id] : [...this.selected]; }

  nudge(pane, id, [dx, dy], voxels, what) {
    const { spacing: [du, dv] } = pane.info, way = wayInPane(pane.info, dx * voxels * du, dy * voxels * dv);
    this.#nudgeBy(id, way, what);
  }

  nudgeDepth(pane, id, voxels) {
    const by = voxels * pane.info.spacing[2], ids = this.#chosen(id);
    if (ids.length) this.#nudgeBy(id, pane.info.n.map((x) => by * x), "target");
  }

  #nudgeBy(id, way, what) {
    const ids = this.#chosen(id);
    if (ids.length === 0) { this.setCursor(this.cursor.map((x, k) => x + way[k]), true); return; }
    if (id !== null && !this.selected.has(id)) this.select([id]);
    const free = freeIds(this.points, ids);
    if (!free.length) this.tellLocked(ids[0]);
    this.change(movedInSpace(this.points, free, way, what), "nudge", `nudge ${ids}`);
    const p = ids.length === 1 && this.points.find((q) => q.id === ids[0]);
    if (p) this.speak(`point ${p.id} at ${p.target.map(shownLength).join(", ")}`);
  }

  // A new point takes hold of what is seen where it is put: Python looks up where that comes from, and nothing moves.
  addAt(pane, at) {
    const flat = this.points.map((p) => flatPoint(p, pane.info, this.isSlice ? pane.depth : null)), { k, x, y } = pane.view;
    const near = flat.find((p) => !p.isFar && Math.hypot(k * p.target[0] + x - at[0], k * p.target[1] + y - at[1]) < SPACE_NEAR);
    if (near) { this.select([near.id]); pane.handles.focus(near.id); return near.id; }
    if (!pane.isInside(at)) { this.hint("Points are put inside the volume"); return null; }
    return this.addPlace(fromPane(pane.info, this.snapped(pane.info, inPane(pane.info, pane.under(at)))), pane);
  }

  addAtCursor(pane) { this.addPlace(this.cursor, pane); }

  addPlace(place, pane) {
    const id = nextId(this.points, this.sender.nextId), points = addedPoint(this.points, id, place, place);
    if (!this.change(points, "add")) return null;
    this.select([id]);
    this.drawNow();
    pane.handles.focus(id);
    this.speak(`point ${id} added at ${place.map(shownLength).join(", ")}`);
    return id;
  }

  tellLocked(id) {
    const p = this.points.find((q) => q.id === id);
    if (p) this.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  toggleLock(ids) {
    if (!ids.length) this.hint("Select points to lock them");
    else if (this.edit(lockedPoints(this.points, ids), "lock")) {
      this.speak(this.points.find((p) => p.id === ids[0]).locked ? "locked" : "free");
    }
  }

  remove(wanted) {
    const ids = freeIds(this.points, wanted);
    if (wanted.length && !ids.length) this.tellLocked(wanted[0]);
    const at = this.points.findIndex((p) => p.id === ids[0]), pane = this.paneOf(document.activeElement);
    const hadFocus = this.root.contains(this.root.getRootNode().activeElement);
    if (!ids.length || !this.change(removedPoints(this.points, ids), "remove")) return;
    this.speak(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    this.drawNow();
    const next = this.points[Math.min(at, this.points.length - 1)];
    if (hadFocus && !(next && pane.handles.focus(next.id))) pane.stage.focus({ preventScroll: true });
  }

  rename(id, pane = this.paneOf(document.activeElement)) {
    const p = this.points.find((q) => q.id === id);
    if (!p || this.isLocked) return;
    const flat = flatPoint(p, pane.info, null), { k, x, y } = pane.view, box = this.row.getBoundingClientRect();
    const stage = pane.stage.getBoundingClientRect();
    Object.assign(this, { renamed: id, renamedIn: pane });
    this.input.hidden = false;
    this.input.value = p.name;
    this.input.placeholder = `point ${id}`;
    this.input.style.left = `${Math.max(4, Math.min(box.width - 164, stage.left - box.left + k * flat.target[0] + x + 12))}px`;
    this.input.style.top = `${Math.max(4, stage.top - box.top + k * flat.target[1] + y - 30)}px`;
    this.input.focus();
    this.input.select();
  }

  endRename(isKept) {
    if (this.input.hidden) return;
    const id = this.renamed, hadFocus = this.root.getRootNode().activeElement === this.input;
    this.input.hidden = true;
    if (isKept) this.edit(renamedPoint(this.points, id, this.input.value), "rename");
    if (!this.renamedIn.handles.focus(id) && hadFocus) this.renamedIn.stage.focus({ preventScroll: true });
  }

  // ---- selection and commands ---------------------------------------------------------------------------------------

  select(ids, isShared = true) {
    const known = new Set(this.points.map((p) => p.id)), next = new Set((ids ?? []).filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    this.invalidate();
    if (isSame || !isShared) return;
    this.selection.tellSoon([...this.selected]);
  }

  toggleSelected(id) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  run(command, focused) {
    const ids = this.#chosen(focused), all = this.points.map((p) => p.id);
    if (focused === null && this.toolbar.isOff(command)) return;
    const active = this.paneOf(document.activeElement);
    if (this.runTool(command, active)) return;
    const every = (f) => this.pictures.forEach(f);
    const commands = {
      add: () => this.setAdding(!this.isAdding), select: () => this.setSelecting(!this.isSelecting), remove: () => this.remove(ids), undo: () => this.stepHistory("undo"),
      redo: () => this.stepHistory("redo"), rename: () => ids.length === 1 && this.rename(ids[0], active),
      switch: () => this.change(switchedPoints(this.points, ids), "switch"),
      reset: () => this.change(resetPoints(this.points, freeIds(this.points, ids.length ? ids : all)), "reset"),
      lock: () => this.toggleLock(ids),
      go: () => ids.length === 1 && this.goTo(ids[0]),
      compare: () => this.look({ original: !this.model.get("shows_original") }),
      "zoom-in": () => every((pane) => pane.zoomAt(1.25)), "zoom-out": () => every((pane) => pane.zoomAt(0.8)),
      fit: () => every((pane) => pane.fitView()), help: () => this.toggleHelp(),
    };
    commands[command]?.();
  }

  // While it is on, whatever is dragged around or clicked is added to what is selected: fingers have no Shift key.
  setSelecting(isSelecting) {
    if (isSelecting) this.setAdding(false);
    this.isSelecting = isSelecting;
    if (isSelecting) this.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    this.invalidate();
  }

  setAdding(isAdding) {
    if (isAdding) this.setSelecting(false);
    this.isAdding = isAdding && !this.isLocked;
    this.row.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) this.hint("Click where a feature is, and drag it. Esc when done");
    this.invalidate();
  }

  // The focus goes to the list, and back to where it was.
  toggleHelp() {
    const { activeElement } = this.root.getRootNode();
    this.help.hidden = !this.help.hidden;
    if (!this.help.hidden) {
      this.beforeHelp = this.root.contains(activeElement) ? activeElement : null;
      this.help.focus();
    } else if (this.beforeHelp?.isConnected) this.beforeHelp.focus({ preventScroll: true });
    else this.pictures[0].stage.focus({ preventScroll: true });
    this.invalidate();
  }

  escape() {
    if (this.gestures.some((gestures) => gestures.cancel())) return true;
    if (!this.help.hidden) { this.toggleHelp(); return true; }
    if (this.isAdding || this.isSelecting) { this.setAdding(false); this.setSelecting(false); return true; }
    if (this.selected.size === 0) return false;
    this.select([]);
    return true;
  }

  focusStage() { this.paneOf(document.activeElement).stage.focus({ preventScroll: true }); }
}
