// Bundles the pages of the report into grasp3d/batch/report/static: npm ci && npm run build.
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const target = process.argv[2] ?? join(here, "../grasp3d/batch/report/static");
const LICENCES = ["LICENSE", "LICENSE.md", "LICENCE"];

/** SHA-256 over name and text of all sources; tests/batch/test_report.py computes the same. */
function sourcesHash() {
  const listed = readdirSync(join(here, "src"), { recursive: true, withFileTypes: true })
    .filter((entry) => entry.isFile())
    .map((entry) => join(entry.parentPath, entry.name).slice(here.length + 1).replaceAll("\\", "/"));
  const names = [...listed, "build.mjs", "package.json", "package-lock.json"].sort();
  const hash = createHash("sha256");
  for (const name of names) {
    const text = readFileSync(join(here, name), "utf8").replaceAll("\r\n", "\n");
    hash.update(`${name}\0${text}\0`);
  }
  return hash.digest("hex");
}

/** Licences of the packages in a bundle. */
function licences(inputs) {
  const packages = new Set();
  for (const input of Object.keys(inputs)) {
    const found = /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(input);
    if (found) packages.add(found[1]);
  }
  return [...packages].sort().map((name) => {
    const folder = join(here, "node_modules", name);
    const { version } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
    const file = readdirSync(folder).find((entry) => LICENCES.includes(entry));
    if (!file) throw new Error(`${name}: no licence found`);
    return `${name} ${version}\n\n${readFileSync(join(folder, file), "utf8").trim()}`;
  });
}

function banner(hash, licenceTexts) {
  const text = [`grasp3d, sources ${hash}`, ...licenceTexts].join("\n\n----\n\n");
  if (text.includes("*/")) throw new Error("a licence would end the comment");
  return `/*!\n${text}\n*/\n`;
}

async function bundle(entry, name, hash) {
  const result = await build({
    absWorkingDir: here,
    entryPoints: [{ in: entry, out: name }],
    outdir: target,
    bundle: true,
    minify: true,
    format: "iife",
    target: ["es2022"],
    charset: "utf8",
    legalComments: "inline",
    metafile: true,
    write: false,
  });
  const licenceTexts = licences(result.metafile.inputs);
  for (const file of result.outputFiles) {
    const text = banner(hash, licenceTexts) + file.text;
    if (/<\/script|<!--|<\/style/i.test(text)) throw new Error(`${name}: contains markup that would end its element`);
    writeFileSync(file.path, text);
  }
}

mkdirSync(target, { recursive: true });
const hash = sourcesHash();
await bundle("src/library/main.js", "library", hash);
await bundle("src/object/main.js", "viewer", hash);
for (const page of ["index.html", "object.html"]) {
  const text = readFileSync(join(here, "src", page), "utf8");
  writeFileSync(join(target, page), text.replace("<head>", `<head>\n<!-- sources ${hash} -->`));
}
