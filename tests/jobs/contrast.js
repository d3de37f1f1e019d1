// The text with the least contrast to what is behind it: ratio, element, class, text.
(() => {
  const parse = (text) => { const n = text.match(/[\d.]+/g).map(Number); return [n[0], n[1], n[2], n[3] ?? 1]; };
  const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const light = (c) => { const v = c.slice(0, 3).map((x) => x / 255).map((x) => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]; };
  const behind = (e) => { const all = []; for (let n = e; n; n = n.parentElement) all.unshift(parse(getComputedStyle(n).backgroundColor));
    return all.reduce((below, top) => over(top, below), [255, 255, 255, 1]); };
  const worst = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const e = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || !e.getClientRects().length || /^(SCRIPT|STYLE|TITLE|OPTION)$/i.test(e.tagName)) continue;
    if (e.closest("button:disabled, .map")) continue;
    const style = getComputedStyle(e);
    const below = behind(e);
    const ink = over(parse(e instanceof SVGElement ? style.fill : style.color), below);
    const [a, b] = [light(ink), light(below)].sort((x, y) => y - x);
    worst.push([(a + 0.05) / (b + 0.05), e.tagName, e.className.baseVal ?? e.className, e.textContent.slice(0, 40)]);
  }
  return worst.sort((a, b) => a[0] - b[0])[0];
})()
