// Draws the curves of the page with uPlot: drag to zoom, double click or "whole log" to go back, all panels together.
(function () {
  "use strict";
  const source = document.getElementById("curves");
  if (!source) return;
  const found = JSON.parse(source.textContent);
  const sync = uPlot.sync("time");
  const GAP = 65535; // level that marks a missing sample
  const HEIGHT = [150, 92]; // px, of a signal and of its error
  const DASHES = { "--before": [2, 2], "--after": [7, 2] }; // px; nominal and improved robot as in all figures
  const PERIODS = 20; // that a panel shows at first; more of them cover each other
  let panels = [], view = null, shown = 0;

  const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  const font = (size) => size + "px " + css("--sans");

  function unpacked(curve) {
    const bytes = Uint8Array.from(atob(curve.levels), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 2 }, (_, i) => {
      const level = view.getUint16(2 * i, true);
      return level === GAP ? null : curve.least + curve.height * level;
    });
  }

  function number(value) {
    if (value == null) return "–";
    const size = Math.abs(value);
    return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : size >= 0.1 ? 3 : 4);
  }

  function rounded(value) { // down to 1, 2 or 5 times a power of ten
    const power = 10 ** Math.floor(Math.log10(value)), head = value / power;
    return (head >= 5 ? 5 : head >= 2 ? 2 : 1) * power;
  }

  function ticks(u, axis, low, high) {
    const end = rounded(0.95 * high);
    return [-end, 0, end];
  }

  function drawBand(u, band) {
    const top = u.valToPos(band, "y", true), bottom = u.valToPos(-band, "y", true);
    const { left, width, top: above, height } = u.bbox;
    const from = Math.max(top, above), to = Math.min(bottom, above + height);
    u.ctx.fillStyle = css("--band");
    u.ctx.fillRect(left, from, width, Math.max(to - from, 0));
  }

  function zoomed(range) {
    if (view && range[0] === view[0] && range[1] === view[1]) return;
    view = range;
    for (const panel of panels) panel.setScale("x", { min: range[0], max: range[1] });
  }

  function whole() {
    const log = found.logs[shown];
    return [0, Math.max(log.step * (log.samples - 1), log.step)];
  }

  function opening() { // the middle of a log with too many periods, by the noise-free curves
    const log = found.logs[shown], [low, high] = whole();
    const crossings = log.columns.map((column) => {
      const curve = unpacked(column.nominal).filter((value) => value != null);
      const mean = curve.reduce((a, b) => a + b, 0) / curve.length;
      return curve.filter((value, i) => i && value > mean !== curve[i - 1] > mean).length;
    });
    const half = (high - low) / 2 * Math.min(1, 2 * PERIODS / Math.max(...crossings));
    return half < (high - low) / 2 ? [(low + high) / 2 - half, (low + high) / 2 + half] : null;
  }

  function moved(shift, scale) {
    const [low, high] = whole(), [a, b] = view || [low, high];
    const width = Math.min((b - a) * scale, high - low), middle = (a + b) / 2 + shift * (b - a);
    const from = Math.min(Math.max(middle - width / 2, low), high - width);
    zoomed([from, from + width]);
  }

  function options(place, height, title, series, band, last) {
    const axis = { stroke: css("--soft"), font: font(12), ticks: { show: false } };
    const grid = { stroke: css("--rule"), width: 1 };
    return {
      width: place.clientWidth, height, legend: { show: false }, padding: [6, 6, 0, 0],
      cursor: { sync: { key: sync.key, scales: ["x", null] }, y: false, points: { show: false }, drag: { setScale: true } },
      scales: {
        x: { time: false },
        y: { range: (u, low, high) => {
          if (low == null) return [-1, 1];
          const room = band ? Math.max(-low, high, 1.5 * band) * 1.08 : 0;
          return band ? [-room, room] : uPlot.rangeNum(low, high, 0.08, false);
        } },
      },
      axes: [
        { ...axis, grid: { show: false }, size: last ? 26 : 6, values: last ? (u, t) => t.map((v) => v + " s") : () => [] },
        { ...axis, grid, size: 50, space: 26, splits: band ? ticks : undefined, values: (u, t) => t.map((v) => +v.toPrecision(6) + "") },
      ],
      series: [{}, ...series],
      hooks: {
        drawClear: band ? [(u) => drawBand(u, band)] : [],
        setScale: [(u, key) => { if (key === "x") zoomed([u.scales.x.min, u.scales.x.max]); }],
        setCursor: [(u) => read(u, title)],
      },
    };
  }

  function read(u, title) {
    const i = u.cursor.idx;
    title.textContent = i == null ? title.dataset.rest : number(u.data[0][i]) + " s:";
    if (i == null) return;
    u.data.slice(1).forEach((row, k) => {
      const value = title.appendChild(document.createElement("span"));
      value.textContent = "   " + number(row[i]);
      value.style.color = u.series[k + 1].stroke();
    });
  }

  function panel(cell, kind, column, time) {
    const line = (stroke, width) => ({ stroke: css(stroke), width, points: { show: false }, dash: DASHES[stroke] || [] });
    const head = (name, rest) => {
      const row = cell.appendChild(document.createElement("div"));
      row.className = "reading";
      row.appendChild(document.createElement("b")).textContent = name;
      const text = row.appendChild(document.createElement("span"));
      text.dataset.rest = text.textContent = rest;
      return text;
    };
    const title = head(column.channel, kind.label + (kind.unit ? " [" + kind.unit + "]" : ""));
    const draw = (text, height, series, band, last) => {
      const box = cell.appendChild(document.createElement("div"));
      box.setAttribute("role", "img");
      box.setAttribute("aria-label", kind.label + " " + column.channel + (band ? ", error" : ""));
      const data = [time, ...series.map(([name]) => unpacked(column[name]))];
      const drawn = series.map(([, stroke, width]) => line(stroke, width));
      panels.push(new uPlot(options(box, height, text, drawn, band, last), data, box));
    };
    const robots = found.robots.map((name, i) => [name, ["--before", "--after"][i]]);
    draw(title, HEIGHT[0], [["measured", "--measured", 2], ...robots.map(([name, colour]) => [name, colour, 1.5])], 0, false);
    draw(head("", "error"), HEIGHT[1], robots.map(([name, colour]) => ["error_" + name, colour, 1]), column.band, true);
  }

  function drawAll() {
    for (const old of panels) old.destroy();
    panels = [];
    const log = found.logs[shown];
    const time = Array.from({ length: log.samples }, (_, i) => i * log.step);
    for (const place of document.querySelectorAll(".channels")) {
      place.textContent = "";
      if (!place.clientWidth) continue; // folded
      const kind = found.kinds.find((k) => k.name === place.dataset.kind);
      const columns = log.columns.filter((column) => column.kind === kind.name);
      const cells = columns.map(() => place.appendChild(document.createElement("div"))); // all, since they share the width
      cells.forEach((cell, i) => { cell.className = "channel"; panel(cell, kind, columns[i], time); });
    }
    const part = opening(), kept = view || part;
    document.getElementById("stretch").textContent = (part ? "At first, the middle of the log is shown. " : "")
      + (log.stretch > 1 ? "Each stretch of " + log.stretch + " samples is drawn by its least and its largest." : "");
    view = null;
    if (kept) zoomed(kept);
  }

  for (const button of document.querySelectorAll(".zoom button"))
    button.addEventListener("click", () => {
      const { shift, scale } = button.dataset;
      if (shift) moved(+shift, +scale); else zoomed(whole());
    });
  const choice = document.getElementById("log");
  if (choice) choice.addEventListener("change", () => { shown = +choice.value; view = null; drawAll(); });
  for (const fold of document.querySelectorAll("details")) fold.addEventListener("toggle", () => { if (fold.querySelector(".channels")) drawAll(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; drawAll(); } });
  drawAll();
})();
