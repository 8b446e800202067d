// The volume view: pictures that Python draws.

import { opened } from "../ui/view_parts.js";
import { ServerViewPage } from "./server_view.js";

/** @import { Model } from "../types.d.ts" */

/** @param {{model: Model, el: HTMLElement}} given */
function render({ model, el }) { return opened(new ServerViewPage(model, el)); }

export default { render };
