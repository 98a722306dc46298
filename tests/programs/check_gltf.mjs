// Opens glTF files as programs do: the Khronos validator finds nothing, and three's loader finds one mesh of one material.
//
//     node check_gltf.mjs FILE...      where npm has installed gltf-validator and three

import fs from "node:fs";
import { createRequire } from "node:module";

// What three expects of a browser
globalThis.self = globalThis;
globalThis.ProgressEvent = class {
  constructor(type, values) {
    Object.assign(this, { type }, values);
  }
};

const require = createRequire(`${process.cwd()}/`);
const validator = require("gltf-validator");
const { GLTFLoader } = await import(`${process.cwd()}/node_modules/three/examples/jsm/loaders/GLTFLoader.js`);

let failed = process.argv.length < 3;
for (const file of process.argv.slice(2)) {
  const bytes = new Uint8Array(fs.readFileSync(file));
  const { issues } = await validator.validateBytes(bytes);
  const text = new TextDecoder().decode(bytes);
  const opened = await new GLTFLoader().parseAsync(file.endsWith(".glb") ? bytes.buffer : text, "");
  const materials = [];
  let lights = 0;
  opened.scene.traverse((node) => {
    if (node.isMesh) materials.push(node.material);
    lights += node.isLight ? 1 : 0;
  });
  const [material] = materials;
  const good =
    issues.numErrors + issues.numWarnings + issues.numInfos + issues.numHints === 0 &&
    materials.length === 1 &&
    opened.cameras.length === 1 &&
    lights === 3;
  failed ||= !good;
  console.log(`${good ? "ok" : "FAILED"} ${file}: ${material?.type} ${material?.color.toArray()}`);
  if (!good) console.log(JSON.stringify(issues.messages), materials.length, opened.cameras.length, lights);
}
process.exit(failed ? 1 : 0);
