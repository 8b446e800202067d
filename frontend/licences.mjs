// Licences of the packages from npm whose files are in the bundles, as one text.

import { readdir, readFile } from "node:fs/promises";
import { dirname, extname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));

/** Files of a package's folder that hold its licence. */
const LICENCE_FILE = /^(licen[cs]e|copying)/i;

/** Files with the standard text of a licence, for packages that come without one; that of this project is one of them. */
const STANDARD = { "BSD-3-Clause": join(here, "..", "LICENSE") };

const COMMENT = /\/\*[\s\S]*?\*\/|(?:^[ \t]*\/\/.*\n?)+/gm;
const MARKS = [/^\s*\* ?/, /^\s*\| ?/, /^\s*\/\/ ?/];
const COPYRIGHT = /copyright\s*(?:\(c\)|©|[12]\d{3}).*/i;
const TERMS = /permission is hereby granted|redistribution and use/i;

const RULER = `\n\n${"-".repeat(80)}\n\n`;

/**
 * The licences of packages, one after another; packages with the same text have it once.
 *
 * @param {Map<string, Set<string>>} packages files in the bundles, by the folder of their package
 */
export async function licencesOf(packages) {
  const headings = new Map(); // of the packages that have a text
  for (const [folder, files] of [...packages].sort(([a], [b]) => (a < b ? -1 : 1))) {
    const { name, version, license } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
    const text = [...new Set([await ownText(folder, name, license), ...(await noticesIn(files))])].join("\n\n");
    headings.set(text, [...(headings.get(text) ?? []), `${name} ${version} (${license})`]);
  }
  return `${[...headings].map(([text, names]) => `${names.join("\n")}\n\n${text}`).join(RULER)}\n`;
}

/** The text that a package's folder has; else the standard text of its licence under the copyright lines of its sources. */
async function ownText(folder, name, license) {
  const names = (await readdir(folder)).filter((file) => LICENCE_FILE.test(file)).sort();
  const files = await Promise.all(names.map((file) => readFile(join(folder, file), "utf8")));
  if (files.length) return files.map((text) => tidy(text.split("\n"))).join("\n\n");
  if (!STANDARD[license])
    throw new Error(`${name} has no file of its licence, and ${license} has no text in licences.mjs`);
  const holders = new Set();
  for (const comment of await commentsIn(await sourcesOf(folder)))
    if (!TERMS.test(comment)) for (const line of linesOf(comment)) holders.add(COPYRIGHT.exec(line)?.[0]);
  holders.delete(undefined);
  if (!holders.size) throw new Error(`${name} has neither a file of its licence nor a line of copyright`);
  const [terms] = (await readFile(STANDARD[license], "utf8")).match(/^Redistribution[\s\S]*/m);
  const reason = `The package has no file of its licence: copyright lines of its sources, and the text of ${license}.`;
  return [reason, [...holders].sort().join("\n"), terms.trim()].join("\n\n");
}

/** Licences in comments of bundled files: code of others, which a package has taken over. */
async function noticesIn(files) {
  const comments = await commentsIn([...files].sort());
  const notices = comments.filter((comment) => TERMS.test(comment)).map((comment) => tidy(linesOf(comment)));
  return notices.filter((text) => COPYRIGHT.test(text));
}

async function commentsIn(files) {
  const texts = await Promise.all(files.map((file) => readFile(file, "utf8")));
  return texts.flatMap((text) => text.match(COMMENT) ?? []);
}

async function sourcesOf(folder) {
  const files = await readdir(folder, { recursive: true });
  const own = files.filter((file) => [".ts", ".js", ".css"].includes(extname(file)) && !file.includes("node_modules"));
  return own.map((file) => join(folder, file));
}

/** Lines of a comment without its marks, of which a list in it may have some too. */
function linesOf(comment) {
  const lines = comment.replace(/^\/\*[*!]?|\*\/\s*$/g, "").split("\n");
  const mark = MARKS.find((one) => lines.slice(1).every((line) => one.test(line) || !line.trim()));
  return lines.map((line) => (mark ? line.replace(mark, "") : line).replace(/-{8,}/, ""));
}

/** Lines as one text, without space at ends of lines. */
const tidy = (lines) =>
  lines
    .map((line) => line.trimEnd())
    .join("\n")
    .trim();
