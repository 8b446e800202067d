// Another picture, laid over the editor's as translucent as is asked for: what the points are dragged to look like.
// Needs elements.js. It lies under the overlay and the handles.

const GHOST_TRAITS = ["ghost", "ghost_opacity"];

class Ghost {
  constructor(page) {
    this.page = page;
    this.image = pageElement("img", "dnb-ed-ghost", page.stage, { alt: "", "aria-hidden": "true", draggable: "false", hidden: "" });
    page.svg.before(this.image);
    this.bytes = null;
    this.url = "";
  }

  // As the traits have it, over the whole of the picture.
  draw() {
    const { model, view: { k, x, y }, box: [a0, a1, b0, b1] } = this.page;
    const bytes = model.get("ghost"), opacity = Number(model.get("ghost_opacity")) || 0;
    if (bytes !== this.bytes) this.#load(bytes);
    this.image.hidden = !this.url || opacity <= 0;
    if (this.image.hidden) return;
    Object.assign(this.image.style, { opacity, left: `${k * a0 + x}px`, top: `${k * b0 + y}px`, width: `${k * (a1 - a0)}px`,
      height: `${k * (b1 - b0)}px` });
  }

  #load(bytes) {
    this.close();
    this.bytes = bytes;
    if (!bytes?.byteLength) return;
    this.url = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
    this.image.src = this.url;
  }

  close() {
    if (this.url) URL.revokeObjectURL(this.url);
    this.url = "";
  }
}
