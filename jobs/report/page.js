"use strict";
// Shows the questions embedded in the page. Text is only ever set as text, never as markup.
(() => {
  const PAGE = 100;
  const TASKS = { eqa: "question answering", ground_one: "grounding, one target", ground_many: "grounding, many" };
  const questions = JSON.parse(document.getElementById("questions").textContent);
  const field = (id) => document.getElementById(id);
  const rows = field("rows");
  const more = field("more");
  const pickers = ["label", "task", "category", "scene"];
  let matching = [];
  let shown = 0;

  const make = (tag, options = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(options)) {
      if (value !== null && value !== undefined) element.setAttribute(name, value);
    }
    for (const child of children.flat()) {
      if (child !== null && child !== undefined) element.append(child);
    }
    return element;
  };
  const percent = (share) => (share === null ? "–" : `${(100 * share).toFixed(1)}\u00a0%`);
  const orDash = (value) => (value === null || value === "" ? "–" : String(value));

  const terms = (pairs) =>
    make("dl", {}, ...pairs.map(([name, value]) => [
      make("dt", {}, name),
      make("dd", {}, value instanceof Node ? value : orDash(value)),
    ]));

  const table = (title, columns, lines) =>
    make(
      "div",
      { class: "scroll", tabindex: "0", role: "region", "aria-label": title },
      make(
        "table",
        {},
        make("thead", {}, make("tr", {}, ...columns.map((column) => make("th", { scope: "col" }, column)))),
        make("tbody", {}, ...lines.map((line) => make("tr", {}, ...line.map((cell) => make("td", {}, orDash(cell)))))),
      ),
    );

  const armScore = (question, arm) => {
    if (question.task === "eqa") return arm.mark === null ? `unscored: ${arm.mark_reason}` : `mark ${arm.mark}`;
    return arm.iou === null ? "unscored" : `IoU ${percent(arm.iou)}`;
  };

  const armTable = (question) => {
    const grounding = question.task !== "eqa";
    const columns = ["Arm", "Answer", "Score", "Views, in image order"];
    if (grounding) columns.push("Found / targets", "Gaussians");
    const lines = question.arms.map((arm) => {
      const views = arm.views.map((view, index) => `${arm.chosen.includes(index) ? "→ " : ""}${index}: ${view}`);
      const answer = arm.status === "answered" ? arm.answer : `${arm.status}: ${arm.reason}`;
      const line = [arm.arm, answer, armScore(question, arm), views.join("\n")];
      return grounding ? [...line, `${orDash(arm.predicted)} / ${orDash(arm.targets)}`, arm.region] : line;
    });
    return table("Answers by arm", columns, lines);
  };

  const viewCard = (candidate) => {
    const picture = candidate.image
      ? make("img", { src: candidate.image, loading: "lazy", alt: `View ${candidate.candidate}` })
      : make("div", { class: "noimage" }, "no thumbnail");
    const short = candidate.moved_m < candidate.requested_m - 0.001;
    const moved = candidate.requested_m
      ? `moved ${candidate.moved_m.toFixed(2)} m${short ? ` of ${candidate.requested_m.toFixed(2)}: a surface was in the way` : ""}`
      : null;
    return make(
      "div",
      { class: candidate.chosen ? "view chosen" : "view" },
      picture,
      make("strong", {}, `${candidate.move}${candidate.chosen ? " (chosen)" : ""}`),
      make("div", { class: "where" }, candidate.candidate),
      make("div", { class: "where" }, `sees ${percent(candidate.visibility)}, ${candidate.source}`),
      moved && make("div", { class: "where" }, moved),
      candidate.answer === null ? make("p", { class: "empty" }, "not asked") : make("p", {}, candidate.answer),
    );
  };

  const clusterPart = (cluster) => [
    make("h3", {}, `Cluster ${cluster.cluster}: ${cluster.category}`),
    terms([
      ["Gaussians", `${cluster.gaussians.toLocaleString("en")} around (${cluster.centre.join(", ")}) m`],
      ["Initial view", cluster.initial_view ? `${cluster.initial_view}, sees ${percent(cluster.visibility)}` : "no view sees it"],
      ["Chosen view", cluster.final],
    ]),
    make("div", { class: "views" }, ...cluster.candidates.map(viewCard)),
  ];

  const callTable = (question) =>
    table(
      "Model calls",
      ["Stage", "About", "Outcome", "Try", "Tokens in + out", "Seconds", "Reply"],
      question.calls.map((call) => [
        call.stage,
        call.subject,
        call.outcome,
        call.attempt,
        call.tokens.join(" + "),
        call.cached ? "cached" : call.seconds,
        call.reply,
      ]),
    );

  const detail = (question) =>
    make(
      "div",
      { class: "detail" },
      terms([
        ["Id", make("a", { href: `#q=${encodeURIComponent(question.id)}` }, question.id)],
        ["Reference", question.reference],
        ["Answer", question.status === "answered" ? question.answer : `${question.status}: ${question.reason}`],
        ["Evidence", question.evidence.join(", ")],
        ["Activated", `${question.activated.toLocaleString("en")} Gaussians`],
        ["Clusters", `${question.clusters_kept} kept of ${question.clusters_found}`],
        ["Verification", question.stands ? `kept the ${question.stands} answer` : "nothing to verify"],
        ["Model", question.model],
      ]),
      make("h3", {}, "Answers"),
      armTable(question),
      ...question.clusters.flatMap(clusterPart),
      make("h3", {}, `Model calls (${question.calls.length})`),
      question.calls.length ? callTable(question) : make("p", { class: "empty" }, "none"),
    );

  const chips = (question) => {
    const words = { right: "right", wrong: "wrong", unscored: "not scored", failed: "failed", unparsed: "unparsed",
      skipped: "skipped", "novel-better": "novel views +", "novel-worse": "novel views −",
      "verify-better": "verification +", "verify-worse": "verification −" };
    return question.labels
      .filter((label) => label in words)
      .map((label) => make("span", { class: `chip ${label.split("-").pop()}` }, words[label]));
  };

  const fill = (box, question) => {
    if (box.open && !box.querySelector(".detail")) box.append(detail(question));
  };

  const row = (question) => {
    const box = make(
      "details",
      { class: "question" },
      make(
        "summary",
        {},
        make("span", { class: "words" }, question.question),
        make("span", { class: "where" }, [TASKS[question.task], question.category, question.scene].filter(Boolean).join(" · ")),
        ...chips(question),
      ),
    );
    box.addEventListener("toggle", () => fill(box, question));
    return box;
  };

  const showMore = () => {
    const next = matching.slice(shown, shown + PAGE);
    rows.append(...next.map(row));
    shown += next.length;
    more.hidden = shown >= matching.length;
    more.textContent = `Show more (${matching.length - shown} left)`;
  };

  const filter = () => {
    const wanted = Object.fromEntries(pickers.map((name) => [name, field(name).value]));
    const text = field("search").value.trim().toLowerCase();
    matching = questions.filter(
      (question) =>
        (!wanted.label || question.labels.includes(wanted.label)) &&
        (!wanted.task || question.task === wanted.task) &&
        (!wanted.category || question.category === wanted.category) &&
        (!wanted.scene || question.scene === wanted.scene) &&
        (!text || `${question.id} ${question.question} ${question.answer} ${question.reference ?? ""}`.toLowerCase().includes(text)),
    );
    rows.replaceChildren();
    shown = 0;
    showMore();
    field("count").textContent = `${matching.length} of ${questions.length} questions`;
  };

  for (const name of ["task", "category", "scene"]) {
    for (const value of [...new Set(questions.map((question) => question[name]))].sort()) {
      if (value) field(name).append(make("option", { value }, name === "task" ? TASKS[value] : value));
    }
  }
  for (const option of field("label").options) {
    const count = questions.filter((question) => question.labels.includes(option.value)).length;
    if (option.value) option.textContent += ` (${count})`;
  }
  pickers.forEach((name) => field(name).addEventListener("change", filter));
  field("search").addEventListener("input", filter);
  document.querySelector(".filters").addEventListener("submit", (event) => event.preventDefault());
  more.addEventListener("click", showMore);

  // report.html#q=ID opens one question, so that a link can point at it.
  const openLinked = () => {
    const id = decodeURIComponent(location.hash.replace(/^#q=/, ""));
    const index = location.hash.startsWith("#q=") ? questions.findIndex((question) => question.id === id) : -1;
    if (index < 0) return filter();
    pickers.forEach((name) => (field(name).value = ""));
    field("search").value = id;
    filter();
    const box = rows.children[matching.indexOf(questions[index])];
    if (!box) return undefined;
    box.open = true;
    fill(box, questions[index]);
    return box.scrollIntoView();
  };
  addEventListener("hashchange", openLinked);
  openLinked();
})();
