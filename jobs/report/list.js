// The list: filters, order and pages, all of them in the address, so that a view can be linked; and the pages by tab.
const PAGE = 50;
const PICKERS = ["task", "category", "scene", "order"];
const MARKS = ["right", "wrong", "better", "worse", "failed", "unparsed", "skipped"];
const TABS = [...document.querySelectorAll("main > section[id]")].map((section) => section.id);
let data = null;
let matching = [];
let place = 0;
let lastList = "#questions";

const rowOf = (line) => {
  const [id, question, answer, reference, scene, task, category, bits, scores, drawn] = line;
  return { id, question, answer, reference, scene: data.scenes[scene], task: data.tasks[task], category: data.categories[category],
    labels: data.labels.filter((_, bit) => bits & (1 << bit)).map(([label]) => label), scores, drawn,
    words: `${id} ${question} ${answer} ${reference}`.toLowerCase() };
};

const first = (scores) => scores.find((score) => score !== null) ?? null;
const final = (scores) => scores.at(-1) ?? null;
const change = (row) => (first(row.scores) === null || final(row.scores) === null ? 0 : final(row.scores) - first(row.scores));
const ORDERS = {
  plan: null,
  low: (a, b) => (final(a.scores) ?? 101) - (final(b.scores) ?? 101),
  gain: (a, b) => change(b) - change(a),
  loss: (a, b) => change(a) - change(b),
  drawn: (a, b) => b.drawn - a.drawn,
};

const option = (value, text) => make("option", { value }, text);
const TASK_TEXT = (name) => TASKS[name] ?? name;

const readAddress = () => {
  const [path, query = ""] = location.hash.replace(/^#/, "").split("?");
  return { path, query: new URLSearchParams(query) };
};

const writeAddress = (changes) => {
  const { query } = readAddress();
  for (const [name, value] of Object.entries(changes)) {
    if (value) query.set(name, value);
    else query.delete(name);
  }
  const text = query.toString();
  history.replaceState(null, "", `#questions${text ? `?${text}` : ""}`);
  showList();
};

const scoreTrail = (row) => row.scores.map((score) => (score === null ? "–" : score.toFixed(0))).join(" → ");

const listRow = (row) =>
  make("li", {},
    make("a", { class: "row", href: `#q=${encodeURIComponent(row.id)}` },
      make("span", { class: `mark ${row.labels.find((label) => MARKS.includes(label)) ?? "unscored"}`, "aria-hidden": "true" }),
      make("span", { class: "words" }, row.question),
      make("span", { class: "said" }, row.answer, row.reference && make("span", { class: "where" }, ` · truth: ${row.reference}`)),
      make("span", { class: "where" }, [TASK_TEXT(row.task), row.category, row.scene].filter(Boolean).join(" · ")),
      make("span", { class: "tail" }, ...chips(row.labels), make("span", { class: "trail" }, scoreTrail(row)))));

const scenesOf = (scenery) => {
  const maps = new Map(scenery.maps);
  const problems = new Map(scenery.problems);
  return (scene) => ({ map: maps.get(scene), problem: problems.get(scene), note: scenery.note });
};

const showList = () => {
  const { query } = readAddress();
  const wanted = Object.fromEntries([...PICKERS, "label"].map((name) => [name, query.get(name) ?? ""]));
  const text = (query.get("find") ?? "").toLowerCase();
  for (const name of PICKERS) byId(name).value = wanted[name];
  if (byId("find") !== document.activeElement) byId("find").value = query.get("find") ?? "";
  for (const button of byId("labels").children) {
    button.setAttribute("aria-pressed", String(button.value === wanted.label));
    if (button.value === wanted.label) byId("labels").scrollLeft = button.offsetLeft - byId("labels").offsetLeft - 40;
  }
  matching = data.rows.filter((row) =>
    (!wanted.label || row.labels.includes(wanted.label)) && (!wanted.task || row.task === wanted.task) &&
    (!wanted.category || row.category === wanted.category) && (!wanted.scene || row.scene === wanted.scene) && (!text || row.words.includes(text)));
  const order = ORDERS[wanted.order] ?? null;
  if (order) matching.sort(order);
  const pages = Math.max(1, Math.ceil(matching.length / PAGE));
  const page = Math.min(pages, Math.max(1, Number(query.get("page")) || 1));
  const start = (page - 1) * PAGE;
  byId("rows").replaceChildren(...matching.slice(start, start + PAGE).map(listRow));
  const to = Math.min(matching.length, start + PAGE);
  byId("count").textContent = `${matching.length ? `${whole(start + 1)} to ${whole(to)} of ` : ""}${plural(matching.length, "question")}${matching.length === data.rows.length ? "" : `, ${whole(data.rows.length)} in all`}`;
  byId("earlier").disabled = page === 1;
  byId("later").disabled = page === pages;
  byId("page").textContent = `page ${page} of ${pages}`;
  byId("earlier").onclick = () => turn(page - 1);
  byId("later").onclick = () => turn(page + 1);
  lastList = location.hash.startsWith("#questions") ? location.hash : lastList;
};
const turn = (page) => {
  writeAddress({ page: page > 1 ? page : "" });
  byId("filters").scrollIntoView();
};

const prepareList = () => {
  const counts = new Map();
  for (const row of data.rows) for (const label of row.labels) counts.set(label, (counts.get(label) ?? 0) + 1);
  const buttons = [["", "All", data.rows.length], ...data.labels.map(([label, name]) => [label, name, counts.get(label) ?? 0])];
  byId("labels").append(...buttons.filter(([label, , count]) => count || !label).map(([value, name, count]) =>
    make("button", { type: "button", value, "aria-pressed": "false", onclick: () => writeAddress({ label: value, page: "" }) }, name, make("small", {}, whole(count)))));
  const values = { task: data.tasks, category: data.categories, scene: data.scenes };
  for (const [name, all] of Object.entries(values)) {
    byId(name).append(...all.filter(Boolean).map((value) => option(value, name === "task" ? TASK_TEXT(value) : value)));
    byId(name).closest("label").hidden = all.length < 2;
  }
  for (const name of PICKERS) byId(name).addEventListener("change", () => writeAddress({ [name]: byId(name).value, page: "" }));
  let waiting = 0;
  byId("find").addEventListener("input", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => writeAddress({ find: byId("find").value.trim(), page: "" }), 120);
  });
  byId("filters").addEventListener("submit", (event) => event.preventDefault());
};

const openQuestion = async (id) => {
  const row = data.rows.findIndex((one) => one.id === id);
  if (!matching.some((one) => one.id === id)) matching = data.rows;
  place = matching.findIndex((one) => one.id === id);
  const box = byId("question");
  if (row < 0) return box.replaceChildren(make("p", { class: "notice" }, `There is no question ${id} in the list.`));
  const { records, lines } = await load(`q${Math.floor(row / data.shard)}`);
  if (decodeURIComponent(readAddress().path.slice(2)) !== id) return undefined; // somebody went on meanwhile
  const link = (to, name, text) => make(to ? "a" : "span", { class: "button", href: to ? `#q=${encodeURIComponent(to.id)}` : null, "aria-disabled": to ? null : "true", rel: name }, text);
  const one = data.rows[row];
  box.replaceChildren(
    make("nav", { class: "steps", "aria-label": "Questions" },
      make("a", { class: "button", href: lastList }, "‹ List"),
      make("span", { class: "where" }, `${whole(place + 1)} of ${whole(matching.length)}`),
      link(matching[place - 1], "prev", "‹ Previous"), link(matching[place + 1], "next", "Next ›")),
    make("h2", { tabindex: "-1" }, one.question),
    make("p", { class: "where" }, [TASK_TEXT(one.task), one.category, one.scene, one.id].filter(Boolean).join(" · ")),
    make("p", { class: "chips" }, ...chips(one.labels)),
    ...detail(records[row % data.shard], data, lines));
  document.title = `${one.question.slice(0, 60)} · ${document.body.dataset.name}`;
  scrollTo(0, 0);
  return box.querySelector("h2").focus({ preventScroll: true });
};

const show = () => {
  const { path } = readAddress();
  const asked = path.startsWith("q=") ? "question" : TABS.includes(path) ? path : TABS[0];
  for (const id of TABS) byId(id).hidden = id !== asked;
  document.documentElement.dataset.tab = asked;
  for (const link of document.querySelectorAll("#tabs a")) {
    const current = link.hash === `#${asked === "question" ? "questions" : asked}`;
    if (current) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
    if (current) byId("tabs").scrollLeft = link.offsetLeft - 60;
  }
  document.title = document.body.dataset.name;
  const listed = asked === "question" || asked === "questions";
  document.documentElement.classList.toggle("waits", listed && !data);
  if (!listed) return;
  load("list").then((found) => {
    if (!data) {
      data = found;
      data.rows = data.rows.map(rowOf);
      prepare(data);
      prepareList();
    }
    if (asked === "questions") return showList();
    return openQuestion(decodeURIComponent(path.slice(2)));
  }).catch((error) => {
    byId(asked === "question" ? "question" : "count").replaceChildren(make("p", { class: "notice" }, error.message));
  }).finally(() => document.documentElement.classList.remove("waits"));
};

const keys = (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("large").open) return;
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (typing) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  const open = !byId("question").hidden;
  const go = (step) => open && matching[place + step] && (location.hash = `#q=${encodeURIComponent(matching[place + step].id)}`);
  if (event.key === "/") {
    event.preventDefault();
    if (open || byId("questions").hidden) location.hash = lastList;
    setTimeout(() => byId("find").focus());
  } else if (event.key === "j" || event.key === "ArrowRight") go(1);
  else if (event.key === "k" || event.key === "ArrowLeft") go(-1);
  else if (event.key === "Escape" && open) location.hash = lastList;
  else if (event.key === "o" && open) showOverlays(document.body.classList.contains("bare"));
};

const start = () => {
  themeButton();
  document.documentElement.classList.add("ready");
  addEventListener("hashchange", show);
  addEventListener("keydown", keys);
  byId("large").addEventListener("click", (event) => event.target === byId("large") && byId("large").close());
  show();
};
