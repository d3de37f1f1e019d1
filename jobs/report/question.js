// One question with all that led to its answer, in the order of the method.
const TASKS = { eqa: "Question answering", ground_one: "Grounding, one target", ground_many: "Grounding, many" };
const SCORE = { eqa: "Mark", ground_one: "3D IoU", ground_many: "Instance mIoU" };
const CHIPS = { right: "right", wrong: "wrong", unscored: "not scored", failed: "failed", unparsed: "unparsed", skipped: "skipped",
  "novel-better": "novel views +", "novel-worse": "novel views −", better: "B better", worse: "B worse", "verify-better": "verification +", "verify-worse": "verification −" };
const STANDS = { initial: "kept the initial views", final: "kept the chosen views", mixed: "kept chosen views for some clusters and initial ones for others" };

const chips = (labels) =>
  labels.filter((label) => label in CHIPS).map((label) => make("span", { class: `chip ${label.split("-").pop()}` }, CHIPS[label]));

const terms = (pairs) =>
  make("dl", {}, ...pairs.filter(Boolean).map(([name, value]) => [
    make("dt", {}, name),
    make("dd", {}, value instanceof Node ? value : orDash(value)),
  ]));

const table = (title, columns, lines) =>
  make(
    "div",
    { class: "scroll", tabindex: "0", role: "region", "aria-label": title },
    make("table", {},
      make("thead", {}, make("tr", {}, ...columns.map((column) => make("th", { scope: "col" }, column)))),
      make("tbody", {}, ...lines.map((line) => make("tr", {}, ...line.map((cell) => make("td", {}, cell instanceof Node ? cell : orDash(cell)))))),
    ),
  );

const step = (number, title, note, ...parts) =>
  make("section", { class: "step" }, make("h3", {}, make("span", { class: "number", "aria-hidden": "true" }, String(number)), title),
    note && make("p", { class: "note" }, note), ...parts);

const armScore = (question, arm) => {
  if (question.task === "eqa") return arm.mark === null ? `not scored: ${arm.mark_reason}` : `${arm.mark} of 5`;
  return arm.iou === null ? "not scored" : percent(arm.iou);
};

const said = (arm) => (arm.status === "answered" ? arm.answer : `${arm.status}: ${arm.reason}`);

const verdict = (question) => {
  const last = question.arms.at(-1);
  const path = question.arms.map((arm, place) => [place > 0 && make("span", { class: "arrow", "aria-hidden": "true" }, "→"),
    make("span", { class: "arm" }, make("b", {}, arm.mark === null && arm.iou === null ? "not scored" : armScore(question, arm)), make("small", {}, arm.arm))]);
  const truth = question.task === "eqa" ? question.reference : last && last.targets !== null ? plural(last.targets, "target") : null;
  const answer = question.status === "answered" ? question.answer : `${question.status}: ${question.reason}`;
  return make("div", { class: "verdict" },
    make("div", {}, make("small", {}, "Answer"), make("p", {}, orDash(answer))),
    make("div", {}, make("small", {}, "Ground truth"), make("p", {}, orDash(truth))),
    make("div", {}, make("small", {}, `${SCORE[question.task]} by arm`), make("p", { class: "arms" }, path.length ? path : "–")),
  );
};

const evidence = (question) =>
  step(1, "Evidence", "Categories that the model named, and the Gaussians they activate.",
    question.evidence.length ? make("ul", { class: "tags" }, ...question.evidence.map((name) => make("li", {}, name))) : make("p", { class: "empty" }, "no category"),
    make("p", {}, `${plural(question.activated, "Gaussian")} active, in ${plural(question.clusters_found, "cluster")}; ${whole(question.clusters_kept)} kept.`),
    question.clusterings.length > 0 && table("Clustering by category", ["Category", "Gaussians", "Clusters", "Not split below"],
      question.clusterings.map(([name, active, clusters, epsilon]) => [name, whole(active), clusters, `${epsilon} m`])));

const where = (question, scene) => {
  if (!question.clusters.length) return null;
  const legend = make("ul", { class: "legend" }, ...question.clusters.map((cluster) =>
    make("li", {}, dot(cluster.cluster), make("b", {}, `${cluster.cluster} ${cluster.category}`),
      make("span", { class: "where" }, `${plural(cluster.gaussians, "Gaussian")} at (${cluster.centre.join(", ")}) m`))));
  const hint = scene.map?.image ? "Seen from above, cut at eye level; the thin line is the path of the recorded cameras." : "Seen from above; the scene itself is not drawn.";
  return step(2, "Where", `${hint} Full wedges are initial views, small ones novel views; the judge's choice has a dark outline.`,
    !question.drawn && make("p", { class: "empty" }, scene.problem || scene.note),
    make("div", { class: "where-grid" }, scene.map && mapOf(scene.map, question, question.scene), legend));
};

const viewCard = (cluster, view, drawn) => {
  const own = drawn?.views[`${cluster.cluster}/${view.candidate}`];
  const short = view.moved_m < view.requested_m - 0.001;
  const moved = view.requested_m ? `moved ${view.moved_m.toFixed(2)} m${short ? ` of ${view.requested_m.toFixed(2)}: a surface was in the way` : ""}` : null;
  const sees = `sees ${percent(view.visibility)} of the cluster${own ? `, ${percent(own.pixels / own.of)} of the picture` : ""}`;
  const first = view.move === "initial";
  return make("figure", { class: `view${view.chosen ? " chosen" : ""}${first ? " first" : ""}` },
    picture(own?.image ?? view.image, own?.overlay, `${view.move} view ${view.candidate} of cluster ${cluster.cluster}, ${cluster.category}`),
    make("figcaption", {},
      make("strong", {}, first ? "initial view" : view.move, view.chosen && make("span", { class: "chip chosen" }, "chosen")),
      view.answer === null ? make("p", { class: "empty" }, "not asked") : make("p", { class: "quote" }, view.answer),
      make("p", { class: "where" }, [sees, moved, view.source === "photo" ? "photograph" : null, view.candidate].filter(Boolean).join(" · "))));
};

const views = (question) => {
  if (!question.clusters.length) return null;
  const masked = Object.values(question.drawn?.views ?? {}).some((view) => view.overlay);
  return step(3, "Views and what the model saw in each", "Each cluster's most visible recorded view, and novel views around it, each answered alone. The judge chose one.",
    masked && overlaySwitch(), masked && make("p", { class: "note" }, "Filled: pixels that the cluster's Gaussians dominate. Outlined: the other clusters."),
    ...question.clusters.map((cluster) => make("section", { class: "cluster" },
      make("h4", {}, dot(cluster.cluster), `${cluster.cluster} ${cluster.category}`),
      cluster.candidates.length
        ? make("div", { class: "views" }, ...cluster.candidates.map((view) => viewCard(cluster, view, question.drawn)))
        : make("p", { class: "empty" }, "no recorded view sees it"))));
};

const answers = (question) => {
  const grounding = question.task !== "eqa";
  const lines = question.arms.map((arm) => [arm.arm, said(arm), armScore(question, arm),
    arm.views.map((view, index) => `${arm.chosen.includes(index) ? "→ " : ""}${index}: ${view}`).join("\n"),
    ...(grounding ? [`${orDash(arm.predicted)} of ${orDash(arm.targets)}`, whole(arm.region)] : [])]);
  const columns = ["Arm", "Answer", SCORE[question.task], "Views, in image order", ...(grounding ? ["Found of targets", "Gaussians"] : [])];
  const named = question.arms.some((arm) => arm.chosen.length) ? "An arrow marks the images that the model named." : null;
  return step(4, "Answers and verification", named,
    make("p", {}, `Verification: ${STANDS[question.stands] ?? "nothing to verify, since the chosen views are the initial ones"}.`),
    question.arms.length ? table("Answers by arm", columns, lines) : make("p", { class: "empty" }, "no answer"),
    question.saved.length > 0 && make("p", { class: "note" }, `Calls not made: ${question.saved.join("; ")}.`));
};

const grounded = (question) => {
  if (question.task === "eqa") return null;
  const drawn = question.drawn?.grounded ?? [];
  const known = drawn.some((one) => one.truth !== null);
  const last = question.arms.at(-1)?.arm;
  const own = question.regions.filter(([arm]) => arm === last);
  return step(5, "What was grounded", `Gaussians of the ${last ?? "last"} arm where they dominate a pixel, one colour an instance${known ? "; the white outline is the ground truth" : ""}.`,
    drawn.length
      ? make("div", { class: "views" }, ...drawn.map((one) => make("figure", { class: "view first" },
          picture(one.image, one.overlay, `grounded in view ${one.view}`),
          make("figcaption", {}, make("strong", {}, `view ${one.view}`),
            one.instances.map(([number, count]) => make("p", { class: "where" }, dot(number), `instance ${number}: ${plural(count, "Gaussian")}`)),
            one.truth === 0 && make("p", { class: "where" }, "no target dominates a pixel here")))))
      : own.length
        ? table("Regions", ["Instance", "View", "Gaussians"], own.map(([, instance, view, count]) => [instance, view, whole(count)]))
        : make("p", { class: "empty" }, "nothing was grounded"));
};

// What a model was asked: as it was sent, or, where the run did not keep that, the prompt before it was filled in.
const requestOf = (call, prompts, lines) => {
  if (call.sent.length) return [make("h4", {}, "Request"), make("pre", { tabindex: "0" }, call.sent.map((place) => lines[place]).join("\n"))];
  const prompt = prompts.find((one) => call.prompt && one.sha256.startsWith(call.prompt));
  if (!prompt) return [make("h4", {}, "Request"), make("p", { class: "empty" }, `This run kept none; the hash of its prompt begins with ${orDash(call.prompt)}.`)];
  return [make("h4", {}, `Request: this run kept none; prompt ${prompt.name} before the question's data were filled in`), make("pre", { tabindex: "0" }, prompt.text)];
};

const callLine = (call, prompts, lines) => {
  const facts = [call.cached ? "stored reply" : seconds(call.seconds), call.tokens[0] + call.tokens[1] ? `${whole(call.tokens[0])} + ${whole(call.tokens[1])} tokens` : null,
    call.usd ? `${call.usd} USD` : null, call.attempt > 1 ? `try ${call.attempt}` : null, call.outcome === "ok" ? null : call.outcome];
  const box = make("details", { class: `call${call.outcome === "ok" ? "" : " bad"}` },
    make("summary", {}, make("b", {}, call.stage), make("span", { class: "where" }, call.subject), make("span", { class: "quote" }, call.reply), make("small", {}, facts.filter(Boolean).join(" · "))));
  box.addEventListener("toggle", () => {
    if (!box.open || box.children.length > 1) return;
    box.append(make("div", { class: "inside" },
      ...requestOf(call, prompts, lines), make("h4", {}, "Reply"), make("pre", { tabindex: "0" }, call.reply || "(empty)"),
      terms([["Model", call.model], ["Key of the stored reply", call.key]])));
  }, true);
  return box;
};

const calls = (question, prompts, lines) => {
  const sent = question.calls.filter((call) => !call.cached);
  const time = question.seconds.reduce((sum, [, value]) => sum + (value ?? 0), 0);
  return step(6, `Model calls (${question.calls.length})`, `${whole(sent.length)} sent, ${whole(question.calls.length - sent.length)} found among stored replies; ${seconds(time)} in all stages.`,
    question.seconds.length > 0 && make("p", { class: "where" }, question.seconds.map(([stage, value]) => `${stage} ${seconds(value)}`).join(" · ")),
    question.calls.length ? make("div", { class: "calls" }, ...question.calls.map((call) => callLine(call, prompts, lines))) : make("p", { class: "empty" }, "none"));
};

// The steps of one run's record; scene holds its map and why nothing was drawn, lines those of the requests beside it.
const steps = (question, scene, prompts, lines) =>
  [verdict(question), evidence(question), where(question, scene), views(question), answers(question), grounded(question), calls(question, prompts, lines)].filter(Boolean);
