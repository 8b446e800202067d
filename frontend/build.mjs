// Bundles the widgets: one module and one style sheet for each, written to deformnb/widgets/static, and the licences of
// what comes from npm, which a wheel also has among its own licences.
//
//   node frontend/build.mjs            as it is shipped
//   node frontend/build.mjs --debug    with white space and source maps inside, for a browser's debugger

import { writeFile } from "node:fs/promises";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";
import { licencesOf } from "./licences.mjs";

const here = dirname(fileURLToPath(import.meta.url)),
  source = join(here, "src");
const outdir = join(here, "..", "deformnb", "widgets", "static");
const isDebug = process.argv.includes("--debug");

/** Parts of the style sheet of each widget. */
const EVERYWHERE = ["ui/disconnected.css", "ui/vs_code.css", "ui/fingers.css"];

const VIEW = [
  "view/live_view.css",
  "ui/messages.css",
  "ui/saved_picture.css",
  "ui/compare.css",
  "view/volume_view.css",
  "ui/theme.css",
  "editor/editor.css",
  "view/space_points.css",
];

// Of each bundle: its module, if it has one, and its style sheets in the order in which they apply.
const WIDGETS = {
  editor: [
    "editor/editor.ts",
    "ui/theme.css",
    "ui/compare.css",
    "ui/messages.css",
    "editor/editor.css",
    "editor/tools.css",
    "editor/grid_nodes.css",
  ],
  space_editor: [
    "space_editor/editor.ts",
    "ui/theme.css",
    "ui/messages.css",
    "editor/editor.css",
    "editor/tools.css",
    "space_editor/editor.css",
  ],
  live_view: ["view/live_view.ts", ...VIEW],
  volume_view: ["view/volume_view.ts", ...VIEW],
  curve_editor: ["inputs/curve_editor.ts", "ui/theme.css", "inputs/curve_editor.css"],
  transfer_editor: [
    "inputs/transfer_editor.ts",
    "ui/theme.css",
    "inputs/curve_editor.css",
    "inputs/transfer_editor.css",
  ],
  preset_menu: ["inputs/preset_menu.ts", "inputs/preset_menu.css"],
  depth_keys: ["inputs/depth_keys.ts", "ui/theme.css", "inputs/curve_editor.css"],
  player: ["inputs/player.ts", "ui/theme.css", "inputs/curve_editor.css", "inputs/player.css"],
  grid_drawing: ["inputs/grid_drawing.ts", "ui/theme.css", "inputs/curve_editor.css", "inputs/grid_drawing.css"],
  points_table: ["inputs/points_table.ts", "ui/theme.css", "inputs/points_table.css"],
  item_list: ["inputs/item_list.ts", "ui/theme.css", "inputs/item_list.css"],
  clip_controls: ["inputs/clip_controls.ts", "inputs/clip_sliders.css"],
  file_transfer: ["inputs/file_transfer.ts", "inputs/file_transfer.css"],
  file_input: ["inputs/file_input.ts", "inputs/file_input.css"],
  restore_bar: ["inputs/restore_bar.ts", "inputs/restore_bar.css"],
  boxes: ["studio/boxes.ts", "studio/boxes.css"],
  studio_head: ["studio/head.ts", "studio/studio.css", "ui/saved_picture.css"],
};

// Scripts of pages without Jupyter, which nothing imports.
const PAGES = {
  app: ["app/app.ts", "app/app.css"],
  access: ["app/access.ts"],
  start: ["app/start.ts"],
  remote: [
    "app/remote.ts",
    "view/live_view.css",
    "ui/saved_picture.css",
    "ui/compare.css",
    "view/volume_view.css",
    "app/remote.css",
  ],
  standalone: ["standalone.ts", "inputs/clip_sliders.css", "standalone.css"],
  file_page: ["file_page.ts", "inputs/clip_sliders.css", "standalone.css", "pages/grid_pair.css", "file_page.css"],
  thompson: ["thompson.ts", "standalone.css", "pages/grid_pair.css", "thompson.css"],
};

const options = {
  absWorkingDir: source,
  bundle: true,
  metafile: true,
  charset: "ascii", // a browser holds a text with one letter beyond Latin-1 in two bytes a letter
  target: "es2022",
  loader: { ".glsl": "text", ".svg": "dataurl", ".png": "dataurl" },
  logLevel: "warning",
  legalComments: "none",
  ...(isDebug ? { sourcemap: "inline" } : { minifySyntax: true, minifyWhitespace: true }),
};

/** Files from npm in the bundles, by the folder of their package. */
const packages = new Map();

/** Bundles the files of one name; of a module nothing but its default export is left, with its words in a language. */
async function bundled(name, paths, format) {
  for (const loader of ["ts", "css"]) {
    const own = [...paths, ...(format === "esm" ? EVERYWHERE : [])].filter((path) => path.endsWith(`.${loader}`)),
      [first] = own;
    if (!first) continue;
    const contents =
      loader === "css"
        ? own.map((path) => `@import "./${path}";`).join("\n")
        : format === "esm"
          ? `import { translateWidget } from "./ui/words.ts"; import widget from "./${first}"; export default translateWidget(widget);`
          : `import "./${first}";`;
    const stdin = { contents, resolveDir: source, loader };
    const { metafile } = await build({
      ...options,
      format,
      outfile: join(outdir, `${name}.${loader === "ts" ? "js" : "css"}`),
      stdin,
    });
    for (const input of Object.keys(metafile.inputs)) {
      const isDisabled = input.startsWith("(disabled):"); // a file of a package that leaves it out in browsers
      const file = resolve(source, isDisabled ? input.slice("(disabled):".length) : input);
      const [folder] = file.match(/.*[\\/]node_modules[\\/](@[^\\/]+[\\/])?[^\\/]+/) ?? [];
      if (!folder) continue;
      if (!packages.has(folder)) packages.set(folder, new Set());
      if (!isDisabled) packages.get(folder).add(file);
    }
  }
}

await Promise.all([
  build({
    ...options,
    format: "esm",
    entryPoints: ["module_loader.ts"],
    outfile: join(outdir, "module_loader.js"),
  }),
  ...Object.entries(WIDGETS).map(([name, paths]) => bundled(name, paths, "esm")),
  ...Object.entries(PAGES).map(([name, paths]) => bundled(name, paths, "iife")),
]);
const licences = await licencesOf(packages);
for (const file of [join(outdir, "licences.txt"), join(here, "licences.txt")]) await writeFile(file, licences);
