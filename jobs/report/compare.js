// The page of two runs, side by side.
const detail = (pair, all) => {
  const about = (side, record) => {
    const scene = all.scenes.indexOf(record.scene);
    return { map: all.maps[side][scene], problem: all.problems[side][scene], note: all.note[side] };
  };
  const column = (side, record, name) => make("div", { class: "side" }, make("h3", { class: "sidename" }, make("b", {}, side.toUpperCase()), ` ${name}`),
    ...(record ? steps(record, about(side, record), all.prompts) : [make("p", { class: "empty" }, "this run has no row for it")]));
  return [make("div", { class: "sides" }, column("a", pair.a, all.names.a), column("b", pair.b, all.names.b))];
};
start();
