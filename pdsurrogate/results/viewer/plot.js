// A small plot of curves in SVG, with the values of the nearest point on hover.

const SPACE = "http://www.w3.org/2000/svg"; // the name of SVG's elements: nothing is fetched
const COLORS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#7f7f7f"];

export const colorOf = (number) => COLORS[number % COLORS.length];

// A number with so many significant digits, without zeros at the end.
export const digits = (value, count = 4) =>
  value === null || Number.isNaN(value) ? "–" : String(+Number(value).toPrecision(count)).replace("-", "−");

function element(parent, name, attributes, text) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return parent.appendChild(made);
}

// Round numbers between two ends, some `count` of them.
export function ticks(low, high, count = 5) {
  const rough = (high - low) / count;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((one) => one * power >= rough * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++) found.push(k * step);
  return found;
}

// Draw series [{name, x, y, color}] into an SVG element; `told` gets the words for the nearest point.
export function plot(svg, series, xlabel, ylabel, told) {
  const [width, height, left, right, top, bottom] = [460, 300, 64, 12, 12, 42];
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const points = series.flatMap(({ name, x, y, color }) =>
    x.map((at, k) => ({ name, color, x: at, y: y[k] })).filter((one) => Number.isFinite(one.x) && Number.isFinite(one.y) && one.x !== null && one.y !== null));
  told("");
  if (!points.length) return;
  const ends = (values) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) [low, high] = [Math.min(low, value), Math.max(high, value)];
    const room = (high - low || Math.abs(high) || 1) * 0.04;
    return [low - room, high + room];
  };
  const [x0, x1] = ends(points.map((one) => one.x));
  const [y0, y1] = ends(points.map((one) => one.y));
  const px = (x) => left + ((x - x0) / (x1 - x0)) * (width - left - right);
  const py = (y) => height - bottom - ((y - y0) / (y1 - y0)) * (height - top - bottom);
  for (const x of ticks(x0, x1)) {
    element(svg, "line", { x1: px(x), x2: px(x), y1: top, y2: height - bottom, class: "grid" });
    element(svg, "text", { x: px(x), y: height - bottom + 15, "text-anchor": "middle" }, digits(x));
  }
  for (const y of ticks(y0, y1)) {
    element(svg, "line", { x1: left, x2: width - right, y1: py(y), y2: py(y), class: "grid" });
    element(svg, "text", { x: left - 6, y: py(y) + 4, "text-anchor": "end" }, digits(y));
  }
  element(svg, "text", { x: (left + width - right) / 2, y: height - 8, "text-anchor": "middle" }, xlabel);
  const middle = (top + height - bottom) / 2;
  element(svg, "text", { x: 13, y: middle, "text-anchor": "middle", transform: `rotate(-90 13 ${middle})` }, ylabel);
  for (const { x, y, color } of series) {
    let path = "";
    let down = false; // a gap where a value is missing
    x.forEach((at, k) => {
      const there = at !== null && y[k] !== null && Number.isFinite(y[k]);
      if (there) path += `${down ? "L" : "M"}${px(at).toFixed(1)} ${py(y[k]).toFixed(1)}`;
      down = there;
    });
    element(svg, "path", { d: path, fill: "none", stroke: color, "stroke-width": 1.8 });
  }
  if (points.length < 200)
    for (const one of points) element(svg, "circle", { cx: px(one.x), cy: py(one.y), r: 2.6, fill: one.color });
  const mark = element(svg, "circle", { r: 5, fill: "none", "stroke-width": 2, visibility: "hidden" });
  svg.onpointermove = (event) => {
    const box = svg.getBoundingClientRect();
    const [mx, my] = [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
    let nearest = points[0];
    let least = Infinity;
    for (const one of points) {
      const away = Math.hypot(px(one.x) - mx, py(one.y) - my);
      if (away < least) [nearest, least] = [one, away];
    }
    for (const [key, value] of Object.entries({ cx: px(nearest.x), cy: py(nearest.y), stroke: nearest.color, visibility: "visible" }))
      mark.setAttribute(key, value);
    told(`${nearest.name}: ${digits(nearest.y, 6)} at ${digits(nearest.x, 6)}`);
  };
  svg.onpointerleave = () => {
    mark.setAttribute("visibility", "hidden");
    told("");
  };
}
