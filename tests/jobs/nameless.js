// Elements that a screen reader could not name.
[...document.querySelectorAll("a, button, select, input, img, summary, [role=region], [role=img], dialog, nav, section[aria-label]")]
  .filter((e) => e.getClientRects().length)
  .filter((e) => !(e.getAttribute("aria-label") || e.alt || e.textContent.trim() || e.labels?.length || e.matches("img.mask")))
  .map((e) => e.outerHTML.slice(0, 120))
