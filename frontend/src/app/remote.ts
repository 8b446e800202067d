// Captions and an orientation cube over pictures of trame's remote controlled area. Python receives an
// acknowledgement of each picture that was received, and sends no more than that.

import { Camera } from "../maths/camera.ts";
import { OrientationCube } from "../ui/orientation_cube.ts";
import { captionsOf, Frames, type Shows, type ViewName } from "../ui/view_parts.ts";
import type { ViewDirection } from "../view/types.ts";
import { APP_PAGE, callPython } from "./session.ts";
import type { Component, Session } from "./types.ts";

const REMOTE_TOPIC = "trame.rca.topic.stream";

/** A message of trame's */
export interface RemotePicture {
  name: string;
  meta?: { n: number; camera: ViewDirection; shows: Shows; layer: number };
}

export interface Remote {
  area: string;
  /** By the name of a side */
  views: Record<ViewName, ViewDirection>;
  $refs: { root: HTMLElement };
  session: Session;
  subscription: object;
  frames: Frames;
  cube: OrientationCube;
  receive: (picture: RemotePicture) => void;
  look: (view: ViewName) => void;
}

const AppRemote: Component<Remote> = {
  props: { area: String, views: Object },
  inject: ["trame"],
  template: '<div ref="root" class="dnb-view dnb-app-over" data-background="dark"></div>',
  mounted() {
    window.deformnb_start?.close();
    const { root } = this.$refs;
    this.session = this.trame.client.getConnection().getSession();
    this.frames = new Frames(root);
    this.cube = new OrientationCube(
      root,
      (side) => this.look(side),
      () => this.look("home"),
    );
    this.subscription = this.session.subscribe<RemotePicture>(REMOTE_TOPIC, ([picture]) => this.receive(picture));
  },
  methods: {
    receive({ name, meta }: RemotePicture) {
      if (name !== this.area || !meta?.n) return;
      const camera = new Camera();
      camera.look(meta.camera.direction, meta.camera.up);
      this.frames.show(captionsOf(meta.shows, meta.layer));
      this.frames.write(camera);
      this.cube.draw(this.views, camera);
      Object.assign(this.$refs.root, { deformnb: meta }); // for tests and for debugging
      callPython(this.session, "deformnb.seen", [this.area, meta.n, APP_PAGE]);
    },
    look(view: ViewName) {
      callPython(this.session, "deformnb.look", [view]);
    },
  },
  beforeUnmount() {
    this.session.unsubscribe(this.subscription)?.catch?.(() => {});
  },
};

window.deformnb_app = {
  install(app) {
    app.component("deformnb-remote", AppRemote);
  },
};
