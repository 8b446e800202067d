// What is seen in place of a view whose page cannot draw: pictures by Python, or in a page without Python the one it has.

class StillPicture {
  constructor(page, why) {
    Object.assign(this, { page, why, pictures: null, after: null, info: null });
    this.image = pageElement("img", "dnb-still", page.root, { alt: page.model.get("label") || "Volume" });
  }

  /** Asks whoever is there; Python answers that it draws, and does so from then on. */
  ask() {
    if (!this.pictures) this.page.send({ type: "still", background: this.page.theme.name });
  }

  /** Calls `tell` when what is shown now has a picture; Python's own pictures are no business of a field's. */
  then(tell) {
    if (this.pictures) { tell(); return; }
    this.after = tell;
    this.ask();
  }

  receive(png) {
    URL.revokeObjectURL(this.image.src);
    this.image.src = URL.createObjectURL(new Blob([bytesOf(png)], { type: "image/png" }));
    this.#tell();
  }

  /** Python draws: its page takes the place of the one that cannot. */
  drawn(info) {
    if (info) this.inform(info);
    if (this.pictures) return;
    const { page } = this, { model } = page;
    const part = { get: (name) => (name === "volume_info" && this.info) || model.get(name), set: (name, value) => model.set(name, value),
      save_changes: () => model.save_changes(), on: (name, call) => model.on(name, call),
      off: (name, call) => model.off(name, call), widget_manager: model.widget_manager,
      send: (content) => model.send({ type: "drawn", view: page.id, say: content }) };
    page.root.hidden = true;
    this.pictures = new PicturesPage(part, page.host);
    this.pictures.root.deformnb = this.pictures;
    this.pictures.say(this.why);
    this.#tell();
  }

  /** The box that Python's pictures show, which is the result's and not always the volume's own. */
  inform(info) {
    this.info = info;
    this.pictures?.readInfo();
  }

  #tell() {
    const { after } = this;
    this.after = null;
    after?.();
  }

  close() {
    this.pictures?.close();
    this.page.root.hidden = false;
    URL.revokeObjectURL(this.image.src);
    this.image.remove();
  }
}
