// The page that Python exports: it opens the data in it. The scripts of the widgets run before this one and leave their
// exports under a symbol.

import type { PageData } from "./pages/standalone_page.ts";
import { decodeData, exportedWidgets, messageOf, StandalonePage, showAlert } from "./pages/standalone_page.ts";
import { showInLanguage } from "./ui/words.ts";

/** Wait until an element is scrolled into view, where the page is a frame of another one that may have several. */
async function waitUntilVisible(element: Element) {
  if (window.parent === window || typeof IntersectionObserver === "undefined") return;
  await new Promise<void>((resolve) => {
    const observer = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      resolve();
    });
    observer.observe(element);
  });
}

async function openStandalone() {
  await waitUntilVisible(document.body);
  const data = await decodeData<PageData>(JSON.parse(document.getElementById("dnb-data")?.textContent ?? ""));
  showInLanguage(document.body, data.words, data.language);
  const page = new StandalonePage(data, exportedWidgets());
  Object.assign(document.body, { deformnb: page }); // for tests and for debugging
  await page.open();
}

openStandalone().catch((error) => {
  console.error(error);
  const isOld = typeof DecompressionStream === "undefined";
  showAlert(
    isOld
      ? "This browser is too old to unpack the volume; a still picture is shown."
      : `This page could not be opened: ${messageOf(error)}`,
  );
});
