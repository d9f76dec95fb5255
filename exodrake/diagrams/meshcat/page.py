"""The page around a recording: title, tension scale, live readings; `#t=1.5` in the address stops there."""

from __future__ import annotations

import json
from html import escape

import numpy as np

# tension as a share of F_max -> sRGB; slack is grey
STOPS = ((0.0, (0.55, 0.60, 0.67)), (0.35, (0.96, 0.76, 0.22)), (0.7, (0.91, 0.36, 0.13)), (1.0, (0.69, 0.02, 0.15)))

PAGE = """
<style>
  .exo { position: fixed; font: 13px/1.5 system-ui, sans-serif; color: #223; background: rgba(255,255,255,.82);
         border-radius: 6px; padding: 10px 14px; pointer-events: none; }
  #exo-title { left: 16px; top: 14px; } #exo-title b { font-size: 17px; }
  #exo-now { left: 16px; bottom: 16px; font-variant-numeric: tabular-nums; }
  #exo-now td { padding: 0 10px 0 0; } #exo-now td.n { text-align: right; min-width: 3.6em; }
  #exo-now .bar { width: 110px; } #exo-now .bar div { height: 8px; border-radius: 3px; }
  .scale { width: 200px; height: 9px; border-radius: 3px; margin-top: 5px; }
  .ends { display: flex; justify-content: space-between; width: 200px; }
</style>
<div class="exo" id="exo-title"><b>TITLE</b><br>colour of a wire: its tension
  <div class="scale" style="background: linear-gradient(90deg, GRADIENT)"></div>
  <div class="ends"><span>slack</span><span>F<sub>max</sub></span></div></div>
<div class="exo" id="exo-now"></div>
<script type="text/javascript">
  (function () {
    const data = DATA;
    const stops = STOPS;
    function colour(x) {
      let k = 1;
      while (k < stops.length - 1 && x > stops[k][0]) k++;
      const [x0, c0] = stops[k - 1], [x1, c1] = stops[k];
      const u = Math.min(1, Math.max(0, (x - x0) / (x1 - x0)));
      return "rgb(" + c0.map((c, i) => Math.round(255 * (c + u * (c1[i] - c)))).join(",") + ")";
    }
    const cell = (name, value) => "<td>" + name + '</td><td class="n">' + value + "</td>";
    function show(t) {
      const k = Math.min(data.time.length - 1, Math.max(0, Math.round((t - data.time[0]) / data.step)));
      let rows = "<tr><td colspan=3><b>" + data.time[k].toFixed(2) + " s</b></td></tr>";
      data.wires.forEach((w, j) => {
        const share = data.tension[k][j] / data.top[j];
        const width = Math.round(110 * Math.min(1, Math.max(0.02, share)));
        rows += "<tr>" + cell(w, data.tension[k][j].toFixed(1) + " N") + '<td class="bar"><div style="width:' +
          width + "px;background:" + colour(share) + '"></div></td></tr>';
      });
      data.joints.forEach((q, i) => {
        rows += "<tr>" + cell(q, data.angle[k][i].toFixed(2) + " rad") + "<td></td></tr>";
      });
      document.getElementById("exo-now").innerHTML = "<table>" + rows + "</table>";
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
</script>
"""


def colours(share: np.ndarray) -> np.ndarray:
    """Colours (n, 3), linear RGB as Meshcat's materials take them, of tensions as shares of F_max (n,)."""
    at = np.array([x for x, _ in STOPS])
    srgb = np.column_stack([np.interp(share, at, [rgb[i] for _, rgb in STOPS]) for i in range(3)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # the sRGB standard's curve


def dressed(html: str, title: str, readings: dict) -> str:
    """A Meshcat page with title, scale and live readings (time, step, wires, joints, tension, angle, top)."""
    gradient = ", ".join(
        f"rgb({', '.join(str(round(255 * c)) for c in rgb)}) {round(100 * share)}%" for share, rgb in STOPS
    )
    page = PAGE.replace("TITLE", escape(title)).replace("GRADIENT", gradient)
    page = page.replace("= STOPS", f"= {json.dumps(STOPS)}").replace("= DATA", f"= {json.dumps(readings)}")
    html = html.replace("<title>Drake MeshCat</title>", f"<title>{escape(title)}</title>")
    head, end, tail = html.rpartition("</body>")
    return head + page + end + tail
