// Copying the parameters, and downloads: the edited model in the format of dsbrdf.model.file, and its GLSL.

import { isEdited, SHARED, withLobes } from "./material.js";
import { meta } from "./meta.js";
import { baseModel, currentModel, state } from "./state.js";

/** Single precision, in the fewest digits that tell it. */
const plain = (value) => Number(value.toPrecision(9));

function nested(values, ...shape) {
  if (!shape.length) return Array.from(values, plain);
  const width = values.length / shape[0];
  return Array.from({ length: shape[0] }, (_, i) =>
    nested(values.subarray(i * width, (i + 1) * width), ...shape.slice(1)),
  );
}

/** The model on show without the lobes that are off, and a name that tells whether it was changed. */
function shownModel() {
  const base = baseModel();
  const kept = state.edits.flatMap(({ on }, k) => (on ? [k] : []));
  const edited = isEdited(state.edits);
  return { ...withLobes(currentModel(), kept), name: edited ? `${base.name} edited` : base.name, edited };
}

/** The model on show as the content of a model file. */
export function modelFile() {
  const { source, fit, errors } = baseModel();
  const model = shownModel();
  const { nChannels, nLobes, channels } = model;
  const lobes = Object.fromEntries(SHARED.map((key) => [key, nested(model[key], nLobes)]));
  lobes.colour = nested(model.colour, nChannels, nLobes);
  return {
    ...meta.file,
    name: model.name,
    channels,
    lobes,
    source: source ?? {},
    fit: fit ?? {},
    errors: model.edited ? {} : (errors ?? {}),
  };
}

const hasLobe = () => state.edits.some(({ on }) => on);

function offer(text, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** A name for a file, of letters, digits and _.- alone: the browser keeps it in its folder of downloads. */
const fileStem = () =>
  shownModel()
    .name.replace(/[^\p{L}\p{N}_.-]+/gu, "-")
    .replace(/^[.-]+|[.-]+$/g, "")
    .slice(0, 60)
    .replace(/^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)/i, "$1-") || "unnamed";

function tell(text) {
  document.getElementById("downloads-note").textContent = text;
}

async function copyParameters() {
  await navigator.clipboard.writeText(JSON.stringify(modelFile(), null, 1));
  tell("Copied.");
}

export function startDownloads(glsl) {
  const actions = {
    copy: copyParameters,
    "download-model": () =>
      offer(`${JSON.stringify(modelFile(), null, 1)}\n`, `${fileStem()}.json`, "application/json"),
    "download-glsl": () => offer(glsl(shownModel()), `${fileStem()}.glsl`, "text/plain"),
  };
  for (const [id, action] of Object.entries(actions)) {
    document.getElementById(id).addEventListener("click", async () => {
      if (!hasLobe()) return tell("All lobes are off: switch one on first.");
      tell("");
      try {
        await action();
      } catch (error) {
        tell(`That did not work: ${error.message}`);
      }
    });
  }
}
