// The volume view: pictures that Python draws. Joined behind the files that deformnb/widgets/view/volume_view.py names.

import { opened } from "../ui/view_parts.js";
import { PicturesPage } from "./pictures.js";

function render({ model, el }) { return opened(new PicturesPage(model, el)); }

export default { render };
