// What spoke for the number of lobes, where the model carries it.

import { formatNumber, linearScale, niceTicks, Plot } from "./plot.js";
import { baseModel, subscribe } from "./state.js";

const CRITERIA = {
  williams: "Mean ln of the divergence (nats)",
  bic: "BIC",
  "held-out": "Relative RMS on held-out φ_d",
};
const holder = document.getElementById("selection-plot");

export function startSelection() {
  subscribe(drawSelection);
}

function drawSelection() {
  const { fit, nLobes, name } = baseModel();
  const selection = fit?.selection;
  document.getElementById("selection-section").hidden = !selection;
  if (!selection) return;
  const counts = selection.values.map((_, i) => i + 1);
  const [low, high] = [Math.min(...selection.values), Math.max(...selection.values)];
  const room = 0.08 * (high - low || 1);
  const plot = new Plot(holder, {
    x: linearScale(0.7, counts.length + 0.3, counts, String),
    y: linearScale(low - room, high + room, niceTicks(low, high)),
    xTitle: "Lobes",
    yTitle: CRITERIA[selection.criterion],
    label: `${name}: ${selection.criterion} for 1 to ${counts.length} lobes: ${selection.values.map((value) => formatNumber(value)).join(", ")}; ${nLobes} chosen`,
    margin: { left: 44, bottom: 38 },
  });
  plot.line(counts, selection.values, { class: "fitted", stroke: "var(--muted)" });
  plot.points(counts, selection.values, { marker: "circle", size: 3, fill: "var(--muted)" });
  plot.points([nLobes], [selection.values[nLobes - 1]], { marker: "circle", size: 6, fill: "var(--accent)" });
}
