// Pictures of views with what is laid over them, and the map of a scene.
const COLORS = 8;
const color = (number) => `c${number % COLORS}`;
const dot = (number) => make("span", { class: `dot ${color(number)}`, "aria-hidden": "true" });

const enlarge = (shot, caption) => {
  const box = byId("large");
  box.replaceChildren(
    make("div", { class: "bar" }, make("p", {}, caption), make("button", { type: "button", onclick: () => box.close() }, "Close")),
    make("div", { class: "shot" }, ...[...shot.children].map((child) => child.cloneNode())),
  );
  box.showModal();
};

// A picture, an overlay over it where there is one, and a button that enlarges both.
const picture = (image, overlay, caption, lazy = true) => {
  if (!image) return make("div", { class: "shot none" }, make("span", {}, "no picture kept"));
  const base = make("img", { src: image, alt: caption, loading: lazy ? "lazy" : null, decoding: "async" });
  const button = make("button", { type: "button", class: "shot", "aria-label": `Enlarge: ${caption}` }, base);
  base.addEventListener("error", () => button.replaceWith(make("div", { class: "shot none" }, make("span", {}, "picture missing"))));
  if (overlay) button.append(make("img", { class: "mask", src: overlay, alt: "", loading: lazy ? "lazy" : null }));
  button.addEventListener("click", () => enlarge(button, caption));
  return button;
};

const showOverlays = (shown) => {
  document.body.classList.toggle("bare", !shown);
  for (const box of document.querySelectorAll(".switch input")) box.checked = shown;
};
const overlaySwitch = () => {
  const box = make("input", { type: "checkbox" });
  box.checked = !document.body.classList.contains("bare");
  box.addEventListener("change", () => showOverlays(box.checked));
  return make("label", { class: "switch" }, box, " Show overlays ", make("kbd", {}, "o"));
};

const onMap = (map, point) =>
  [map.right, map.down].map((axis, i) => 100 * (axis[0] * point[0] + axis[1] * point[1] + axis[2] * point[2] - map.low[i]));

const standing = (pose) => {
  const row = (i) => pose.slice(4 * i, 4 * i + 3);
  const shift = [pose[3], pose[7], pose[11]];
  return { centre: [0, 1, 2].map((i) => -(row(0)[i] * shift[0] + row(1)[i] * shift[1] + row(2)[i] * shift[2])), ahead: row(2) };
};

// Metres are drawn as centimetres, so that strokes of a few units look right at any size.
const mapOf = (map, question, title) => {
  const [width, height] = map.size.map((side) => 100 * side);
  const unit = Math.max(width, height) / 100;
  const text = `${title}: a map from above with ${plural(question.clusters.length, "cluster")} and the views considered`;
  const svg = draw("svg", { viewBox: `0 0 ${width} ${height}`, class: "map", role: "img", "aria-label": text });
  const whole = { x: 0, y: 0, width, height, preserveAspectRatio: "none" };
  if (map.image) svg.append(draw("image", { ...whole, href: map.image }));
  if (map.path) svg.append(draw("polyline", { class: "path", "stroke-width": unit / 5, points: map.path.map((p) => `${100 * p[0]},${100 * p[1]}`).join(" ") }));
  if (question.drawn?.dots) svg.append(draw("image", { ...whole, class: "mask", href: question.drawn.dots }));
  const wedge = (view, number, kind) => {
    const { centre, ahead } = standing(view.pose);
    const [x, y] = onMap(map, centre);
    const angle = Math.atan2(
      ahead[0] * map.down[0] + ahead[1] * map.down[1] + ahead[2] * map.down[2],
      ahead[0] * map.right[0] + ahead[1] * map.right[1] + ahead[2] * map.right[2],
    );
    const reach = (kind === "novel" ? 4 : 6) * unit;
    const at = (turn) => `${x + reach * Math.cos(angle + turn)},${y + reach * Math.sin(angle + turn)}`;
    return draw(
      "polygon",
      { class: `eye ${kind} ${color(number)}${view.chosen ? " chosen" : ""}`, "stroke-width": unit / 3, points: `${x},${y} ${at(-0.45)} ${at(0.45)}` },
      draw("title", {}, `${view.move}: ${view.candidate}${view.chosen ? ", chosen" : ""}`),
    );
  };
  const order = question.clusters.flatMap((cluster) => cluster.candidates.map((view) => [cluster, view]));
  order.sort((a, b) => a[1].chosen - b[1].chosen);
  for (const [cluster, view] of order) svg.append(wedge(view, cluster.cluster, view.move === "initial" ? "first" : "novel"));
  for (const cluster of question.clusters) {
    const [x, y] = onMap(map, cluster.centre);
    svg.append(
      draw("circle", { class: `centre ${color(cluster.cluster)}`, cx: x, cy: y, r: 1.9 * unit, "stroke-width": unit / 2.5 }, draw("title", {}, `Cluster ${cluster.cluster}: ${cluster.category}`)),
      draw("text", { class: "centre", x, y: y + 0.95 * unit, "font-size": 2.7 * unit, "text-anchor": "middle" }, String(cluster.cluster)),
    );
  }
  const metre = 100;
  svg.append(
    draw("rect", { class: "scale", x: unit, y: height - 7.5 * unit, width: metre + 2 * unit, height: 6.7 * unit, rx: unit }),
    draw("path", { class: "scale", "stroke-width": unit / 2.5, d: `M${2 * unit} ${height - 2 * unit}h${metre}m0 ${-unit}v${2 * unit}m${-metre} ${-2 * unit}v${2 * unit}` }),
    draw("text", { class: "scale", x: 2 * unit + metre / 2, y: height - 4 * unit, "font-size": 2.6 * unit, "text-anchor": "middle" }, "1 m"),
  );
  return svg;
};
