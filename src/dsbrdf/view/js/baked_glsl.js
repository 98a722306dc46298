// GLSL of one material with its numbers baked in, as dsbrdf.shader.baked writes it.

import { packParameters } from "./pack.js";

/** Nine digits tell any two numbers of single precision apart; a float of GLSL has a point or an exponent. */
function number(value) {
  const text = String(Number(value.toPrecision(9)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** GLSL source of a material; `shaders` as in sphere.js. */
export function bakedGlsl(material, shaders) {
  const { width, height, data } = packParameters(material);
  const n = width * height;
  const texels = Array.from(
    { length: n },
    (_, i) => `vec4(${Array.from(data.subarray(4 * i, 4 * i + 4), number).join(", ")})`,
  );
  return [
    `// ${material.name.replace(/\s+/g, " ")}`,
    shaders.constants,
    `const vec4 DSBRDF_TEXELS[${n}] = vec4[${n}](\n    ${texels.join(",\n    ")});`,
    `int dsbrdf_n_lobes() { return ${height - 1}; }`,
    `vec4 dsbrdf_texel(int row, int column) { return DSBRDF_TEXELS[row * ${width} + column]; }`,
    `\n${shaders.dsbrdf}`,
  ].join("\n");
}
