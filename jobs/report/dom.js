// Elements, numbers, data and theme. Text is only ever set as text, never as markup.
const byId = (id) => document.getElementById(id);

const fill = (element, options, children) => {
  for (const [name, value] of Object.entries(options)) {
    if (name === "onclick") element.addEventListener("click", value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) element.append(child);
  }
  return element;
};
const make = (tag, options = {}, ...children) => fill(document.createElement(tag), options, children);
const draw = (tag, options = {}, ...children) =>
  fill(document.createElementNS("http://www.w3.org/2000/svg", tag), options, children);

const percent = (share) => (share === null || share === undefined ? "–" : `${(100 * share).toFixed(1)}\u00a0%`);
const orDash = (value) => (value === null || value === undefined || value === "" ? "–" : String(value));
const whole = (value) => (value === null || value === undefined ? "–" : value.toLocaleString("en"));
const seconds = (value) =>
  value === null || value === undefined ? "–" : value < 1 ? `${(1000 * value).toFixed(value < 0.01 ? 1 : 0)} ms` : `${value.toFixed(value < 10 ? 2 : 0)} s`;
const plural = (count, word) => `${whole(count)} ${word}${count === 1 ? "" : "s"}`;

// A page on disk may load scripts beside it and read no other file: each script hands over one text of JSON.
const KEPT = 24;
const loaded = new Map();
const receivers = new Map();
globalThis.splat = (name, text) => receivers.get(name)?.(JSON.parse(text));
const load = (name) => {
  if (loaded.has(name)) return loaded.get(name);
  const folder = document.body.dataset.folder;
  const promise = new Promise((resolve, reject) => {
    receivers.set(name, resolve);
    const script = make("script", { src: `${folder}/${name}.js` });
    script.addEventListener("error", () => {
      loaded.delete(name);
      reject(new Error(`${folder}/${name}.js cannot be read. The folder ${folder} belongs to this page: keep both together.`));
    });
    script.addEventListener("load", () => script.remove());
    document.head.append(script);
  });
  loaded.set(name, promise);
  if (loaded.size > KEPT) {
    const oldest = [...loaded.keys()].find((key) => key !== "list" && key !== name);
    loaded.delete(oldest);
    receivers.delete(oldest);
  }
  return promise;
};

const themeButton = () => {
  const root = document.documentElement;
  const names = { "": "Theme: system", light: "Theme: light", dark: "Theme: dark" };
  const show = (theme) => {
    if (theme) root.dataset.theme = theme;
    else delete root.dataset.theme;
    byId("theme").textContent = names[theme];
  };
  const remembered = () => {
    try {
      return localStorage.getItem("theme") ?? "";
    } catch {
      return ""; // storage may be forbidden to pages on disk
    }
  };
  let theme = remembered() in names ? remembered() : "";
  show(theme);
  byId("theme").hidden = false;
  byId("theme").addEventListener("click", () => {
    const order = Object.keys(names);
    theme = order[(order.indexOf(theme) + 1) % order.length];
    show(theme);
    try {
      localStorage.setItem("theme", theme);
    } catch {
      // then it holds for this visit
    }
  });
};
