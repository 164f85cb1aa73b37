// Makes viewer.js, the script of a page of results, from main.js and the packages of the lock file:
//     npm ci && npm run build
// Its first line is a digest of these sources, by which tests see that it belongs to them.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const sources = ["build.js", "main.js", "plot.js", "package.json", "package-lock.json"];
const digest = createHash("sha256");
for (const name of sources) digest.update(readFileSync(name));
const license = readFileSync("node_modules/three/LICENSE", "utf8").trim();

await build({
  entryPoints: ["main.js"],
  outfile: "viewer.js",
  bundle: true,
  minify: true,
  charset: "ascii",
  format: "iife",
  target: "es2022",
  legalComments: "none", // the whole license stands at the top
  banner: { js: `// ${digest.digest("hex")}\n/* Contains three.js (three).\n\n${license}\n*/` },
});
