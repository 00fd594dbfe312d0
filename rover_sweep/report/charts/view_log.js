// Two selects: any channel against time, or against another channel (as dots, at the times of the first).
"use strict";
(function () {
  const channels = JSON.parse(document.getElementById("channels").textContent), names = Object.keys(channels);
  const [up, second, across] = ["up", "second", "across"].map(id => document.getElementById(id)), unpacked = {};
  function signal(name) {
    const c = channels[name];
    return unpacked[name] || (unpacked[name] = { t: sweepCharts.numbers(c.t, 4), x: sweepCharts.numbers(c.x, 4), hold: c.hold });
  }
  function words(name) { return name + (channels[name].unit ? ", " + channels[name].unit : ""); }
  function at(s, times) {  // the values at ascending times; null outside of the record
    let k = 0;
    return times.map(t => {
      while (k < s.t.length - 2 && s.t[k + 1] <= t) k++;
      if (t < s.t[0] || t > s.t[s.t.length - 1]) return null;
      if (s.hold || s.x[k + 1] == null || s.x[k] == null) return s.x[k];
      return s.x[k] + (s.x[k + 1] - s.x[k]) * Math.min((t - s.t[k]) / (s.t[k + 1] - s.t[k]), 1);
    });
  }
  function panel(name, colour) {
    const s = signal(name), over = across.value;
    let x = s.t, y = s.x;
    if (over) {
      const found = at(signal(over), s.t);
      const pairs = found.map((v, i) => [v, y[i]]).filter(p => p[0] != null && p[1] != null).sort((a, b) => a[0] - b[0]);
      x = pairs.map(p => p[0]); y = pairs.map(p => p[1]);
    }
    const known = y.filter(v => v != null), low = known.reduce((a, b) => Math.min(a, b), Infinity);
    const high = known.reduce((a, b) => Math.max(a, b), -Infinity), spare = 0.06 * (high - low) || 0.5;
    return { label: words(name), height: 240, limits: known.length ? [low - spare, high + spare] : [0, 1], levels: [], spreads: [],
      values: [x, y], lines: [{ label: words(name), colour: colour, dash: [], width: 1.2, step: s.hold, dots: !!over }] };
  }
  function draw() {
    const place = document.getElementById("view");
    place.textContent = "";
    const panels = [panel(up.value, "#0072B2")];
    if (second.value) panels.push(panel(second.value, "#D55E00"));
    const ends = panels.map(p => p.values[0]).filter(x => x.length);
    if (!ends.length) { place.textContent = "These channels were never recorded at the same time."; return; }
    const span = [Math.min(...ends.map(x => x[0])), Math.max(...ends.map(x => x[x.length - 1]))];
    if (span[0] === span[1]) span[1] += 1;
    const label = across.value ? words(across.value) : "time since start of the log, s";
    sweepCharts.build({ title: "", xLabel: label, kind: "linear", span: span, shades: [], marks: [], panels: panels }, place);
  }
  for (const name of names) for (const s of [up, second, across]) s.add(new Option(words(name), name));
  across.add(new Option("time, s", ""), 0);
  second.add(new Option("nothing else", ""), 0);
  up.value = names.includes("r") ? "r" : names[0];
  second.value = names.includes("pwm") ? "pwm" : "";
  across.value = "";
  for (const s of [up, second, across]) s.onchange = draw;
  draw();
})();
