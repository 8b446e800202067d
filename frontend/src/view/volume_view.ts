// The volume view: pictures that Python draws.

import type { Model } from "../types.ts";
import { closerOf } from "../ui/view_parts.ts";
import { ServerVolumeView } from "./server_view.ts";

function render({ model, el }: { model: Model; el: HTMLElement }) {
  return closerOf(new ServerVolumeView(model, el));
}

export default { render };
