// GLSL of one material with its numbers baked in, as dsbrdf.shader.baked writes it.

import { packParameters } from "./pack.js";

/** Nine digits tell any two numbers of single precision apart; a float of GLSL has a point or an exponent. */
function number(value) {
  const text = String(Number(value.toPrecision(9)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** A name in a comment of one line: what does not print goes, and what would continue the line. */
const comment = (name) =>
  name
    .replace(/[\p{C}\p{Z}\s]+/gu, " ")
    .slice(0, 200)
    .replace(/[\\/ ]+$/, "");

/** GLSL source of a material; `shaders` as in sphere.js. */
export function bakedGlsl(material, shaders) {
  const { width, data } = packParameters(material);
  const texels = Array.from(
    { length: width },
    (_, i) => `vec4(${Array.from(data.subarray(4 * i, 4 * i + 4), number).join(", ")})`,
  );
  return [
    `// ${comment(material.name)}`,
    shaders.constants,
    `const vec4 DSBRDF_TEXELS[${width}] = vec4[${width}](\n    ${texels.join(",\n    ")});`,
    "vec4 dsbrdf_texel(int i) { return DSBRDF_TEXELS[i]; }",
    shaders.dsbrdf,
  ].join("\n");
}
