addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(d => { d.open = true; }));
const tables = document.querySelectorAll(".wide");
const look = () => tables.forEach(t => { const over = t.scrollWidth > t.clientWidth + 2;
  t.classList.toggle("scrolls", over);
  t.classList.toggle("cut", over && t.scrollLeft + t.clientWidth < t.scrollWidth - 2);
  if (over) { t.tabIndex = 0; } });
tables.forEach(t => t.addEventListener("scroll", look)); addEventListener("resize", look);
document.querySelectorAll("details").forEach(d => d.addEventListener("toggle", look)); look();
document.querySelectorAll(".plot").forEach(plot => {
  const drawings = [...plot.querySelectorAll("svg")].map(
    svg => ({ svg, home: svg.getAttribute("viewBox").split(" ").map(Number) }));
  // how far in, and the middle of what is seen, as shares of the whole
  let scale = 1, x = 0.5, y = 0.5;
  const show = () => { const half = 0.5 / scale;
    x = Math.min(Math.max(x, half), 1 - half); y = Math.min(Math.max(y, half), 1 - half);
    drawings.forEach(({ svg, home }) => svg.setAttribute("viewBox", [
      home[0] + (x - half) * home[2], home[1] + (y - half) * home[3],
      home[2] / scale, home[3] / scale].join(" "))); plot.classList.toggle("zoomed", scale > 1); };
  const zoom = (factor, px = 0.5, py = 0.5) => { const next = Math.min(Math.max(scale * factor, 1), 20);
    x += (px - 0.5) * (1 / scale - 1 / next); y += (py - 0.5) * (1 / scale - 1 / next); scale = next; show(); };
  const place = event => { const box = plot.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]; };
  const bar = document.createElement("div"); bar.className = "zoom";
  const acts = [["+", "zoom in", () => zoom(1.6)], ["−", "zoom out", () => zoom(1 / 1.6)],
    ["1:1", "whole plot", () => { scale = 1; show(); }]];
  acts.forEach(([sign, name, act]) => {
    const button = document.createElement("button"); button.type = "button";
    button.textContent = sign; button.title = name; button.onclick = act;
    button.setAttribute("aria-label", name); bar.append(button); });
  plot.append(bar);
  plot.addEventListener("wheel", event => { if (event.ctrlKey || scale > 1) { event.preventDefault();
    zoom(event.deltaY < 0 ? 1.25 : 0.8, ...place(event)); } }, { passive: false });
  plot.addEventListener("dblclick", event => { if (!event.target.closest(".zoom")) { zoom(2, ...place(event)); } });
  let from = null;
  plot.addEventListener("pointerdown", event => { if (scale > 1 && !event.target.closest(".zoom")) {
    from = place(event); plot.setPointerCapture(event.pointerId); } });
  plot.addEventListener("pointermove", event => { if (from) { const [px, py] = place(event);
    x -= (px - from[0]) / scale; y -= (py - from[1]) / scale; from = [px, py]; show(); } });
  ["pointerup", "pointercancel"].forEach(kind => plot.addEventListener(kind, () => { from = null; }));
});
