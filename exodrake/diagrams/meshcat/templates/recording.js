(function () {
  const data = exoReadings, stops = exoStops;

  // Colour of a tension as a share of F_max, interpolated between the stops.
  function colour(share) {
    let k = 1;
    while (k < stops.length - 1 && share > stops[k][0]) k++;
    const [x0, c0] = stops[k - 1], [x1, c1] = stops[k];
    const u = Math.min(1, Math.max(0, (share - x0) / (x1 - x0)));
    return "rgb(" + c0.map((c, i) => Math.round(255 * (c + u * (c1[i] - c)))).join(",") + ")";
  }

  function cell(row, text, name) {
    const made = row.insertCell();
    made.textContent = text;
    made.className = name || "";
    return made;
  }

  function bar(made, share) {
    const inner = document.createElement("div");
    made.className = "bar";
    inner.style.width = Math.round(110 * Math.min(1, Math.max(0.02, share))) + "px";
    inner.style.background = colour(share);
    made.appendChild(inner);
  }

  // The readings at time t [s] of the recording.
  function show(t) {
    const k = Math.min(data.time.length - 1, Math.max(0, Math.round((t - data.time[0]) / data.step)));
    const table = document.createElement("table");
    cell(table.insertRow(), data.time[k].toFixed(2) + " s");
    data.tendons.forEach((name, j) => {
      const row = table.insertRow();
      cell(row, name);
      cell(row, data.tension[k][j].toFixed(1) + " N", "n");
      bar(row.insertCell(), data.tension[k][j] / data.top[j]);
    });
    data.joints.forEach((name, i) => {
      const row = table.insertRow();
      cell(row, name);
      cell(row, (data.angle[k][i] * 180 / Math.PI).toFixed(0) + "°", "n");
    });
    document.getElementById("exo-now").replaceChildren(table);
  }

  const asked = /t=([0-9.]+)/.exec(location.hash);
  let waiting = asked !== null;
  (function tick() {
    const animator = viewer.animator;
    if (waiting && animator.actions.length) {
      animator.pause();
      animator.seek(parseFloat(asked[1]));
      animator.display_progress(parseFloat(asked[1]));
      waiting = false;
    }
    show(data.time[0] + animator.time);
    requestAnimationFrame(tick);
  })();
})();
