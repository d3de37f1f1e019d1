// Before anything is drawn: which tab is asked for and which theme was chosen, so that nothing jumps when the rest is there.
{
  const root = document.documentElement;
  const path = location.hash.replace(/^#/, "").split("?")[0];
  root.dataset.tab = path.startsWith("q=") ? "question" : path || "overview";
  try {
    const theme = localStorage.getItem("theme");
    if (theme === "light" || theme === "dark") root.dataset.theme = theme;
  } catch {
    // storage may be forbidden to pages on disk
  }
}
