/** What the page says as JSON: its materials' names and errors, constants of the package, the head of a model file. */
export const meta = JSON.parse(document.getElementById("meta").textContent);
