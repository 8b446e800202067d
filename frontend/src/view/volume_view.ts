// The volume view: pictures that Python draws.

import { opened } from "../ui/view_parts.js";
import { ServerVolumeView } from "./server_view.js";

/** @import { Model } from "../types.d.ts" */

/** @param {{model: Model, el: HTMLElement}} given */
function render({ model, el }) { return opened(new ServerVolumeView(model, el)); }

export default { render };
