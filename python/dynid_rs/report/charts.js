"use strict";
// Draws the figures of the page with uPlot: one instance per panel, colours from the style sheet.
const Charts = (() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const root = document.documentElement;
  const decoded = new Map();
  const drawn = new Map();
  const Y_AXIS = 46;
  let run = 0;

  function array(key) {
    const name = key.replace("{run}", String(run));
    if (!decoded.has(name)) {
      const bytes = Uint8Array.from(atob(data.arrays[name] ?? ""), (c) => c.charCodeAt(0));
      decoded.set(name, Array.from(new Float32Array(bytes.buffer), (v) => (Number.isNaN(v) ? null : v)));
    }
    return decoded.get(name);
  }

  const figureOf = (element) => data.figures[element.dataset.figure];
  const color = (name) => getComputedStyle(root).getPropertyValue("--" + name).trim();
  const digits = (v) => (v == null ? "" : String(+v.toPrecision(3)).replace(/-/g, "\u2212"));
  const ticks = (u, splits) => splits.map((v) => (v == null ? "" : String(+v.toPrecision(6)).replace(/-/g, "\u2212")));
  const columnsOf = (s) => (s.kind === "band" || s.kind === "whiskers" ? [s.low, s.high] : [s.y]);

  // uPlot wants one sorted x for all series of a panel.
  function table(series) {
    const keys = [...new Set(series.map((s) => s.x))];
    if (keys.length === 1) return [array(keys[0]), ...series.flatMap((s) => columnsOf(s).map(array))];
    const rows = keys.flatMap((key, k) => array(key).map((x, i) => [x, k, i]));
    rows.sort((a, b) => a[0] - b[0]);
    const spread = (s, column) => rows.map(([, k, i]) => (keys[k] === s.x ? array(column)[i] : null));
    return [rows.map((row) => row[0]), ...series.flatMap((s) => columnsOf(s).map((c) => spread(s, c)))];
  }

  // Vertical lines from the low to the high series, which stand one after the other.
  const whiskers = (u, seriesIdx, i0, i1) => {
    const stroke = new Path2D();
    for (let i = i0; i <= i1; i++) {
      const [low, high] = [u.data[seriesIdx][i], u.data[seriesIdx + 1][i]];
      if (low == null || high == null) continue;
      const x = u.valToPos(u.data[0][i], "x", true);
      stroke.moveTo(x, u.valToPos(low, "y", true));
      stroke.lineTo(x, u.valToPos(high, "y", true));
    }
    return { stroke };
  };

  function seriesOf(panel, mixed, k) {
    const shown = [{}];
    const bands = [];
    for (const s of panel.series) {
      const stroke = color(s.color);
      const base = { show: !s.off, width: k * (s.width ?? 1.5), points: { show: false }, spanGaps: mixed };
      if (s.kind === "points") {
        const points = { show: true, size: k * (s.size ?? 4), width: 0, fill: stroke, stroke, space: 0 };
        shown.push({ ...base, stroke, width: 0, paths: () => null, points });
      } else if (s.kind === "band") {
        bands.push({ series: [shown.length + 1, shown.length], fill: stroke });
        shown.push({ ...base, width: 0, stroke: "transparent" }, { ...base, width: 0, stroke: "transparent" });
      } else if (s.kind === "whiskers") {
        shown.push({ ...base, stroke, paths: whiskers }, { ...base, paths: () => null });
      } else if (s.kind === "bars") {
        shown.push({ ...base, width: 0, fill: stroke, stroke, paths: uPlot.paths.bars({ size: [1, 100] }) });
      } else {
        shown.push({ ...base, stroke, dash: s.dash ? [k * 5, k * 4] : undefined });
      }
    }
    return { shown, bands };
  }

  function axis(label, k, more) {
    const font = `${k * 12}px ${getComputedStyle(document.body).fontFamily}`;
    const line = { stroke: color("grid"), width: k };
    return {
      label, font, labelFont: font, labelSize: k * 20, labelGap: 0, gap: k * 5, stroke: color("muted"),
      grid: line, ticks: { ...line, size: k * 4 }, values: ticks, ...more,
    };
  }

  // As wide as the longest number; never narrower than most are, so that charts stand under one another.
  function wide(u, values, k) {
    u.ctx.font = `${k * 12}px ${getComputedStyle(document.body).fontFamily}`;
    const longest = Math.max(0, ...(values ?? []).map((text) => u.ctx.measureText(text).width));
    return Math.max(k * Y_AXIS, Math.ceil(longest + k * 14));
  }

  function options(element, panel, series, width, k) {
    const marks = panel.ticks;
    const x = axis(panel.x, k, { size: k * (panel.x ? 30 : 22), space: k * 56 });
    if (marks) {
      x.splits = () => marks.map(([at]) => at);
      x.values = () => marks.map(([, text]) => text);
      x.grid = { show: false };
    }
    const figure = figureOf(element);
    const range = panel.range && (() => panel.range);
    return {
      width, height: k * panel.height, series: series.shown, bands: series.bands, legend: { show: false },
      padding: [k * 8, k * 20, 0, 0],
      scales: { x: { time: false, range: panel.xrange && (() => panel.xrange) }, y: range ? { range } : {} },
      axes: [x, axis(panel.y, k, { size: (u, values) => wide(u, values, k), space: k * 34 })],
      cursor: {
        sync: { key: figure.kind || element.dataset.figure, scales: ["x", null] },
        drag: { x: true, y: false, setScale: true }, y: false, points: { show: false },
      },
      hooks: {
        setCursor: [(u) => read(element, u)],
        // The line at zero, where it is within the panel.
        drawAxes: [(u) => {
          const { min, max } = u.scales.y;
          if (!(min < 0 && max > 0)) return;
          const y = Math.round(u.valToPos(0, "y", true)) + 0.5;
          u.ctx.save();
          u.ctx.strokeStyle = color("axis");
          u.ctx.lineWidth = k;
          u.ctx.beginPath();
          u.ctx.moveTo(u.bbox.left, y);
          u.ctx.lineTo(u.bbox.left + u.bbox.width, y);
          u.ctx.stroke();
          u.ctx.restore();
        }],
        draw: [(u) => mark(u, panel.marks ?? [], k)],
      },
    };
  }

  // Vertical lines with a word beside them, where that does not hide another word.
  function mark(u, marks, k) {
    const { left, top, width, height } = u.bbox;
    let free = left;
    u.ctx.save();
    u.ctx.font = `${k * 11 * devicePixelRatio}px ${getComputedStyle(document.body).fontFamily}`;
    for (const { x, color: name, text, dash } of marks) {
      const at = Math.round(u.valToPos(x, "x", true)) + 0.5;
      if (at < left || at > left + width) continue;
      u.ctx.strokeStyle = u.ctx.fillStyle = color(name);
      u.ctx.lineWidth = k * devicePixelRatio * (dash ? 1 : 1.6);
      u.ctx.setLineDash(dash ? [k * 4, k * 4] : []);
      u.ctx.beginPath();
      u.ctx.moveTo(at, top);
      u.ctx.lineTo(at, top + height);
      u.ctx.stroke();
      if (!text || at < free) continue;
      Object.assign(u.ctx, { textBaseline: "top", textAlign: "left" });
      u.ctx.fillText(text, at + k * 4, top + k * 3);
      free = at + k * 8 + u.ctx.measureText(text).width;
    }
    u.ctx.restore();
  }

  // What stands at the cursor, in words; the nearest value of a series that has none right there.
  function read(element, u) {
    const out = element.nextElementSibling;
    const at = u.cursor.idx;
    if (at == null || !u.cursor.left || u.cursor.left < 0) return;
    const panels = figureOf(element).panels;
    const said = drawn.get(element)?.flatMap((plot, p) => {
      let column = 1;
      return panels[p].series.flatMap((s) => {
        const own = column;
        column += columnsOf(s).length;
        if (!plot.series[own].show || s.quiet) return [];
        const value = nearest(plot.data[own], plot === u ? at : plot.posToIdx(u.cursor.left));
        if (value == null) return [];
        const high = columnsOf(s).length > 1 ? ` to ${digits(nearest(plot.data[own + 1], at))}` : "";
        return [`${s.name} ${digits(value)}${high}`];
      });
    });
    if (said?.length) out.textContent = `at ${digits(u.data[0][at])}: ${said.join(", ")}`;
  }

  function nearest(values, at) {
    for (let d = 0; d < 40; d++) {
      const value = values[at - d] ?? values[at + d];
      if (value != null) return value;
    }
    return null;
  }

  // `k`: pixels are drawn so many times as large and shown smaller, for paper.
  function draw(element, { width = element.clientWidth, k = 1 } = {}) {
    drawn.get(element)?.forEach((plot) => plot.destroy());
    element.replaceChildren();
    const hidden = new Set(
      [...document.querySelectorAll("input[data-term]")].filter((box) => !box.checked).map((box) => box.dataset.term)
    );
    const plots = figureOf(element).panels.map((panel) => {
      const columns = table(panel.series);
      const mixed = new Set(panel.series.map((s) => s.x)).size > 1;
      const termed = panel.series.map((s) => ({ ...s, off: s.term ? hidden.has(s.term) : s.off }));
      const inside = document.createElement("div");
      element.append(inside);
      const series = seriesOf({ ...panel, series: termed }, mixed, k);
      const plot = new uPlot(options(element, panel, series, k * width, k), columns, inside);
      if (k !== 1) Object.assign(plot.root.style, { zoom: 1 / k });
      return plot;
    });
    drawn.set(element, plots);
    if (!element.dataset.watched) {
      element.dataset.watched = "yes";
      resized.observe(element);
      element.addEventListener("keydown", (event) => steer(element, event));
    }
  }

  const resized = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      if (contentRect.width < 1 || root.classList.contains("print")) continue;
      drawn.get(target)?.forEach((plot, p) => {
        if (Math.abs(plot.width - contentRect.width) < 1) return;
        plot.setSize({ width: contentRect.width, height: figureOf(target).panels[p].height });
      });
    }
  });

  const linked = (element) => {
    const kind = figureOf(element).kind;
    const others = [...drawn].filter(([e]) => e === element || (kind && figureOf(e).kind === kind));
    return others.flatMap(([, plots]) => plots);
  };

  // The keyboard does what the mouse does: arrows move along the chart, + and - zoom, 0 shows all of it.
  function steer(element, event) {
    const plot = drawn.get(element)?.[0];
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const zoom = { "+": 0.5, "=": 0.5, "-": 2, "0": Infinity }[event.key];
    if (!plot || event.ctrlKey || event.metaKey || (step === undefined && zoom === undefined)) return;
    event.preventDefault();
    const wide = plot.over.clientWidth;
    const at = plot.cursor.left >= 0 ? plot.cursor.left : wide / 2;
    element.nextElementSibling.setAttribute("aria-live", "polite");
    if (step) plot.setCursor({ left: Math.min(wide, Math.max(1, at + (step * wide) / 50)), top: 5 });
    if (zoom) {
      const x = plot.data[0];
      const { min, max } = plot.scales.x;
      const middle = plot.posToVal(at, "x");
      const low = Math.max(x[0], middle - (zoom * (max - min)) / 2);
      const high = Math.min(x[x.length - 1], middle + (zoom * (max - min)) / 2);
      linked(element).forEach((other) => other.setScale("x", { min: low, max: high }));
    }
  }

  // The drawn numbers as a table, some rows of them.
  function numbers(key) {
    const head = [];
    const columns = [];
    for (const panel of data.figures[key].panels) {
      const own = table(panel.series);
      if (!columns.length) { head.push(panel.x || "x"); columns.push(own[0]); }
      if (own[0].length !== columns[0].length) continue;
      panel.series.forEach((s) => head.push(...columnsOf(s).map((_, i, all) => s.name + (all.length > 1 ? [" from", " to"][i] : ""))));
      columns.push(...own.slice(1));
    }
    const n = columns[0].length;
    const rows = Array.from({ length: Math.min(n, 25) }, (_, i) => Math.round((i * (n - 1)) / Math.max(1, Math.min(n, 25) - 1)));
    return { head, rows: rows.map((r) => columns.map((c) => digits(nearest(c, r)))) };
  }

  return {
    draw, drawn, figureOf, numbers,
    run: (index) => { run = index; },
  };
})();
