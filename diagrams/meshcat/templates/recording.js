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

  const degrees = (angle) => (angle * 180 / Math.PI).toFixed(0) + "°";
  const place = (value, i) => data.sliding[i] ? (1000 * value).toFixed(0) + " mm" : degrees(value);
  const at = (t) => Math.min(data.time.length - 1, Math.max(0, Math.round((t - data.time[0]) / data.step)));

  // The readings at time t [s] of the recording.
  function show(t) {
    const k = at(t), table = document.createElement("table");
    const barOf = (row, j) => bar(row.insertCell(), Math.abs(data.load[k][j]) / data.top[j]);
    const own = data.tendons.join() === data.joints.join(); // loads are those of the joints
    if (!own) data.tendons.forEach((name, j) => {
      const row = table.insertRow();
      cell(row, name);
      cell(row, data.load[k][j].toFixed(1) + " " + data.unit, "n");
      barOf(row, j);
    });
    data.joints.forEach((name, i) => {
      const row = table.insertRow();
      cell(row, name);
      cell(row, place(data.angle[k][i], i), "n");
      if (own && !data.one) cell(row, data.load[k][i].toFixed(1) + " " + data.unit, "n");
      if (own) barOf(row, i);
      if (data.ghost.length) cell(row, data.names[1] + " " + place(data.ghost[k][i], i), "g");
    });
    document.getElementById("exo-now").replaceChildren(table);
  }

  // The names of the joints beside or above them, where the camera sees these.
  const names = document.querySelectorAll(".exo-joint");
  const joints = data.paths.map((path) => viewer.scene_tree.find(path).object);
  const times = (m, v) => [0, 1, 2, 3].map((i) => v.reduce((sum, x, j) => sum + m[4 * j + i] * x, 0));
  function label() {
    const camera = viewer.camera, used = [];
    joints.forEach((joint, i) => {
      const at = [...joint.matrixWorld.elements.slice(12, 15), 1];
      const [x, y, , w] = times(camera.projectionMatrix.elements, times(camera.matrixWorldInverse.elements, at));
      const left = innerWidth * (1 + x / w) / 2 + (data.above ? -names[i].offsetWidth / 2 : 22);
      let top = innerHeight * (1 - y / w) / 2 - (data.above ? 46 : 26);
      for (let k = 0; k < 20 && used.some(([l, t]) => Math.abs(l - left) < 40 && Math.abs(t - top) < 16); k++) top -= 4;
      used.push([left, top]);
      names[i].style.transform = "translate(" + left + "px," + top + "px)";
    });
  }

  // In narrow windows the picture shrinks, so that the robot stays inside.
  function fit() {
    viewer.camera.zoom = Math.min(1, innerWidth / innerHeight / 1.2);
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
  }
  addEventListener("resize", () => setTimeout(fit));

  const animator = viewer.animator;
  const button = document.getElementById("exo-button"), slider = document.getElementById("exo-slider");
  const clock = document.getElementById("exo-time"), ghost = document.getElementById("exo-ghost");

  function seek(t) {
    animator.seek(t);
    animator.display_progress(t);
  }

  function toggle() {
    if (animator.playing) animator.pause();
    else animator.play();
  }

  button.addEventListener("click", toggle);
  slider.addEventListener("input", () => { animator.pause(); seek(parseFloat(slider.value)); });
  document.getElementById("exo-speed").addEventListener("change", (event) => {
    animator.mixer.timeScale = parseFloat(event.target.value);
  });
  if (ghost) ghost.addEventListener("change", () => {
    viewer.scene_tree.find(["ghost"]).object.visible = ghost.checked;
    viewer.set_dirty();
  });
  document.addEventListener("keydown", (event) => {
    if (["BUTTON", "INPUT", "SELECT"].includes(event.target.tagName)) return;
    const step = { ArrowLeft: -data.step, ArrowRight: data.step }[event.key];
    if (event.key === " ") toggle();
    else if (step) { animator.pause(); seek(Math.min(animator.duration, Math.max(0, animator.time + step))); }
    else return;
    event.preventDefault();
  });

  const asked = /t=([0-9.]+)/.exec(location.hash);
  let waiting = asked !== null, fitted = null;
  (function tick() {
    if (waiting && animator.actions.length) {
      animator.pause();
      seek(parseFloat(asked[1]));
      waiting = false;
    }
    if (viewer.camera !== fitted) { fitted = viewer.camera; fit(); }
    label();
    const last = data.time[data.time.length - 1];
    slider.max = animator.duration || 1;
    if (document.activeElement !== slider || animator.playing) slider.value = animator.time;
    button.textContent = animator.playing ? "\u275A\u275A pause" : "\u25B6 play";
    clock.textContent = (data.time[0] + animator.time).toFixed(2) + " s of " + last.toFixed(2) + " s";
    show(data.time[0] + animator.time);
    requestAnimationFrame(tick);
  })();
})();
