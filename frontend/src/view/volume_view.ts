// The volume view: pictures that Python draws.

import type { Model } from "../types.ts";
import { opened } from "../ui/view_parts.ts";
import { ServerVolumeView } from "./server_view.ts";

function render({ model, el }: { model: Model; el: HTMLElement }) {
  return opened(new ServerVolumeView(model, el));
}

export default { render };
