// A field that finds a material by its name: typing narrows a list, arrow keys move in it, Enter takes.

import { indexOfMaterial, materials } from "./data.js";
import { html } from "./plot.js";

/** Names in the list at once; more come when its end is reached. */
const PAGE = 40;
const lower = materials.map(({ name }) => name.toLowerCase());

/** Materials whose names hold all words of a text; first those that begin with it, then those of which a word does. */
export function search(text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  if (!words.length) return [...materials.keys()];
  const groups = [[], [], []];
  lower.forEach((name, i) => {
    if (!words.every((word) => name.includes(word))) return;
    const at = name.indexOf(words[0]);
    groups[at === 0 ? 0 : /[\p{L}\p{N}]/u.test(name[at - 1]) ? 2 : 1].push(i);
  });
  return groups.flat();
}

/**
 * Make `input` such a field, with its list in an element after it. `current()` is the index it shows, or null;
 * `pick(index)` is called with another one, with -1 for `none`, the label of no material, if there is one.
 * Returns a function that shows what is current.
 */
export function searchField(input, { current, pick, none = null }) {
  const list = html("ul", { id: `${input.id}-list`, role: "listbox", className: "found", hidden: true });
  list.setAttribute("aria-label", "Materials found");
  input.after(list);
  Object.assign(input, { role: "combobox", autocomplete: "off", spellcheck: false });
  input.setAttribute("aria-controls", list.id);
  input.setAttribute("aria-autocomplete", "list");
  let found = [];
  let active = -1;
  let limit = PAGE;

  const show = () => {
    const index = current();
    input.value = materials[index]?.name ?? none ?? "";
  };
  const close = () => {
    list.hidden = true;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };
  const take = (index) => {
    close();
    if (index !== (current() ?? -1)) pick(index);
    show();
  };
  const fill = () => {
    const options = found.slice(0, limit).map((index, i) => {
      const option = html("li", { id: `${list.id}-${i}`, role: "option" }, index < 0 ? none : materials[index].name);
      option.setAttribute("aria-selected", i === active);
      option.addEventListener("pointerdown", (event) => event.preventDefault());
      option.addEventListener("click", () => take(index));
      return option;
    });
    if (!found.length) options.push(html("li", { role: "option", "aria-disabled": "true" }, "No material of this name"));
    list.replaceChildren(...options);
    list.hidden = false;
    input.setAttribute("aria-expanded", "true");
    if (active < 0) return input.removeAttribute("aria-activedescendant");
    input.setAttribute("aria-activedescendant", options[active].id);
    options[active].scrollIntoView({ block: "nearest" });
  };
  const open = (text) => {
    found = search(text);
    if (none !== null && !text) found = [-1, ...found];
    active = text ? Math.min(0, found.length - 1) : found.indexOf(current() ?? -1);
    limit = Math.max(PAGE, active + PAGE / 2);
    fill();
  };
  const move = (step) => {
    if (list.hidden) return open("");
    active = Math.min(Math.max(active + step, 0), found.length - 1);
    limit = Math.max(limit, active + PAGE / 2);
    fill();
  };

  const actions = {
    ArrowDown: () => move(1),
    ArrowUp: () => move(-1),
    Enter: () => (list.hidden ? open("") : found.length && take(found[Math.max(active, 0)])),
    Escape: () => (close(), show()),
  };
  input.addEventListener("keydown", (event) => {
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });
  input.addEventListener("focus", () => input.select());
  input.addEventListener("click", () => list.hidden && open(""));
  input.addEventListener("input", () => open(input.value.trim()));
  input.addEventListener("blur", () => {
    const exact = indexOfMaterial(input.value.trim());
    if (!list.hidden && exact >= 0) take(exact);
    else [close(), show()];
  });
  list.addEventListener("scroll", () => {
    if (limit >= found.length || list.scrollTop + list.clientHeight < list.scrollHeight - 40) return;
    limit += PAGE;
    const top = list.scrollTop;
    fill();
    list.scrollTop = top;
  });
  close();
  show();
  return show;
}
