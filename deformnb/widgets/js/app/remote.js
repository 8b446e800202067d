// Over pictures that come by trame's remote controlled area: what is seen and from where, and a cube to look from
// another side. Each picture that has come is told to Python, which sends no more than that. Joined before
// app/app.js, whose Vue application it is a component of.

import { Camera } from "../maths/camera.js";
import { pageElement, setText } from "../ui/dom.js";
import { OrientationCube } from "../ui/orientation_cube.js";
import { captionsOf, Frames } from "../ui/view_parts.js";

const REMOTE_TOPIC = "trame.rca.topic.stream";
export const APP_PAGE = Math.random().toString(36).slice(2); // tells this page from others

export const AppRemote = {
  props: { area: String, views: Object }, // views: direction and up of a camera by the name of a side
  inject: ["trame"],
  template: '<div ref="root" class="dnb-view dnb-app-over" data-background="dark"></div>',
  mounted() {
    const { root } = this.$refs;
    this.session = this.trame.client.getConnection().getSession();
    this.frames = new Frames(root);
    this.cube = new OrientationCube(root, (side) => this.call("deformnb.look", side), () => this.call("deformnb.look", "home"));
    this.badge = pageElement("div", "dnb-badge", root, { role: "status" });
    this.hearing = this.session.subscribe(REMOTE_TOPIC, ([picture]) => this.hear(picture));
  },
  methods: {
    hear({ name, meta }) {
      if (name !== this.area || !meta?.n) return;
      const camera = new Camera();
      camera.look(meta.camera.direction, meta.camera.up);
      this.frames.show(captionsOf(meta.shows, meta.layer));
      this.frames.write(camera);
      this.cube.draw(this.views, camera);
      setText(this.badge, meta.badge || "");
      this.$refs.root.deformnb = meta; // for tests and for whoever looks into the page
      this.call("deformnb.seen", this.area, meta.n, APP_PAGE);
    },
    // A call that fails because the connection has gone is no news: the page says so by itself.
    call(method, ...given) { this.session.call(method, given).catch(() => {}); },
  },
  beforeUnmount() { this.session.unsubscribe(this.hearing)?.catch?.(() => {}); },
};
