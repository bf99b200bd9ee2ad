"use strict";
// What the reader can do with the page: choose curves and runs, unfold, sort, print.
(() => {
  const root = document.documentElement;
  const { draw, drawn, figureOf } = Charts;
  const isTime = (element) => figureOf(element).kind === "time";
  const redraw = (keep = () => true) => [...drawn.keys()].filter(keep).forEach((element) => draw(element));

  // Charts are drawn one by one, so that the page answers at once; those in closed parts wait.
  const isSeen = (element) => !element.closest("details:not([open])");
  const queue = [...document.querySelectorAll(".plot")].filter(isSeen);
  function next() {
    const element = queue.shift();
    if (!element) { root.dataset.plots = "drawn"; return; }
    if (!drawn.has(element)) draw(element);
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

  // Rows of a table that hold every word, or that are odd.
  function sieve(key) {
    const words = document.querySelector(`[data-sieve="${key}"]`).value.toLowerCase().split(/\s+/);
    const only = document.querySelector(`[data-odd="${key}"]`).checked;
    const rows = [...document.querySelector(`#${key} table`).tBodies[0].rows];
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word)) || (only && !row.querySelector(".worse"));
    }
    const shown = rows.filter((row) => !row.hidden).length;
    document.querySelector(`[data-left="${key}"]`).textContent = `${shown} of ${rows.length}`;
  }

  function fill(part) {
    if (part.querySelector("table")) return;
    const { head, rows } = Charts.numbers(part.dataset.of);
    const box = part.appendChild(document.createElement("div"));
    box.className = "scroll";
    box.tabIndex = 0;
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", "Numbers of this chart");
    const table = box.appendChild(document.createElement("table"));
    const top = table.createTHead().insertRow();
    for (const text of head) {
      const cell = top.appendChild(document.createElement("th"));
      cell.scope = "col";
      cell.textContent = text;
    }
    const body = table.createTBody();
    for (const row of rows) {
      const line = body.insertRow();
      row.forEach((text, i) => {
        const cell = line.appendChild(document.createElement(i ? "td" : "th"));
        if (!i) cell.scope = "row";
        cell.className = "num";
        cell.textContent = text || "\u2013";
      });
    }
  }

  document.querySelectorAll("input[data-term]").forEach((box) => box.addEventListener("change", () => redraw(isTime)));
  document.querySelector("select[data-run]")?.addEventListener("change", (event) => {
    Charts.run(Number(event.target.value));
    document.querySelectorAll("details.numbers table").forEach((table) => table.parentNode.remove());
    document.querySelectorAll("details.numbers[open]").forEach(fill);
    redraw(isTime);
  });
  document.querySelectorAll("table.sortable thead button").forEach((b) => b.addEventListener("click", () => sortTable(b)));
  document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", () => {
    if (!part.open) return;
    if (part.dataset.of) fill(part);
    part.querySelectorAll(".plot").forEach((element) => { if (!drawn.has(element) && isSeen(element)) draw(element); });
  }));
  document.querySelectorAll("[data-sieve], [data-odd]").forEach((input) => {
    input.addEventListener("input", () => sieve(input.dataset.sieve ?? input.dataset.odd));
  });
  // A link to a folded part opens it.
  document.querySelectorAll('a[href^="#"]').forEach((link) => link.addEventListener("click", () => {
    const part = document.getElementById(link.hash.slice(1));
    if (part?.matches("details")) part.open = true;
  }));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw());

  // On paper: light colours, everything unfolded but the numbers behind charts, charts as wide as their column there.
  const ON_PAPER = { full: 670, half: 325 };
  window.addEventListener("beforeprint", () => {
    root.classList.add("print");
    document.querySelectorAll("details:not(.name, .numbers)").forEach((part) => {
      part.dataset.was = part.open;
      part.open = true;
    });
    document.querySelectorAll(".plot").forEach((element) => {
      draw(element, { width: element.classList.contains("wide") ? ON_PAPER.full : ON_PAPER.half, k: 2 });
    });
  });
  window.addEventListener("afterprint", () => {
    root.classList.remove("print");
    document.querySelectorAll("details[data-was]").forEach((part) => {
      part.open = part.dataset.was === "true";
      delete part.dataset.was;
    });
    for (const element of [...drawn.keys()]) {
      if (isSeen(element)) draw(element);
      else { drawn.get(element).forEach((plot) => plot.destroy()); drawn.delete(element); }
    }
  });

  root.dataset.plots = "drawing";
  next();
})();
