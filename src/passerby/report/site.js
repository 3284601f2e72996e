"use strict";
// A report of many cameras: the camera that is looked at, and the map.
(function () {
  const { load, tool } = window.passerbyReport;
  const find = (id) => document.getElementById(id);
  const field = find("camera-name"), view = find("camera-view"), note = find("camera-note");
  const names = Array.from(find("camera-names").options, (one) => one.value);
  let shown = -1;

  // One camera at a time; its number is in the address, so that it can be linked and the browser's Back leads back ---------
  const asked = () => { const found = /^#camera=(\d+)$/.exec(location.hash); return found ? Number(found[1]) : -1; };

  async function show(place, scroll) {
    if (!(place in names)) return;
    shown = place;
    field.value = names[place];
    note.textContent = "";
    view.setAttribute("aria-busy", "true");
    let html = "";
    try { html = (await load("camera-" + place)).html; } catch (error) { note.textContent = error.message; }
    if (shown !== place) return; // another was asked for meanwhile
    const open = Array.from(view.querySelectorAll("details"), (one) => one.open);
    view.innerHTML = html;
    view.removeAttribute("aria-busy");
    Array.from(view.querySelectorAll("details")).forEach((one, number) => { one.open = Boolean(open[number]); });
    if (scroll) {
      find("views").scrollIntoView();
      view.focus({ preventScroll: true });
    }
  }

  addEventListener("hashchange", function () { if (asked() >= 0 && asked() !== shown) show(asked(), true); });
  // A link to the camera that is shown already changes no address.
  document.addEventListener("click", function (event) {
    const link = event.target.closest("a[href^='#camera=']");
    if (link && link.getAttribute("href") === location.hash) show(asked(), true);
  });

  function turnTo(place) {
    show(place, false);
    // A page within another one may not change its address.
    try { history.replaceState(null, "", "#camera=" + place); } catch (error) { /* It is only for links. */ }
  }

  function choose() {
    const text = field.value.trim().toLowerCase();
    let place = names.indexOf(field.value.trim());
    if (place < 0) place = names.findIndex((name) => name.toLowerCase() === text);
    if (place < 0 && text) place = names.findIndex((name) => name.toLowerCase().includes(text));
    if (place < 0) note.textContent = "No camera has this name."; else turnTo(place);
  }

  field.addEventListener("change", choose);
  // A large page is seen before its scripts run: a name that was given until now counts too, one that is being typed may go on.
  if (field.value.trim() && (names.includes(field.value.trim()) || document.activeElement !== field)) choose();
  document.querySelectorAll("button[data-step]").forEach((one) => one.addEventListener("click", function () {
    turnTo((Math.max(shown, 0) + Number(one.dataset.step) + names.length) % names.length);
  }));
  new IntersectionObserver(function (entries, watcher) {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    watcher.disconnect();
    if (shown < 0 && !field.value) show(Math.max(asked(), 0), false); // what a user types is not replaced
  }, { rootMargin: "300px" }).observe(find("views"));
  if (asked() >= 0) show(asked(), true);

  // The map: names where there is room, the problems' first ----------------------------------------------------------------
  const map = find("rig-above");
  if (!map) return;
  const LETTER = 7, HEIGHT = 16, CELL = 64, MOST = 160;

  function placed(boxes, box) {
    // Boxes by cells of a coarse grid, so that each is compared with few others.
    const keys = [];
    for (let i = Math.floor(box[0] / CELL); i <= Math.floor(box[2] / CELL); i++) {
      for (let j = Math.floor(box[1] / CELL); j <= Math.floor(box[3] / CELL); j++) keys.push(i + " " + j);
    }
    const meets = (one) => one[0] < box[2] && box[0] < one[2] && one[1] < box[3] && box[1] < one[3];
    if (keys.some((key) => (boxes.get(key) || []).some(meets))) return false;
    keys.forEach((key) => { if (!boxes.has(key)) boxes.set(key, []); boxes.get(key).push(box); });
    return true;
  }

  function label() {
    const { xaxis, yaxis } = map._fullLayout, { cameras, zones } = map.layout.meta, boxes = new Map();
    const x = [], y = [], text = [], at = [];
    const put = function (word, where, up, bold) {
      const u = xaxis.l2p(where[0]), v = yaxis.l2p(where[1]) + up, half = LETTER * word.length / 2 + 3;
      if (u < half || u > xaxis._length - half || v < HEIGHT || v > yaxis._length - HEIGHT || text.length >= MOST) return;
      if (!placed(boxes, [u - half, v - HEIGHT / 2, u + half, v + HEIGHT / 2])) return;
      x.push(xaxis.p2l(u)); y.push(yaxis.p2l(v)); text.push(bold ? "<b>" + word + "</b>" : word); at.push("middle center");
    };
    zones.forEach((one) => put("zone " + one.zone, one.at, 0, true));
    const order = cameras.place.map((_, row) => row).sort((a, b) => cameras.first[b] - cameras.first[a] || a - b);
    order.forEach((row) => put(cameras.name[row], [cameras.x[row], cameras.y[row]], -12, false));
    const last = map.data.length - 1;
    Plotly.restyle(map, { x: [x], y: [y], text: [text], textposition: [at] }, [last]);
    map.dataset.names = String(text.length - text.filter((one) => one.startsWith("<b>")).length);
  }

  function move(factor, right, up) {
    const change = {};
    [["xaxis", right], ["yaxis", up]].forEach(function ([name, by]) {
      const [low, high] = map._fullLayout[name].range, middle = (low + high) / 2 + by * (high - low), half = factor * (high - low) / 2;
      change[name + ".range"] = [middle - half, middle + half];
    });
    Plotly.relayout(map, change);
  }

  const MOVES = [["Nearer", 0.5, 0, 0], ["Farther", 2, 0, 0], ["Left", 1, -0.3, 0], ["Right", 1, 0.3, 0], ["Up", 1, 0, 0.3], ["Down", 1, 0, -0.3]];

  function addTools() {
    const tools = map.parentNode.querySelector(".view-buttons"), zones = map.layout.meta.zones;
    const whole = { "xaxis.range": map.layout.xaxis.range.slice(), "yaxis.range": map.layout.yaxis.range.slice() };
    const choice = document.createElement("select");
    choice.setAttribute("aria-label", "Part of the map");
    choice.add(new Option("Whole site", ""));
    zones.forEach((one, row) => choice.add(new Option("Zone " + one.zone, String(row))));
    choice.addEventListener("change", function () {
      const one = choice.value === "" ? null : zones[Number(choice.value)];
      Plotly.relayout(map, one ? { "xaxis.range": one.x.slice(), "yaxis.range": one.y.slice() } : whole);
    });
    tools.append(choice);
    MOVES.forEach(([name, ...by]) => tools.append(tool(name, () => move(...by))));
  }

  map.addEventListener("drawn", function () {
    if (!map.dataset.names) {
      addTools();
      map.on("plotly_relayout", label);
      map.on("plotly_click", function (event) {
        const place = event.points.map((point) => point.customdata).find((one) => Number.isInteger(one));
        if (place !== undefined) location.hash = "#camera=" + place;
      });
    }
    label();
  });
})();
