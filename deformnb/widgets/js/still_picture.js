// A picture that Python renders, over the canvas of a view whose page cannot draw.

class StillPicture {
  constructor(page) {
    this.page = page;
    this.after = null; // called once, when the next picture has come
    this.image = pageElement("img", "dnb-still", page.root, { alt: page.model.get("label") || "Volume" });
  }

  ask() {
    const { model, theme } = this.page;
    this.page.send({ type: "still", width: model.get("width"), height: model.get("height"), background: theme.name });
  }

  receive(png) {
    URL.revokeObjectURL(this.image.src);
    this.image.src = URL.createObjectURL(new Blob([bytesOf(png)], { type: "image/png" }));
    const { after } = this;
    this.after = null;
    after?.();
  }

  close() {
    URL.revokeObjectURL(this.image.src);
    this.image.remove();
  }
}
