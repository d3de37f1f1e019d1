// Headings that skip a level, regions of one role that share a name, and what to press that is under 24 pixels.
(() => {
  const shown = (selector) => [...document.querySelectorAll(selector)].filter((e) => e.getClientRects().length);
  const start = (e) => e.outerHTML.slice(0, 120);
  const headings = shown("h1, h2, h3, h4, h5, h6");
  const skipped = headings.filter((e, at) => at && Number(e.tagName[1]) > Number(headings[at - 1].tagName[1]) + 1);
  const names = shown("[role=region], nav, section[aria-label]").map((e) => [`${e.tagName} ${e.getAttribute("aria-label")}`, e]);
  const shared = names.filter(([name], at) => names.findIndex(([other]) => other === name) !== at).map(([, e]) => e);
  const small = shown("button, select, input, summary, a.button, nav a").filter((e) => {
    const box = (e.closest("label") ?? e).getBoundingClientRect();
    return box.width < 24 || box.height < 24;
  });
  return [...skipped.map((e) => ["skips a level", start(e)]), ...shared.map((e) => ["shares its name", start(e)]), ...small.map((e) => ["is small", start(e)])];
})()
