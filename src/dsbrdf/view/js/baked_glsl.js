// GLSL of one material with its numbers baked in, as dsbrdf.shader.baked writes it.

import { lobeNumbers, spikeNumbers } from "./pack.js";

/** Nine digits tell any two numbers of single precision apart; a float of GLSL has a point or an exponent. */
function number(value) {
  const text = String(Number(value.toPrecision(9)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

const vec3 = (values) => `vec3(${Array.from(values, number).join(", ")})`;
const array = (kind, name, entries) =>
  `const ${kind} DSBRDF_${name}[${entries.length}] = ${kind}[${entries.length}](\n    ${entries.join(",\n    ")});\n`;

/** GLSL source of a material of one channel or three; `shaders` as in sphere.js. */
export function bakedGlsl(material, shaders) {
  const slices = Array.from(material.thetaD, (_, slice) => slice);
  const lobes = slices.flatMap((slice) =>
    Array.from({ length: material.nLobes }, (_, k) => lobeNumbers(material, slice, k)),
  );
  const names = ["kappa", "gamma", "beta", "sampling"];
  return [
    `// ${material.name.replace(/\s+/g, " ")}\n`,
    `${shaders.constants}\n`,
    `const int DSBRDF_N_SLICES = ${slices.length};\nconst int DSBRDF_N_LOBES = ${material.nLobes};\n`,
    array("float", "THETA_D", Array.from(material.thetaD, number)),
    array(
      "vec3",
      "SPIKE",
      slices.map((slice) => vec3(spikeNumbers(material, slice))),
    ),
    ...names.map((name) =>
      array(
        "vec3",
        name.toUpperCase(),
        lobes.map((lobe) => vec3(lobe[name])),
      ),
    ),
    "int dsbrdf_n_slices() { return DSBRDF_N_SLICES; }\nint dsbrdf_n_lobes() { return DSBRDF_N_LOBES; }\n",
    "float dsbrdf_theta_d(int slice) { return DSBRDF_THETA_D[slice]; }\n",
    "vec3 dsbrdf_spike(int slice) { return DSBRDF_SPIKE[slice]; }\n",
    ...names.map(
      (name) =>
        `vec3 dsbrdf_${name}(int slice, int k) { return DSBRDF_${name.toUpperCase()}[slice * DSBRDF_N_LOBES + k]; }\n`,
    ),
    `\n${shaders.dsbrdf}`,
  ].join("");
}
