// The page of two runs, side by side.
const prepare = (all) => {
  all.about = all.scenery.map(scenesOf);
};
const detail = (pair, all) =>
  [make("div", { class: "sides" }, ...["A", "B"].map((side, place) => {
    const record = pair[place];
    const parts = record ? steps(record, all.about[place](record.scene), all.prompts) : [make("p", { class: "empty" }, "This run has no row for it.")];
    return make("div", { class: "side" }, make("h3", { class: "sidename" }, `${side}: ${all.names[place]}`), ...parts);
  }))];
start();
