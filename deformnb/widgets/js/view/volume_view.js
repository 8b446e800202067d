// The volume view: pictures that Python draws.

import { opened } from "../ui/view_parts.js";
import { PicturesPage } from "./pictures.js";

/** @import { Model } from "../types.d.ts" */

/** @param {{model: Model, el: HTMLElement}} given */
function render({ model, el }) { return opened(new PicturesPage(model, el)); }

export default { render };
