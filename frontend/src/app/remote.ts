// Captions and an orientation cube over pictures that come by trame's remote controlled area. Python gets an
// acknowledgement of each picture that has come, and sends no more than that.

import { Camera } from "../maths/camera.js";
import { pageElement, setText } from "../ui/dom.js";
import { OrientationCube } from "../ui/orientation_cube.js";
import { captionsOf, Frames } from "../ui/view_parts.js";
import { APP_PAGE, callPython } from "./session.js";

/** @import { ViewDirection } from "../view/types.d.ts" */
/** @import { Component, Session } from "./types.d.ts" */

const REMOTE_TOPIC = "trame.rca.topic.stream";

/**
 * @typedef {object} RemotePicture a message of trame's
 * @property {string} name
 * @property {{n: number, camera: ViewDirection, shows: string, layer: number, badge?: string}} [meta]
 */

/**
 * @typedef {object} Remote
 * @property {string} area
 * @property {Record<string, ViewDirection>} views by the name of a side
 * @property {{root: HTMLElement}} $refs
 * @property {Session} session
 * @property {object} subscription
 * @property {Frames} frames
 * @property {OrientationCube} cube
 * @property {HTMLElement} badge
 * @property {(picture: RemotePicture) => void} receive
 * @property {(view: string) => void} look
 */

/** @type {Component<Remote>} */
const AppRemote = {
  props: { area: String, views: Object },
  inject: ["trame"],
  template: '<div ref="root" class="dnb-view dnb-app-over" data-background="dark"></div>',
  mounted() {
    const { root } = this.$refs;
    this.session = this.trame.client.getConnection().getSession();
    this.frames = new Frames(root);
    this.cube = new OrientationCube(root, (side) => this.look(side), () => this.look("home"));
    this.badge = pageElement("div", "dnb-badge", root, { role: "status" });
    this.subscription = this.session.subscribe(REMOTE_TOPIC, (/** @type {RemotePicture[]} */ [picture]) => (
      this.receive(picture)));
  },
  methods: {
    /** @param {RemotePicture} picture */
    receive({ name, meta }) {
      if (name !== this.area || !meta?.n) return;
      const camera = new Camera();
      camera.look(meta.camera.direction, meta.camera.up);
      this.frames.show(captionsOf(meta.shows, meta.layer));
      this.frames.write(camera);
      this.cube.draw(this.views, camera);
      setText(this.badge, meta.badge || "");
      Object.assign(this.$refs.root, { deformnb: meta }); // for tests and for debugging
      callPython(this.session, "deformnb.seen", [this.area, meta.n, APP_PAGE]);
    },
    /** @param {string} view */
    look(view) { callPython(this.session, "deformnb.look", [view]); },
  },
  beforeUnmount() { this.session.unsubscribe(this.subscription)?.catch?.(() => {}); },
};

window.deformnb_app = { install(app) { app.component("deformnb-remote", AppRemote); } };
