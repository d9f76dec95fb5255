// Draws quantities over dates or over a log with uPlot: points with intervals, the span in which a change began.
(function () {
  "use strict";
  const source = document.getElementById("timelines");
  if (!source) return;
  const found = JSON.parse(source.textContent), HEIGHT = 190;
  let panels = [];
  const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  const digits = (value) => value == null ? "–" : +value.toPrecision(4) + "";

  function span(u, one) { // the set of dates, behind everything
    if (!one.began) return;
    const { top, height } = u.bbox, at = (t) => u.valToPos(t, "x", true);
    const left = at(one.began[1]), width = Math.max(at(one.began[2]) - left, 2 * devicePixelRatio);
    u.ctx.fillStyle = css("--band");
    u.ctx.fillRect(left, top, width, height);
  }

  function intervals(u, one) {
    u.ctx.strokeStyle = css("--strong");
    u.ctx.lineWidth = devicePixelRatio;
    one.times.forEach((t, i) => {
      const x = Math.round(u.valToPos(t, "x", true));
      u.ctx.beginPath();
      u.ctx.moveTo(x, u.valToPos(one.low[i], "y", true));
      u.ctx.lineTo(x, u.valToPos(one.high[i], "y", true));
      u.ctx.stroke();
    });
  }

  function change(u, one) { // level, then step or slope
    if (!one.path) return;
    u.ctx.strokeStyle = css("--link");
    u.ctx.lineWidth = 1.5 * devicePixelRatio;
    u.ctx.beginPath();
    one.path.forEach(([t, y], k) => u.ctx[k ? "lineTo" : "moveTo"](u.valToPos(t, "x", true), u.valToPos(y, "y", true)));
    u.ctx.stroke();
  }

  function days(u, at, axis, space, step) { // parts of dates by ISO 8601: hours, days, or months
    const [from, to] = step < 86400 ? [5, 16] : step < 20 * 86400 ? [5, 10] : [0, 7];
    return at.map((t) => new Date(1e3 * t).toISOString().slice(from, to).replace("T", " "));
  }

  function draw(place, one) {
    const head = place.appendChild(document.createElement("div"));
    head.className = "reading";
    const name = head.appendChild(document.createElement("b"));
    name.textContent = one.title + (one.unit && one.unit !== "-" ? " [" + one.unit + "]" : "");
    const text = head.appendChild(document.createElement("span"));
    const box = place.appendChild(document.createElement("div"));
    const axis = { stroke: css("--soft"), font: "12px " + css("--sans"), ticks: { show: false } };
    const room = (low, high) => uPlot.rangeNum(low, high, 0.12, false);
    const first = one.times[0], last = one.times[one.times.length - 1], edge = 0.03 * (last - first || 1);
    panels.push(new uPlot({
      tzDate: (t) => uPlot.tzDate(new Date(1e3 * t), "Etc/UTC"),
      width: place.clientWidth, height: HEIGHT, legend: { show: false }, padding: [8, 10, 0, 0],
      cursor: { y: false, drag: { x: false, y: false } },
      scales: { x: { time: one.dates, range: [first - edge, last + edge] },
        y: { range: () => room(Math.min(...one.low), Math.max(...one.high)) } },
      axes: [{ ...axis, grid: { show: false }, values: one.dates ? days : (u, t) => t.map((v) => v + " s") },
        { ...axis, grid: { stroke: css("--rule"), width: 1 }, size: 56, values: (u, t) => t.map((v) => +v.toPrecision(6) + "") }],
      series: [{}, { stroke: css("--strong"), width: 0, paths: () => null, points: { show: true, size: one.times.length > 30 ? 4 : 7, fill: css("--strong") } }],
      hooks: { drawClear: [(u) => span(u, one)], drawAxes: [(u) => { change(u, one); intervals(u, one); }],
        setCursor: [(u) => {
          const i = u.cursor.idx;
          text.textContent = i == null ? "" : digits(one.values[i]) + " (" + digits(one.low[i]) + " to " + digits(one.high[i]) + ")";
        }] },
    }, [one.times, one.values], box));
  }

  function drawAll() {
    for (const old of panels) old.destroy();
    panels = [];
    for (const place of document.querySelectorAll(".timelines")) {
      place.textContent = "";
      const own = found.filter((one) => (one.place || "") === (place.dataset.place || ""));
      const cells = own.map(() => place.appendChild(document.createElement("div")));
      cells.forEach((cell, i) => { cell.className = "channel"; draw(cell, own[i]); });
    }
  }

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  for (const fold of document.querySelectorAll("details")) fold.addEventListener("toggle", drawAll);
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; drawAll(); } });
  drawAll();
})();
