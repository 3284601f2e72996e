// The cameras: a card each, with its picture, what is known of it, and what `check` says.

import { find, make, show } from "./dom.js";
import { found, ofTable } from "./faults.js";
import { ask } from "./server.js";
import { View } from "./view.js";

export class Cameras {
  constructor(page) { this.page = page; this.cards = new Map(); this.names = ""; this.loads = []; }

  update(state) {
    const names = JSON.stringify(state.cameras);
    // A scene file that cannot be read for a moment, as while a user edits it, takes no camera away.
    const broken = state.faults.length > 0 && this.cards.size > 0;
    if (names !== this.names && !broken) {
      this.names = names;
      this.cards.clear();
      this.loads = [];
      for (const name of state.cameras) this.cards.set(name, this.card(name));
      show(find("grid"), ...[...this.cards.values()].map(({ card }) => card));
    }
    const results = new Map((state.result?.cameras ?? []).map((one) => [one.name, one]));
    for (const [name, entry] of this.cards) {
      entry.scene = ofTable(state.faults, name);
      const result = results.get(name);
      entry.found.textContent = result ? found(result) : "";
      entry.problems = result ? [...result.problems, ...result.warnings] : [];
      this.tell(entry);
    }
    for (const [name, width, height] of state.posed) {
      const view = this.cards.get(name)?.view;
      if (view && !view.size) view.resize([width, height]);
    }
  }

  card(name) {
    const view = new View(name, (one, at) => this.page.click(one, at));
    const entry = { view, boxes: [], known: make("p", { class: "known" }), faults: make("ul", { class: "faults" }) };
    Object.assign(entry, { found: make("p", { class: "known" }), notes: make("ul", { class: "notes" }), own: { faults: [], notes: [] } });
    entry.frame = make("input", { type: "range", min: 1, max: 1, value: 1, step: 1, "aria-label": `Frame of camera ${name}` });
    entry.number = make("span", { class: "muted" });
    entry.frame.addEventListener("change", () => this.load(entry, Number(entry.frame.value)));
    const leave = make("button", { type: "button", class: "quiet", onclick: () => this.page.leaveOut(name) }, "Leave out");
    leave.setAttribute("aria-label", `Leave camera ${name} out`);
    entry.card = make("article", { class: "camera", "aria-label": `Camera ${name}` },
      make("header", {}, make("h3", {}, name), leave), view.stage,
      make("div", { class: "frames" }, entry.frame, entry.number), entry.known, entry.found, entry.faults, entry.notes);
    this.loads.push(this.load(entry, null));
    return entry;
  }

  // At first the frame with most people, which is also where a person can be pointed at.
  async load(entry, frame) {
    const { view } = entry;
    const told = await ask("/api/people", { camera: view.name, ...(frame === null ? {} : { frame }) })
      .catch((error) => { entry.number.textContent = error.message; return null; });
    if (!told) return;
    entry.boxes = told.boxes;
    entry.fps = told.fps;
    if (told.size && !view.size) view.resize(told.size);
    [entry.frame.min, entry.frame.max, entry.frame.value] = [told.first, told.last, told.frame];
    entry.number.textContent = told.why ?? `frame ${told.frame}`;
    if (told.why) view.frame = told.frame;
    const shown = !told.why && view.frame !== told.frame ? view.load(told.frame) : null;
    this.page.redraw();
    await shown;
  }

  // Of the frame that is shown, in the camera's own recording; null while nothing is known of its frame rate.
  seconds(name) {
    const { fps, view } = this.cards.get(name);
    return fps && view.frame ? (view.frame - 1) / fps : null;
  }

  // The first pictures, or so many milliseconds, whatever is first: what is slow to know waits for them.
  pictures(most) { return Promise.race([Promise.all(this.loads), new Promise((done) => { setTimeout(done, most); })]); }

  // own: by camera, what `check` says of it alone.
  check(told, own) {
    for (const one of told.cameras) {
      const entry = this.cards.get(one.name);
      if (!entry) continue;
      entry.known.textContent = known(one);
      if (one.size && !entry.view.size) entry.view.resize(one.size);
      entry.own = own.get(one.name);
      this.tell(entry);
    }
  }

  tell({ scene, own, problems, faults, notes }) {
    const items = (texts) => [...new Set(texts)].map((text) => make("li", {}, text));
    show(faults, ...items([...(scene ?? []), ...own.faults]));
    show(notes, ...items([...(problems ?? []), ...own.notes]));
  }
}

function known({ intrinsics, video, fps, boxes, size }) {
  const told = [];
  if (size) told.push(`${size[0]} × ${size[1]}`);
  if (video?.seconds) told.push(`${video.seconds.toFixed(1)} s of ${video.codec}`);
  if (fps ?? video?.fps) told.push(`${(fps ?? video.fps).toFixed(2).replace(/\.?0+$/, "")} frames/s`);
  if (boxes) told.push(`${boxes} boxes`);
  if (intrinsics) {
    const source = { file: "calibrated lens", people: "lens unknown: estimated from people" }[intrinsics.source];
    const sure = intrinsics.focal_sd_percent ? `, ± ${intrinsics.focal_sd_percent.toFixed(0)} %` : "";
    told.push(source ?? `lens by ${intrinsics.source}: ${intrinsics.focal_px?.toFixed(0)} px${sure}`);
  }
  return told.join(" · ");
}
