// Draws the charts of the page from its JSON with uPlot; loads nothing.
"use strict";
(function (root) {
  function numbers(text, bytes) {
    const raw = atob(text), buffer = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) buffer[i] = raw.charCodeAt(i);
    const floats = bytes === 8 ? new Float64Array(buffer.buffer) : new Float32Array(buffer.buffer);
    return Array.from(floats, v => Number.isFinite(v) ? v : null);
  }
  function words(v) {
    if (v == null) return "";  // the legend before the cursor is in the chart
    const a = Math.abs(v);
    return a !== 0 && (a < 0.001 || a >= 1e6) ? v.toExponential(2) : String(+v.toPrecision(4));
  }
  function day(v) { return v == null ? "" : new Date(v * 1000).toISOString().slice(0, 10); }
  function decades(low, high) {
    const out = [];
    for (let e = -4; e < 5; e++) for (const m of [1, 2, 5]) {
      const x = m * Math.pow(10, e);
      if (x >= low && x <= high) out.push(x);
    }
    return out.length > 1 ? out : [low, high];
  }
  root.sweepCharts = { numbers: numbers, words: words, decades: decades };
  if (typeof document === "undefined") return;

  function element(tag, name, text) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text) made.textContent = text;
    return made;
  }
  function backdrop(stack, panel) {
    return u => {
      const c = u.ctx, { left, top, width, height } = u.bbox;
      c.save(); c.beginPath(); c.rect(left, top, width, height); c.clip();
      for (const [a, b, colour] of stack.shades) {
        const x0 = u.valToPos(Math.max(a, u.scales.x.min), "x", true);
        const x1 = u.valToPos(Math.min(b, u.scales.x.max), "x", true);
        if (x1 > x0) { c.fillStyle = colour; c.fillRect(x0, top, x1 - x0, height); }
      }
      c.lineWidth = Math.max(1, devicePixelRatio);
      for (const [x, colour] of stack.marks) {
        const at = u.valToPos(x, "x", true);
        c.strokeStyle = colour; c.beginPath(); c.moveTo(at, top); c.lineTo(at, top + height); c.stroke();
      }
      c.strokeStyle = "#777"; c.setLineDash([6, 4]);
      for (const y of panel.levels) {
        const at = u.valToPos(y, "y", true);
        c.beginPath(); c.moveTo(left, at); c.lineTo(left + width, at); c.stroke();
      }
      c.restore();
    };
  }
  function options(stack, panel, width, key, last, moved) {
    const log = stack.kind === "log", dates = stack.kind === "date", names = stack.kind === "words";
    const across = v => dates ? day(v) : names ? stack.labels[Math.round(v)] || "" : words(v);
    const series = [{ label: "at", class: last ? "at" : "edge", value: (u, v) => v == null ? "" : across(v) }], bands = [];
    for (const s of panel.spreads) {
      for (const end of ["high", "low"])
        series.push({ label: s.label + ", " + end, class: "edge", stroke: s.colour, width: 0, points: { show: false }, value: (u, v) => words(v) });
      bands.push({ series: [series.length - 2, series.length - 1], fill: s.colour + "AA" });
    }
    for (const l of panel.lines) {
      series.push({
        label: l.label, stroke: l.colour, width: l.dots ? 0 : l.width, dash: l.dash.length ? l.dash : undefined,
        fill: l.bars ? l.colour : undefined,
        paths: l.bars ? uPlot.paths.bars({ size: [0.5, 60] }) : l.dots ? () => null : l.step ? uPlot.paths.stepped({ align: 1 }) : undefined,
        points: l.dots ? { show: true, size: panel.values ? 3 : 6, fill: l.colour } : { show: false }, value: (u, v) => words(v),
      });
    }
    const [low, high] = stack.span;
    const whole = (a, b) => a <= low + 1e-6 * (high - low) && b >= high - 1e-6 * (high - low);
    return {
      width: width, height: panel.height + 46, series: series, bands: bands,
      scales: {
        x: { time: false, distr: log ? 3 : 1, range: (u, a, b) => u.asked || [low, high] },
        y: { range: (u, a, b) => {
          const x = u.scales.x;
          if (a == null || x.min == null || whole(x.min, x.max)) return panel.limits;
          const spare = 0.08 * (b - a) || 0.5;
          return [a - spare, b + spare];
        } },
      },
      axes: [
        { show: true, size: 30, gap: 2, ticks: { size: 4 }, stroke: "#444", font: "12px system-ui",
          splits: log ? (u, i, a, b) => decades(a, b) : names ? () => stack.labels.map((_, k) => k) : undefined, filter: (u, s) => s, space: 45,
          values: (u, v) => v.map(x => dates ? day(x).slice(5) : across(x)) },
        { size: 52, gap: 2, label: panel.label, labelSize: 18, labelGap: 0, stroke: "#444", space: 24, ticks: { size: 4 },
          font: "12px system-ui", labelFont: "12px system-ui", values: (u, v) => v.map(words) },
      ],
      cursor: { sync: { key: key, scales: ["x", null] }, drag: { x: true, y: false, setScale: false }, points: { size: 6 } },
      legend: { live: true },
      hooks: { drawAxes: [backdrop(stack, panel)], setSelect: [u => {
        if (u.select.width < 4) return;
        const range = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
        u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        moved(range);
      }] },
    };
  }
  let count = 0;
  function build(stack, place) {
    const box = element("div", "chart-stack"), key = "stack" + count++, plots = [];
    const [low, high] = stack.span, log = stack.kind === "log";
    const to = v => log ? Math.log(v) : v, from = v => log ? Math.exp(v) : v;
    let shown = [low, high];
    function show(range) {
      let [a, b] = range.map(to);
      const A = to(low), B = to(high), length = Math.min(Math.max(b - a, (B - A) * 1e-4), B - A);
      a = Math.min(Math.max(a, A), B - length);
      shown = a === A && length === B - A ? [low, high] : [from(a), from(a + length)];
      for (const u of plots) { u.asked = shown; u.setScale("x", { min: shown[0], max: shown[1] }); }
    }
    function zoom(factor, at) {
      const [a, b] = shown.map(to), middle = at == null ? (a + b) / 2 : to(at);
      show([from(middle - (middle - a) * factor), from(middle + (b - middle) * factor)]);
    }
    function shift(share) {
      const [a, b] = shown.map(to), d = share * (b - a);
      show([from(a + d), from(b + d)]);
    }
    const tools = element("div", "chart-tools");
    tools.append(element("h4", "", stack.title));
    const buttons = element("span");
    buttons.style.marginLeft = "auto";
    for (const [text, hint, act] of [["◀", "earlier", () => shift(-0.4)], ["▶", "later", () => shift(0.4)],
      ["+", "zoom in", () => zoom(0.5)], ["−", "zoom out", () => zoom(2)], ["all", "whole range", () => show([low, high])]]) {
      const b = element("button", "", text);
      b.type = "button"; b.title = hint; b.setAttribute("aria-label", hint); b.onclick = act;
      buttons.append(b);
    }
    tools.append(buttons);
    box.append(tools);
    place.append(box);
    const width = () => Math.max(260, box.clientWidth);
    stack.panels.forEach((panel, i) => {
      const data = panel.values || [numbers(panel.x, panel.bytes)];
      for (const s of panel.spreads) data.push(numbers(s.high, 4), numbers(s.low, 4));
      if (!panel.values) for (const l of panel.lines) data.push(numbers(l.y, 4));
      const u = new uPlot(options(stack, panel, width(), key, i === stack.panels.length - 1, show), data, box);
      u.over.addEventListener("dblclick", () => show([low, high]));
      u.over.addEventListener("wheel", e => {
        if (!e.ctrlKey && !e.shiftKey) return;  // the plain wheel scrolls the page
        e.preventDefault();
        zoom((e.deltaY || e.deltaX) > 0 ? 1.25 : 0.8, u.posToVal(e.offsetX, "x"));
      }, { passive: false });
      touch(u, () => shown, to, from, show);
      plots.push(u);
    });
    box.append(element("p", "axis-name", stack.xLabel));
    new ResizeObserver(() => plots.forEach(u => { if (Math.abs(u.width - width()) > 2) u.setSize({ width: width(), height: u.height }); })).observe(box);
  }
  function touch(u, shown, to, from, show) {
    let start = null;
    const at = e => Array.from(e.touches, t => (t.clientX - u.over.getBoundingClientRect().left) / u.over.clientWidth);
    // between the fingers in px, in any direction: fingers above each other must not zoom without end
    const apart = e => e.touches.length < 2 ? 1 : Math.max(24, Math.hypot(e.touches[1].clientX - e.touches[0].clientX, e.touches[1].clientY - e.touches[0].clientY));
    const begin = e => ({ at: at(e), apart: apart(e), range: shown().map(to) });
    u.over.addEventListener("touchstart", e => { start = begin(e); }, { passive: true });
    u.over.addEventListener("touchmove", e => {
      const now = at(e), [a, b] = start.range, d = b - a;
      if (now.length !== start.at.length) { start = begin(e); return; }
      if (now.length === 2) {
        e.preventDefault();
        const length = d * start.apart / apart(e), middle = p => (p[0] + p[1]) / 2;
        const left = a + d * middle(start.at) - length * middle(now);
        show([from(left), from(left + length)]);
      } else if (now.length === 1) {
        const move = (start.at[0] - now[0]) * d;
        show([from(a + move), from(b + move)]);
      }
    }, { passive: false });
  }
  function fill(figure) {
    if (figure.dataset.made) return;
    figure.dataset.made = "1";
    const chart = JSON.parse(figure.querySelector("script").textContent);
    const place = figure.querySelector(".chart");
    const rows = element("div", "chart-rows" + (chart.columns === 3 ? " three" : chart.columns === 2 ? " two" : ""));
    place.append(rows);
    place.classList.add("drawn");
    for (const stack of chart.stacks) build(stack, rows);
  }
  root.sweepCharts.build = build;
  function start() {
    const figures = document.querySelectorAll("figure[data-chart]");
    if (!("IntersectionObserver" in root)) { figures.forEach(fill); return; }
    const seen = new IntersectionObserver(entries => {
      for (const e of entries) if (e.isIntersecting) { seen.unobserve(e.target); fill(e.target); }
    }, { rootMargin: "600px" });
    figures.forEach(f => seen.observe(f));
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start); else start();
})(typeof window === "undefined" ? globalThis : window);
