"use strict";
(function () {
  const root = document.documentElement;
  const all = (selector, from) => Array.from((from || document).querySelectorAll(selector));

  // Light and dark ------------------------------------------------------------------------------------------------------
  const THEMES = ["", "light", "dark"];
  const THEME_NAMES = { "": "as the system", light: "light", dark: "dark" };
  const button = document.getElementById("theme");

  function kept() {
    try { return localStorage.getItem("passerby-theme") || ""; } catch (error) { return ""; }
  }

  function setTheme(theme, keep) {
    if (theme) root.dataset.theme = theme; else delete root.dataset.theme;
    button.textContent = { "": "Auto", light: "Light", dark: "Dark" }[theme];
    button.setAttribute("aria-label", "Theme: " + THEME_NAMES[theme] + "; press for the next");
    if (keep) try { localStorage.setItem("passerby-theme", theme); } catch (error) { /* A page of its own keeps nothing. */ }
  }

  setTheme(THEMES.includes(kept()) ? kept() : "", false);
  button.addEventListener("click", function () {
    const now = root.dataset.theme || "";
    setTheme(THEMES[(THEMES.indexOf(now) + 1) % THEMES.length], true);
    drawAll();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", function () { drawAll(); });

  // Tables --------------------------------------------------------------------------------------------------------------
  function valueOf(row, column) {
    const text = row.cells[column].dataset.value;
    if (text === "") return null;
    const number = Number(text);
    return Number.isNaN(number) ? text : number;
  }

  function compare(a, b) {
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), undefined, { numeric: true });
  }

  function sortBy(table, head) {
    const column = head.cellIndex;
    const direction = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    all("thead th[aria-sort]", table).forEach((other) => other.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", direction === 1 ? "ascending" : "descending");
    const rows = Array.from(table.tBodies[0].rows);
    rows.forEach((row, place) => { if (row.dataset.place === undefined) row.dataset.place = place; });
    rows.sort(function (first, second) {
      const a = valueOf(first, column), b = valueOf(second, column);
      const same = Number(first.dataset.place) - Number(second.dataset.place);
      // What is undefined stays at the end, whichever way is sorted.
      if (a === null || b === null) return (a === null) - (b === null) || same;
      return direction * compare(a, b) || same;
    });
    table.tBodies[0].append(...rows);
  }

  document.addEventListener("click", function (event) {
    const head = event.target.closest("thead th[aria-sort] button");
    if (head) sortBy(head.closest("table"), head.closest("th"));
  });

  // Rows with all words that were written, wherever they stand in a row
  document.addEventListener("input", function (event) {
    const field = event.target.closest("input[data-filters]");
    if (!field) return;
    const rows = Array.from(document.getElementById(field.dataset.filters).tBodies[0].rows);
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    rows.forEach(function (row) {
      if (row.dataset.text === undefined) row.dataset.text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => row.dataset.text.includes(word));
      shown += row.hidden ? 0 : 1;
    });
    field.closest(".search").querySelector("output").textContent = words.length ? shown + " of " + rows.length + " rows" : rows.length + " rows";
  });

  function quoted(text) {
    return /[",\n\r]/.test(text) ? '"' + text.replace(/"/g, '""') + '"' : text;
  }

  function csvOf(table) {
    const heads = all("thead th", table).map((head) => quoted(head.dataset.csv));
    const rows = Array.from(table.tBodies[0].rows, (row) => Array.from(row.cells, (cell) => quoted(cell.dataset.value)).join(","));
    return [heads.join(","), ...rows].join("\n") + "\n";
  }

  function copyByHand(text) {
    const area = document.createElement("textarea");
    area.value = text;
    area.className = "unseen";
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    return done;
  }

  all("button.copy").forEach(function (one) {
    one.addEventListener("click", async function () {
      const text = csvOf(document.getElementById(one.dataset.copies));
      let done = false;
      try { await navigator.clipboard.writeText(text); done = true; } catch (error) { done = copyByHand(text); }
      one.focus();
      one.textContent = done ? "Copied" : "Could not be copied";
      setTimeout(() => { one.textContent = "Copy as CSV"; }, 2000);
    });
  });

  // Files beside the page: scripts, because a page that was opened as a file can fetch nothing ----------------------------
  const parts = new Map(), arrived = new Map();

  window.passerbyPart = (name, value) => arrived.set(name, value);

  function load(name) {
    if (!parts.has(name)) {
      const where = root.dataset.parts + "/" + name + ".js";
      parts.set(name, new Promise(function (resolve, reject) {
        const script = document.createElement("script");
        const missing = () => reject(new Error(where + " is missing or damaged: copy the folder along with this page, or write the report again with passerby report"));
        script.addEventListener("load", () => { if (arrived.has(name)) resolve(arrived.get(name)); else missing(); script.remove(); });
        script.addEventListener("error", missing);
        script.src = where;
        document.head.append(script);
      }));
    }
    return parts.get(name);
  }

  // Plots ---------------------------------------------------------------------------------------------------------------
  const probe = document.createElement("span");
  probe.hidden = true;
  document.body.append(probe);

  function colour(name) {
    probe.style.color = "var(" + name + ")";
    return getComputedStyle(probe).color;
  }

  function resolved(value) {
    if (Array.isArray(value)) return value.map(resolved);
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, resolved(one)]));
    }
    const named = typeof value === "string" && /^var\((--[a-z-]+)\)$/.exec(value);
    return named ? colour(named[1]) : value;
  }

  function themed(given) {
    const ink = colour("--ink"), muted = colour("--muted"), grid = colour("--grid"), line = colour("--line");
    const layout = resolved(given || {});
    const clear = "rgba(0,0,0,0)";
    const axis = (own) => ({ gridcolor: grid, linecolor: line, zerolinecolor: line, tickfont: { color: muted }, ...own });
    Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key)).forEach((key) => { layout[key] = axis(layout[key]); });
    Object.keys(layout).filter((key) => /^scene\d*$/.test(key)).forEach(function (key) {
      ["xaxis", "yaxis", "zaxis"].forEach(function (name) {
        layout[key][name] = axis({ showbackground: false, color: muted, ...layout[key][name] });
      });
    });
    return {
      paper_bgcolor: clear, plot_bgcolor: clear, uirevision: "kept", autosize: true, ...layout,
      font: { family: getComputedStyle(document.body).fontFamily, size: 13, color: ink, ...layout.font },
      hoverlabel: { bgcolor: colour("--surface"), bordercolor: line, font: { color: ink }, ...layout.hoverlabel },
      legend: { bgcolor: clear, ...layout.legend },
    };
  }

  const hasWebGL = (function () {
    try {
      const canvas = document.createElement("canvas");
      return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
    } catch (error) { return false; }
  })();
  const byTouch = matchMedia("(pointer: coarse)").matches;

  const figures = new Map();

  async function figureOf(place) {
    if (!figures.has(place.id)) {
      const inside = () => JSON.parse(document.getElementById(place.id + "-figure").textContent);
      figures.set(place.id, place.dataset.part ? await load(place.dataset.part) : inside());
    }
    return figures.get(place.id);
  }

  async function draw(place) {
    const inSpace = place.classList.contains("plot-space");
    if (inSpace && !hasWebGL) {
      place.textContent = "This view needs WebGL, which this browser does not offer. The view from above and the tables show the same.";
      place.className = "plot-note";
      all(".view-buttons", place.parentNode).forEach((tools) => tools.remove());
      return;
    }
    if (root.dataset.parts) await load("plotly");
    const figure = await figureOf(place);
    if (inSpace) addTools(place, figure.layout.meta);
    const layout = themed(figure.layout);
    // On a touch screen a finger on a flat plot scrolls the page.
    if (byTouch && !inSpace) layout.dragmode = false;
    // Where both axes have one scale, a narrow and high plot would be nearly empty.
    if (layout.height && layout.yaxis && layout.yaxis.scaleanchor) layout.height = Math.min(layout.height, 1.25 * place.clientWidth);
    const config = { responsive: true, displayModeBar: false, displaylogo: false, scrollZoom: false, doubleClick: "reset" };
    await Plotly.react(place, resolved(figure.data), layout, config);
    place.dataset.drawn = "yes";
    place.dispatchEvent(new Event("drawn"));
  }

  // What lies in files is drawn when it is about to be seen.
  const later = (place) => place.dataset.part !== undefined && place.dataset.near === undefined;

  async function drawOne(place) {
    try { await draw(place); } catch (error) {
      place.textContent = "This plot could not be drawn (" + error.message + ").";
      place.classList.add("plot-note");
      console.error(error);
    }
  }

  const watcher = new IntersectionObserver(function (entries) {
    entries.filter((entry) => entry.isIntersecting).forEach(function ({ target }) {
      watcher.unobserve(target);
      target.dataset.near = "yes";
      drawOne(target).then(choosePerson);
    });
  }, { rootMargin: "400px" });
  all(".plot[data-part]").forEach((place) => watcher.observe(place));

  let draws = 0;

  async function drawAll() {
    const own = ++draws;
    root.dataset.plots = "drawing";
    for (const place of all(".plot").filter((one) => !later(one))) {
      await drawOne(place);
      await new Promise((resolve) => setTimeout(resolve, 0));
      // In other colours by now: all plots are drawn again by the code that changed them.
      if (own !== draws) return;
    }
    root.dataset.plots = "drawn";
    choosePerson();
  }

  // Views of what is drawn in space, for the keyboard too
  function eyeOf(place) {
    const camera = place._fullLayout && place._fullLayout.scene && place._fullLayout.scene._scene && place._fullLayout.scene._scene.getCamera();
    return camera || { eye: { x: 1.25, y: -1.25, z: 1.0 } };
  }

  function turned(place, angle, nearer) {
    const camera = eyeOf(place), eye = camera.eye, c = Math.cos(angle), s = Math.sin(angle);
    camera.eye = { x: nearer * (c * eye.x - s * eye.y), y: nearer * (s * eye.x + c * eye.y), z: nearer * eye.z };
    return camera;
  }

  const STEPS = [
    ["Rotate left", -Math.PI / 12, 1], ["Rotate right", Math.PI / 12, 1], ["Nearer", 0, 0.8], ["Farther", 0, 1.25],
  ];

  function plain(label) {
    return new DOMParser().parseFromString(label, "text/html").documentElement.textContent;
  }

  function tool(name, act) {
    const one = document.createElement("button");
    one.type = "button";
    one.textContent = name;
    one.addEventListener("click", act);
    return one;
  }

  function addTools(place, meta) {
    const tools = place.parentNode.querySelector(".view-buttons");
    if (tools.childElementCount) return;
    const views = (meta && meta.views) || [];
    const choice = document.createElement("select");
    choice.setAttribute("aria-label", "View");
    views.forEach((view, number) => choice.add(new Option(plain(view.label), String(number))));
    const turnedByHand = new Option("as rotated", "");
    turnedByHand.hidden = true;
    choice.add(turnedByHand);
    choice.addEventListener("change", () => Plotly.relayout(place, { "scene.camera": views[Number(choice.value)].camera }));
    if (views.length) tools.append(choice);
    STEPS.forEach(([name, angle, nearer]) => tools.append(tool(name, function () {
      choice.value = "";
      Plotly.relayout(place, { "scene.camera": turned(place, angle, nearer) });
    })));
  }

  // The timeline: everybody, or one person
  const person = document.getElementById("timeline-person");

  function choosePerson() {
    const place = document.getElementById("timeline-plot");
    if (!person || !place || !place.data) return;
    const meta = place.layout.meta, bars = meta.bars, chosen = person.value;
    const rows = bars.who.map((_, row) => row).filter((row) => !meta.crowded || String(bars.who[row]) === chosen);
    const take = (column) => rows.map(column);
    Plotly.restyle(place, {
      base: [take((row) => bars.begin[row])],
      x: [take((row) => bars.end[row] - bars.begin[row])],
      y: [take((row) => bars.y[row])],
      width: [take(() => bars.width)],
      customdata: [take((row) => [bars.who[row], meta.cameras[bars.camera[row]], bars.begin[row], bars.end[row]])],
      "marker.color": [take((row) => bars.colours[bars.who[row]])],
      "marker.opacity": [take((row) => (chosen === "" || String(bars.who[row]) === chosen ? 1 : 0.1))],
      "marker.line.width": 0,
    }, [place.data.length - 1]);
    if (meta.crowded) Plotly.restyle(place, { opacity: chosen === "" ? 1 : 0.4 }, [0]);
  }

  if (person) person.addEventListener("change", choosePerson);

  // Layers of the pictures ----------------------------------------------------------------------------------------------
  const views = document.getElementById("views");
  all("input[data-layer]").forEach(function (box) {
    const show = () => views.classList.toggle("hide-" + box.dataset.layer, !box.checked);
    box.addEventListener("change", show);
    show();
  });

  // Paper shows what is folded, and black on white
  let folded = [];
  addEventListener("beforeprint", function () {
    all(".plot[data-part]:not([data-near])").forEach((place) => { place.dataset.near = "yes"; drawOne(place); });
    folded = all("details:not([open])");
    folded.forEach((one) => { one.open = true; });
  });
  addEventListener("afterprint", function () { folded.forEach((one) => { one.open = false; }); });

  window.passerbyReport = { load, tool };
  drawAll();
})();
