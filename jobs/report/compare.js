// The page of two runs, side by side.
const prepare = (all) => {
  all.about = all.scenery.map(scenesOf);
};
const detail = (pair, all, lines) =>
  [make("div", { class: "sides" }, ...["A", "B"].map((side, place) => {
    const record = pair[place];
    const parts = record ? steps(record, all.about[place](record.scene), all.prompts, lines) : [make("p", { class: "empty" }, "This run has no row for it.")];
    const box = make("div", { class: "side" }, make("h3", { class: "sidename" }, `${side}: ${all.names[place]}`), ...parts);
    for (const region of box.querySelectorAll("[role=region]")) region.setAttribute("aria-label", `${side}: ${region.getAttribute("aria-label")}`);
    return box;
  }))];
start();
