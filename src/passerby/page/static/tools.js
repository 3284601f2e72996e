// What a click in a picture says: a tool gathers clicks until there is an act to be sent.

import { make, number, show } from "./dom.js";
import { samePerson } from "./person.js";
import { send } from "./server.js";

export const field = (label, attributes) => make("label", { class: "field" }, make("span", {}, label), make("input", attributes));
export const read = (form, name) => form.querySelector(`[name=${name}]`).valueAsNumber;

export class Tool {
  constructor(page) { this.page = page; this.box = document.getElementById("tool"); }
  form(...children) {
    const form = make("form", { class: "tool-form" }, ...children);
    form.addEventListener("submit", (event) => { event.preventDefault(); this.save(form); });
    return form;
  }
  buttons(label, ready) {
    return make("span", { class: "tool-buttons" },
      make("button", { type: "submit", class: "main", disabled: !ready }, label),
      make("button", { type: "button", class: "quiet", onclick: () => this.clear() }, "Clear"));
  }
  drawing() { return {}; }
  async act(content) {
    if (await this.page.act(content)) { this.clear(); return true; }
    return false;
  }
  clear() { this.start(); this.page.redraw(); }
}

// Two ends, each in two pictures or more: the picture's first click is the first end, the second the other one.
export class LengthTool extends Tool {
  start() { this.clicks = (this.clicks ?? 0) + 1; this.marks = {}; this.lines = {}; this.measured = null; this.show(); }

  // Only the last click's answer draws the form: an earlier one would replace the button below the user's finger.
  async click(view, at) {
    const click = ++this.clicks;
    const own = (this.marks[view.name] ??= [null, null]);
    const apart = own.map((one) => (one ? Math.hypot(one[0] - at[0], one[1] - at[1]) : -1));
    const end = own[0] === null ? 0 : own[1] === null ? 1 : apart[0] < apart[1] ? 0 : 1;
    own[end] = at;
    this.page.redraw();
    this.show();
    if (this.page.posed(view.name)) {
      const found = await send("/api/epipolar", { camera: view.name, at }).catch((error) => this.page.tell(error.message));
      for (const { camera, line } of found?.lines ?? []) (this.lines[camera] ??= {})[`${view.name} ${end}`] = { line, end };
    }
    this.page.redraw();
    if (click !== this.clicks) return;
    await this.measure();
    if (click === this.clicks) this.show();
  }

  whole() { return Object.fromEntries(Object.entries(this.marks).filter(([, ends]) => ends[0] && ends[1])); }

  async measure() {
    this.measured = null;
    const points = Object.fromEntries(Object.entries(this.whole()).filter(([name]) => this.page.posed(name)));
    if (Object.keys(points).length < 2) return;
    this.measured = await send("/api/length", points).catch((error) => { this.page.tell(error.message); return null; });
  }

  drawing(name) {
    const [a, b] = this.marks[name] ?? [null, null];
    const lines = Object.values(this.lines[name] ?? {}).filter(({ end }) => !(this.marks[name]?.[end]))
      .map(({ line, end }) => ({ line, kind: end ? "second" : "" }));
    const marks = [a && { at: a, label: "1" }, b && { at: b, label: "2", kind: "second" }].filter(Boolean);
    return { marks, lines, links: a && b ? [[a, b]] : [] };
  }

  show() {
    const typed = this.box.querySelector("[name=metres]")?.value ?? "";
    const ready = Object.keys(this.whole()).length >= 2;
    const told = this.measured
      ? `By the rig: ${number(this.measured.metres, 3)} m, one sigma of the clicks ${number(1000 * this.measured.sigma_m, 0)} mm, residual ${number(this.measured.residual_px, 1)} px.`
      : "Click one end and then the other, in two pictures or more. The other pictures show where the end must lie.";
    show(this.box, this.form(
      make("p", { id: "measured" }, told),
      field("Length in metres", { name: "metres", type: "number", min: "0.001", step: "any", required: true, value: typed }),
      field("Its standard deviation, metres", { name: "sd", type: "number", min: "0.0001", step: "any", value: "0.02", required: true }),
      make("label", { class: "choice" }, make("input", { name: "check", type: "checkbox", checked: this.box.querySelector("[name=check]")?.checked ?? false }),
        "Only check the rig with it"),
      this.buttons("Save the length", ready)));
  }

  save(form) { this.act({ act: "length", metres: read(form, "metres"), sd_m: read(form, "sd"), points: this.whole(), check: form.querySelector("[name=check]").checked }); }
}

// A straight thing: two pixels of it in one picture or more.
export class LineTool extends Tool {
  start() { this.marks = {}; this.measured = null; this.direction ??= "vertical"; this.show(); }

  async click(view, at) {
    const own = (this.marks[view.name] ??= []);
    if (own.length > 1) own.length = 0;
    own.push(at);
    await this.measure();
  }

  async measure() {
    this.measured = null;
    const points = Object.fromEntries(Object.entries(this.whole()).filter(([name]) => this.page.posed(name)));
    if (Object.keys(points).length) {
      this.measured = await send("/api/line", { direction: this.direction, points })
        .catch((error) => { this.page.tell(error.message); return null; });
    }
    this.page.redraw();
    this.show();
  }

  whole() { return Object.fromEntries(Object.entries(this.marks).filter(([, ends]) => ends.length === 2)); }

  drawing(name) {
    const ends = this.marks[name] ?? [];
    const marks = ends.map((at, index) => ({ at, label: String(index + 1), kind: index ? "second" : "" }));
    return { marks, links: ends.length === 2 ? [ends] : [] };
  }

  show() {
    const count = Object.keys(this.whole()).length;
    const off = this.measured?.off_deg;
    const told = typeof off === "number"
      ? `By the rig it is off by ${number(off, 2)}°, one sigma of the clicks ${number(this.measured.sigma_deg, 2)}°.`
      : this.direction === "horizontal" && count === 1 ? "Mark the same line in a second picture." : "Click two pixels of a straight thing, far apart, in one picture or more.";
    const names = { vertical: "vertical: a door frame, an edge of a house", horizontal: "horizontal, in two pictures or more", x: "horizontal, and the x axis runs along it" };
    const choice = make("select", { name: "direction", onchange: (event) => { this.direction = event.target.value; this.measure(); } },
      ...Object.entries(names).map(([value, text]) => make("option", { value, selected: value === this.direction }, text)));
    show(this.box, this.form(make("p", { id: "line-told" }, told), make("label", { class: "field" }, make("span", {}, "The line is"), choice),
      this.buttons("Save the line", count >= (this.direction === "horizontal" ? 2 : 1))));
  }

  save() { this.act({ act: "line", direction: this.direction, points: this.whole() }); }
}

export class WorldTool extends Tool {
  start() { this.clicks = []; this.axis = null; this.show(); }

  async click(view, at) {
    if (!this.page.posed(view.name)) { this.page.tell(`Camera ${view.name} has no pose yet: calibrate first.`); return; }
    const found = await send("/api/ground", { camera: view.name, at }).catch((error) => this.page.tell(error.message));
    if (!found) return;
    if (this.clicks.length > 1) this.clicks.length = 0;
    this.clicks.push({ camera: view.name, at });
    this.axis = null;
    if (this.clicks.length > 1) {
      this.axis = await send("/api/axis", this.clicks.map((one) => [one.camera, one.at]))
        .catch((error) => { this.page.tell(error.message); this.clicks.pop(); return null; });
    }
    this.page.redraw();
    this.show();
  }

  drawing(name) {
    const marks = this.clicks.map((one, index) => ({ ...one, label: index ? "x" : "0", kind: index ? "second" : "" }));
    return { marks: marks.filter((one) => one.camera === name) };
  }

  show() {
    const told = this.axis
      ? `The x axis runs through a point ${number(this.axis.metres, 2)} m from the origin; its heading is known to ${number(this.axis.heading_sigma_deg, 1)}° (one sigma of the clicks).`
      : this.clicks.length ? "Now click a point of the x axis on the ground, as far away as possible, best in a picture that looks along it."
        : "Click the origin on the ground, in any picture.";
    show(this.box, this.form(make("p", {}, told), this.buttons("Save the world frame", Boolean(this.axis))));
  }

  save() {
    const [origin, along] = this.clicks.map(({ camera, at }) => ({ camera, at }));
    this.act({ act: "world", origin, along_x: along });
  }
}

export class PersonTool extends Tool {
  start() { this.found = null; this.others = null; show(this.box); this.show(); }

  async click(view, at) {
    const found = { camera: view.name, frame: view.frame, at };
    this.found = found;
    this.others?.classList.add("stale");
    this.page.redraw();
    this.show();
    const others = await samePerson(found);
    if (this.page.tool !== this || this.found !== found) return;
    this.others = others;
    document.getElementById("magnifier").hidden = true;
    this.show();
  }

  drawing(name) {
    const boxes = this.page.boxes(name);
    return { boxes, marks: this.found?.camera === name ? [{ at: this.found.at, label: "person" }] : [] };
  }

  show() {
    const told = this.found
      ? `Camera ${this.found.camera}, frame ${this.found.frame}.`
      : "Click a person who stands upright. The frames of a camera can be chosen below its picture.";
    const typed = (name, usual) => this.box.querySelector(`[name=${name}]`)?.value ?? usual;
    const [height, sd] = [typed("height", ""), typed("sd", "0.01")];
    show(this.box, this.form(
      make("p", {}, told),
      field("Height in metres, with shoes", { name: "height", type: "number", min: "0.3", max: "3", step: "any", required: true, value: height }),
      field("Its standard deviation, metres", { name: "sd", type: "number", min: "0.001", step: "any", value: sd, required: true }),
      this.buttons("Save the height", Boolean(this.found))), this.others);
  }

  save(form) { this.act({ act: "person", ...this.found, height_m: read(form, "height"), sd_m: read(form, "sd") }); }
}

// Boxes that are one person, or different people, or no person.
export class IdentityTool extends Tool {
  start() { this.boxes = []; this.show(); }

  click(view, at) {
    if (!this.page.boxes(view.name).some(([left, top, width, height]) =>
      at[0] >= left && at[0] <= left + width && at[1] >= top && at[1] <= top + height)) {
      this.page.tell(`No person was detected there in camera ${view.name}: click inside a box.`);
      return;
    }
    this.page.tell("");
    this.boxes.push({ camera: view.name, frame: view.frame, at });
    this.page.redraw();
    this.show();
  }

  drawing(name) {
    const marks = this.boxes.map((one, index) => ({ ...one, label: String(index + 1) }));
    const shown = this.page.cameras.cards.get(name)?.view.frame;
    return { boxes: this.page.boxes(name), marks: marks.filter((one) => one.camera === name && one.frame === shown) };
  }

  show() {
    const count = this.boxes.length;
    const told = count ? this.boxes.map((one, index) => `${index + 1}: camera ${one.camera}, frame ${one.frame}`).join(" · ")
      : "Click the boxes of one person, or of different people, in one picture or more; or a poster that was taken for a person.";
    const button = (label, ready, act) => make("button", { type: "button", class: "main", disabled: !ready, onclick: () => this.act(act()) }, label);
    show(this.box, this.form(make("p", {}, told), make("span", { class: "tool-buttons" },
      button("The same person", count > 1, () => ({ act: "identities", key: "same", boxes: this.boxes })),
      button("Different people", count > 1, () => ({ act: "identities", key: "different", boxes: this.boxes })),
      button("Not a person", count === 1, () => ({ act: "not_people", box: this.boxes[0] })),
      make("button", { type: "button", class: "quiet", onclick: () => this.clear() }, "Clear"))));
  }

  save() {}
}

// A region of one picture: its corners one after another; a click in another picture begins again there.
export class RegionTool extends Tool {
  start() { this.camera = null; this.corners = []; this.show(); }

  click(view, at) {
    if (this.camera !== view.name) { this.camera = view.name; this.corners = []; }
    this.corners.push(at);
    this.page.redraw();
    this.show();
  }

  drawing(name) {
    const saved = this.page.regions(name);
    if (name !== this.camera) return { regions: saved };
    const marks = this.corners.map((at, index) => ({ at, label: String(index + 1) }));
    return { regions: [...saved, ...(this.corners.length > 2 ? [this.corners] : [])], marks };
  }

  show() {
    const told = this.camera ? `Camera ${this.camera}, ${this.corners.length} corners. People whose feet are inside are not used.`
      : "Click the corners of a mirror, a screen, or ground that other cameras do not share.";
    show(this.box, this.form(make("p", {}, told), this.buttons("Exclude the region", this.corners.length > 2)));
  }

  save() { this.act({ act: "exclude_region", camera: this.camera, corners: this.corners }); }
}

export class TimeTool extends Tool {
  start() { this.camera = null; this.show(); }

  click(view) { this.camera = view.name; this.show(); }

  show() {
    const old = (name) => this.box.querySelector(`[name=${name}]`)?.value ?? "";
    const seconds = { type: "number", min: "0", step: "any", required: true };
    show(this.box, this.form(
      make("p", {}, this.camera ? `Camera ${this.camera}: what it saw in this time is not used.` : "Click the picture of a camera."),
      field("From, seconds of its recording", { name: "begin", ...seconds, value: old("begin") }),
      field("To, seconds", { name: "end", ...seconds, value: old("end") }),
      this.buttons("Exclude the time", Boolean(this.camera))));
  }

  save(form) { this.act({ act: "exclude_time", camera: this.camera, begin_s: read(form, "begin"), end_s: read(form, "end") }); }
}
