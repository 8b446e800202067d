// The page about D'Arcy Thompson's grids. The data is written by deformnb/widgets/file_pages.py.

import { includedState } from "./pages/page_copy.ts"; // first: it keeps the text of the page as it was loaded
import { decodeData, exportedWidgets, messageOf, pagePart, runGuarded, showAlert } from "./pages/standalone_page.ts";
import { ThompsonPage, type ThompsonTemplate } from "./pages/thompson_page.ts";
import { readState } from "./pages/thompson_state.ts";
import { buttonElement, named, setText } from "./ui/dom.ts";
import { localize, showInLanguage } from "./ui/words.ts";

/** The language of the address, else that of the page. */
function languageOf({ language, tables }: ThompsonTemplate) {
  const wanted = new URLSearchParams(location.hash.slice(1)).get("language");
  return wanted && tables[wanted] ? wanted : language;
}

/** A button for each other language, which opens the page in it. */
function offerLanguages(language: string, languages: ThompsonTemplate["languages"]) {
  const header = pagePart("header");
  for (const [code, name] of Object.entries(languages)) {
    if (code === language) continue;
    buttonElement(
      "dnb-page-button dnb-th-language",
      header,
      code.toUpperCase(),
      () => {
        location.hash = `language=${code}`;
        location.reload();
      },
      { lang: code, translate: "no", ...named(name) },
    );
  }
}

async function openPage() {
  const template = await decodeData<ThompsonTemplate>(
      JSON.parse(document.getElementById("dnb-data")?.textContent ?? ""),
    ),
    language = languageOf(template),
    { title, facts } = template;
  showInLanguage(document.body, template.tables[language]!, language);
  document.documentElement.lang = language;
  document.title = localize(title);
  setText(pagePart("header").querySelector("h1")!, localize(title));
  setText(pagePart("footer"), localize(facts));
  offerLanguages(language, template.languages);
  const root = document.querySelector<HTMLElement>(".dnb-th")!,
    page = new ThompsonPage(template, exportedWidgets(), root, readState(template.examples.pairs.length));
  Object.assign(document.body, { deformnb: page, isCopy: includedState() !== null }); // for tests and for debugging
  await page.show();
}

openPage().catch((error) => {
  console.error(error);
  runGuarded(() => showAlert(`This page could not be opened: ${messageOf(error)}`));
});
