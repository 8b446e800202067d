// A page without Python in which a user opens a volume or a picture: it is read here, and shown by the same page as an
// exported volume. The data is written by deformnb/widgets/standalone.py.

import { FileOpener } from "./pages/file_opener.ts";
import type { Template } from "./pages/opened_file.ts";
import { decodeData, exportedWidgets, messageOf, runGuarded, showAlert } from "./pages/standalone_page.ts";
import { showInLanguage } from "./ui/words.ts";

async function openPage() {
  const template = await decodeData<Template>(JSON.parse(document.getElementById("dnb-data")?.textContent ?? ""));
  showInLanguage(document.body, template.words, template.language);
  Object.assign(document.body, { opener: new FileOpener(template, exportedWidgets()) }); // for tests and for debugging
}

openPage().catch((error) => {
  console.error(error);
  runGuarded(() => showAlert(`This page could not be opened: ${messageOf(error)}`));
});
