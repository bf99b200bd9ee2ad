"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const root = document.documentElement;
  const decoded = new Map();
  const drawn = new Map();
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const hover = window.matchMedia("(hover: hover)").matches;
  let run = 0;
  let linking = false;

  // Text from the files is never looked up as a colour or an array.
  const TEXT_KEYS = new Set(["text", "name"]);

  function array(key) {
    if (!decoded.has(key)) {
      const bytes = Uint8Array.from(atob(data.arrays[key]), (c) => c.charCodeAt(0));
      decoded.set(key, new Float32Array(bytes.buffer));
    }
    return decoded.get(key);
  }

  function resolve(value, color) {
    if (typeof value === "string") {
      if (value.startsWith("$")) return color(value.slice(1));
      if (value.startsWith("@")) return array(value.slice(1).replace("{run}", String(run)));
      return value;
    }
    if (Array.isArray(value)) return value.map((item) => resolve(item, color));
    if (value && typeof value === "object") {
      return Object.fromEntries(
        Object.entries(value).map(([key, item]) => [key, TEXT_KEYS.has(key) ? item : resolve(item, color)])
      );
    }
    return value;
  }

  function palette() {
    const style = getComputedStyle(root);
    return (name) => style.getPropertyValue("--" + name).trim();
  }

  function layoutOf(figure, color) {
    const layout = resolve(figure.layout, color);
    const small = { size: 11, color: color("muted") };
    for (const [name, axis] of Object.entries(layout)) {
      if (!/^[xy]axis\d*$/.test(name)) continue;
      // A list of texts stands under "text" so that it is never looked up.
      if (axis.ticktext) axis.ticktext = axis.ticktext.text;
      layout[name] = {
        automargin: true, zeroline: false, linecolor: color("line"), gridcolor: color("grid"),
        zerolinecolor: color("axis"), tickfont: small, exponentformat: "power", fixedrange: touch, ...axis,
        title: { font: small, standoff: 6, ...axis.title },
      };
    }
    return {
      autosize: true, showlegend: false, uirevision: "keep", dragmode: touch ? false : "zoom",
      margin: { l: 8, r: 8, t: 8, b: 8 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: color("ink") },
      hoverlabel: { bgcolor: color("card"), bordercolor: color("line"), font: { color: color("ink"), size: 12 } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: color("faint"), activecolor: color("blue") },
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", font: small },
      ...layout,
    };
  }

  const hidden = () =>
    new Set([...document.querySelectorAll("input[data-term]")].filter((box) => !box.checked).map((box) => box.dataset.term));

  function draw(element) {
    const figure = data.figures[element.dataset.figure];
    const color = palette();
    const off = hidden();
    const traces = resolve(figure.traces, color);
    for (const trace of traces) if (trace.meta) trace.visible = !off.has(trace.meta);
    // A list of buttons, not a list of removals: plotly's own default offers to send the data away.
    const config = {
      displaylogo: false, displayModeBar: hover && !touch ? "hover" : false,
      showSendToCloud: false, plotlyServerURL: "", modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
    };
    const layout = layoutOf(figure, color);
    const size = drawn.get(element);
    if (size) Object.assign(layout, size);
    const first = !drawn.has(element);
    if (first) drawn.set(element, null);
    Plotly.react(element, traces, layout, config);
    if (first) resized.observe(element);
    if (first && figure.kind === "time") element.on("plotly_relayout", (change) => follow(element, change));
  }

  // Plotly's own `responsive` hears the window only; a column also changes with its neighbours.
  const resized = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      const shown = contentRect.width > 0 && !drawn.get(target);
      if (shown && Math.abs(contentRect.width - target.querySelector(".main-svg").width.baseVal.value) >= 1) Plotly.Plots.resize(target);
    }
  });

  // One zoom in time moves the time axis of every joint.
  function follow(source, change) {
    if (linking) return;
    const moved = Object.keys(change).some((key) => key.startsWith("xaxis."));
    if (!moved) return;
    const axis = source.layout.xaxis;
    const update = axis.autorange ? { "xaxis.autorange": true } : { "xaxis.range": [...axis.range] };
    linking = true;
    const others = [...drawn.keys()].filter((e) => e !== source && data.figures[e.dataset.figure].kind === "time");
    Promise.all(others.map((element) => Plotly.relayout(element, update))).finally(() => { linking = false; });
  }

  const redraw = (keep = () => true) => [...drawn.keys()].filter(keep).forEach(draw);
  const isTime = (element) => data.figures[element.dataset.figure].kind === "time";

  // Plots are drawn one by one, so that the page answers at once; those in closed parts wait.
  const queue = [...document.querySelectorAll(".plot")].filter((element) => !element.closest("details:not([open])"));
  function next() {
    const element = queue.shift();
    if (!element) { root.dataset.plots = "drawn"; return; }
    draw(element);
    setTimeout(next, 0);
  }

  function sortTable(button) {
    const head = button.closest("th");
    const body = head.closest("table").tBodies[0];
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of head.parentNode.children) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const value = (row) => {
      const cell = row.cells[head.cellIndex];
      return cell.classList.contains("num") ? Number(cell.dataset.value ?? "NaN") : cell.textContent;
    };
    const compare = (a, b) => {
      if (typeof a === "string") return a.localeCompare(b, undefined, { numeric: true });
      return Number.isNaN(a) - Number.isNaN(b) || a - b;
    };
    body.append(...[...body.rows].sort((a, b) => (up ? 1 : -1) * compare(value(a), value(b))));
  }

  document.querySelectorAll("input[data-term]").forEach((box) => box.addEventListener("change", () => redraw(isTime)));
  document.querySelector("select[data-run]")?.addEventListener("change", (event) => {
    run = Number(event.target.value);
    redraw(isTime);
    for (const element of drawn.keys()) {
      if (isTime(element)) Plotly.relayout(element, { "xaxis.autorange": true, "yaxis.autorange": true, "yaxis2.autorange": true });
    }
  });
  document.querySelectorAll("table.sortable thead button").forEach((b) => b.addEventListener("click", () => sortTable(b)));
  document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", () => {
    if (part.open) part.querySelectorAll(".plot").forEach((element) => { if (!drawn.has(element)) draw(element); });
  }));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw());

  // On paper: light colours, everything unfolded, plots as wide as the column they print in.
  const PRINT_WIDTH = { half: 330, full: 680 };
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details:not(.name)").forEach((part) => { part.dataset.was = part.open; part.open = true; });
    root.classList.add("print");
    document.querySelectorAll(".plot").forEach((element) => {
      drawn.set(element, { width: element.classList.contains("wide") ? PRINT_WIDTH.full : PRINT_WIDTH.half });
      draw(element);
    });
  });
  window.addEventListener("afterprint", () => {
    root.classList.remove("print");
    for (const element of drawn.keys()) {
      drawn.set(element, null);
      delete element.layout.width;
    }
    document.querySelectorAll("details[data-was]").forEach((part) => { part.open = part.dataset.was === "true"; });
    redraw((element) => element.offsetParent !== null);
  });

  root.dataset.plots = "drawing";
  next();
})();
