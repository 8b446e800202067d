// Keys pressed anywhere in the editor, turned into calls of the page. Those that are told are in key_help.js.

class EditorKeys {
  constructor(page, gestures) { Object.assign(this, { page, gestures }); }

  key(event) {
    const { page } = this, isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird, isAlt = event.altKey && !isThird;
    if (event.target.closest("input, select")) { // have keys of their own
      if (event.key === "Escape" && event.target === page.brush.slider) { page.brush.stop(); page.focusStage(); }
      return;
    }
    if (!isCommand && event.target.closest(".dnb-ed-help")) { if (event.key === "Escape" || event.key === "?") page.closeHelp(); return; }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const handled = isCommand ? this.command(key, event) : this.plain(key, event, isAlt);
    if (!handled) return;
    event.preventDefault();
    event.stopPropagation();
  }

  command(key, event) {
    const { page } = this, focused = this.gestures.idAt(event);
    if (POINT_STEPS[key] && event.target.closest("button")) return false;
    if (POINT_STEPS[key]) page.handles.focusNext(page.points.map((p) => p.id), POINT_STEPS[key], focused?.id);
    else if (key === "z") page.stepHistory(event.shiftKey ? "redo" : "undo");
    else if (key === "y") page.stepHistory("redo");
    else if (key === "a") page.select(page.points.map((p) => p.id));
    else return false;
    return true;
  }

  // Keys on a line, a corner or the middle of an edge.
  shapeKey(key, event, shape, arrow) {
    const { page } = this, isOther = JSON.stringify(shape.chosen) !== JSON.stringify(page.chosen);
    if (key === "Enter" && shape.middle !== null) { if (!page.isLocked) page.insertCorner(shape.middle); return true; }
    if (key === "Enter") { page.chooseShape(isOther || shape.corner !== null ? shape.chosen : null); return true; }
    if (!arrow && !["Delete", "Backspace", "F2", "o", "f"].includes(key)) return false;
    if (isOther) page.chooseShape(shape.chosen);
    if (page.isLocked) return true;
    if (arrow) page.nudgeShape(shape, arrow, event.shiftKey ? 10 : 1);
    else if ((key === "Delete" || key === "Backspace") && shape.middle !== null) page.hint("Here is no corner to delete yet");
    else if (shape.corner !== null && (key === "Delete" || key === "Backspace")) page.removeCorner(shape.corner);
    else page.run(commandOf(EDITOR_KEYS, key), null);
    return true;
  }

  plain(key, event, isAlt) {
    const { page } = this, onButton = event.target.closest("button");
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const focused = this.gestures.idAt(event), shape = focused ? null : this.gestures.shapeAt(event);
    if (!onButton && page.pen.isOn && !isAlt && page.pen.key(key, event, arrows[key])) return true;
    if (!onButton && page.brush.isOn && !isAlt && page.brush.key(key, event, arrows[key])) return true;
    if (this.gestures.markAt(event) === "axis" && key in arrows) return this.axisKey(arrows[key], event.shiftKey ? 10 : 1);
    if (shape && !onButton && !isAlt && this.shapeKey(key, event, shape, arrows[key])) return true;
    if (onButton && (key in arrows)) return page.toolbar.focusNext(onButton, key);
    if (onButton && (key === "Enter" || key === " ")) return false;
    if (key in arrows) {
      page.nudge(focused?.id ?? null, arrows[key], event.shiftKey ? 10 : 1, isAlt ? "both" : "target");
      return true;
    }
    const way = TURN_WAYS[isAlt ? TURN_CODES[event.code] : key];
    if (way) { page.turnKey(way, { isLarge: event.shiftKey, isScale: isAlt }); return true; }
    if (isAlt) return false;
    if (key === " ") { this.gestures.space(true); return true; }
    if (key === "Enter") {
      if (focused) page.toggleSelected(focused.id);
      else if (!page.isLocked) page.addInMiddle();
      return true;
    }
    if (key === "Escape") return this.gestures.escape();
    if (key === "[" || key === "]") { page.brush.grow(key === "]" ? 1 : -1); return true; }
    const command = (event.shiftKey && commandOf(EDITOR_KEYS, `Shift+${key}`)) || commandOf(EDITOR_KEYS, key);
    if (!command) return false;
    page.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, focused?.id ?? null);
    return true;
  }

  axisKey([dx, dy], pixels) {
    const { page } = this, c = page.mirror.axis === "a" ? 0 : 1;
    page.moveAxis(page.mirror.at + pixels * [dx, dy][c] * page.model.get("raster").spacing[c], true);
    page.speak(`axis at ${shownLength(page.mirror.at)}`);
    return true;
  }
}
