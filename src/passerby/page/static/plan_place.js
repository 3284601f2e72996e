// A plan is uploaded, and cameras and points of the ground are placed on it: a draft that the server tries on the rig.

import { draw, find, make, number, show } from "./dom.js";
import { PICTURES_MS } from "./plan.js";
import { area, cross, label, line, PlanStage, square } from "./plan_stage.js";
import { ask, send, upload } from "./server.js";

const MOST_BYTES = 25e6;
const EMPTY = { image: null, name: "", metres_per_pixel: null, distance: null, cameras: {}, points: [] };
const HINTS = {
  look: "Drag to move the plan; the wheel zooms it once it is clicked. Choose what a click says.",
  scale: "Click the two ends of something whose length you know, as far apart as possible. Then type the metres.",
  camera: "Choose a camera, then click where it is mounted.",
  point: "Click a point of the ground on the plan, then the same point in one or more pictures of the cameras.",
};

const whole = ({ pixels }) => Object.keys(pixels).length > 0;
const round = (at) => at.map((value) => Math.round(100 * value) / 100);

export class PlanPlacer {
  constructor(page) {
    this.page = page;
    this.draft = structuredClone(EMPTY);
    this.saved = undefined;
    this.size = null;
    this.mode = "look";
    this.chosenPoint = -1;
    this.fit = null;
    this.asked = 0;
    this.dirty = false;
    this.build();
  }

  build() {
    this.stage = new PlanStage("The plan", (unit) => this.shapes(unit), (at) => this.placed(at));
    this.picture = draw("image", { preserveAspectRatio: "none" });
    const file = make("input", { type: "file", accept: "image/png,image/jpeg", id: "plan-file", onchange: () => this.upload(file) });
    this.name = make("span", { class: "muted" });
    this.remove = make("button", { type: "button", class: "quiet", onclick: () => this.page.act({ act: "remove_plan" }) }, "Remove the plan");
    const mode = (name, text) => make("button", { type: "button", "data-plan": name, onclick: () => this.setMode(name) }, text);
    this.modes = [mode("look", "Only look"), mode("scale", "Set the scale"), mode("camera", "Place a camera"), mode("point", "Place a point")];
    this.hint = make("p", { role: "status", "aria-live": "polite" });
    this.camera = make("select", { "aria-label": "Camera to be placed" });
    const field = (text, input) => make("label", { class: "field" }, make("span", {}, text), input);
    const metres = { type: "number", min: "0.0001", step: "any" };
    this.unit = make("input", { ...metres, onchange: () => this.setUnit() });
    this.metres = make("input", { ...metres, onchange: () => this.setMetres() });
    this.cameraField = field("Camera", this.camera);
    this.metresField = field("Metres between the two clicks", this.metres);
    this.list = make("ul", { class: "cues", tabindex: "-1", "aria-label": "Placed on the plan" });
    this.outcome = make("div", { role: "status", "aria-live": "polite" });
    this.save = make("button", { type: "button", class: "main", onclick: () => this.store() }, "Save the plan");
    this.drop = make("button", { type: "button", class: "quiet", onclick: () => this.adopt(this.page.state) }, "Discard changes");
    this.work = make("div", { hidden: true },
      make("div", { class: "toolbar", role: "group", "aria-label": "What a click on the plan says" }, ...this.modes),
      make("div", { class: "tool plan-tool" }, this.hint, make("div", { class: "tool-form" }, this.cameraField, this.metresField,
        field("Metres per pixel", this.unit))),
      this.stage.stage, make("p", { class: "tools" }, this.stage.buttons), this.list, this.outcome,
      make("p", { class: "tools" }, this.save, this.drop));
    show(find("plan-place"), make("h3", {}, "Place a plan"),
      make("p", { class: "lead" }, "A floor plan or a satellite picture, its scale, and two or more cameras or points on it: that sets scale, origin and heading."),
      make("p", { class: "tools" }, make("label", { class: "button", for: "plan-file" }, "Choose a plan (PNG, JPEG)"), file, this.name, this.remove),
      this.work);
  }

  // What the scene file says now replaces a draft only if its own plan has changed.
  update(state) {
    const cameras = JSON.stringify(state.cameras);
    if (this.cameras !== cameras) {
      this.cameras = cameras;
      show(this.camera, ...state.cameras.map((name) => make("option", { value: name }, name)));
    }
    if (JSON.stringify(state.plan ?? null) !== this.saved) {
      if (this.dirty) this.page.tell("The plan was changed in the scene file: it is shown now.");
      this.adopt(state);
    } else if (this.rig !== JSON.stringify([state.posed, state.calibration])) {
      this.changed(this.dirty);
    }
    this.rig = JSON.stringify([state.posed, state.calibration]);
  }

  adopt(state) {
    this.saved = JSON.stringify(state.plan ?? null);
    this.draft = { ...structuredClone(EMPTY), ...structuredClone(state.plan ?? {}) };
    this.chosenPoint = -1;
    this.fit = null;
    if (state.plan) this.open(null);
    else this.close();
    this.changed(false);
  }

  close() { this.size = null; this.work.hidden = true; this.setMode("look"); }

  async open(image) {
    const query = image ? { image } : {};
    const told = await ask("/api/plan/picture", query).catch((error) => {
      if (image || this.page.state.plan) this.page.tell(error.message);  // else it was taken out meanwhile
    });
    if (!told) { this.close(); return; }
    const [width, height] = told.size;
    const other = this.size?.join() !== told.size.join();
    this.size = told.size;
    const address = new URLSearchParams({ ...query, v: this.saved.length + width });
    for (const [key, value] of Object.entries({ href: `/plan?${address}`, x: -0.5, y: -0.5, width, height })) this.picture.setAttribute(key, value);
    this.work.hidden = false;
    if (other) this.stage.setBox([-0.5, -0.5, width, height]);
    this.changed(this.dirty);
  }

  // The browser's name of the file is shown and nothing else: the server names it by its content.
  async upload(input) {
    const [file] = input.files;
    input.value = "";
    if (!file) return;
    if (file.size > MOST_BYTES) {
      this.page.tell(`${file.name} has ${number(file.size / 1e6, 0)} MB: a plan may have ${MOST_BYTES / 1e6} MB, so save it smaller.`);
      return;
    }
    const told = await upload("/api/plan/upload", file).catch((error) => this.page.tell(error.message));
    if (!told) return;
    this.page.tell("");
    this.draft = { ...structuredClone(EMPTY), image: told.image, name: file.name };
    this.dirty = true;
    await this.open(told.image);
    this.setMode("scale");
  }

  setMode(mode) {
    this.page.choose(mode === "point" ? "plan" : "look");
    this.mode = mode;
    if (mode === "point") this.chosenPoint = -1;
    this.show();
  }

  // The page's tools: clicks in cameras' pictures belong to the chosen point.
  chosen(name) { this.mode = name === "plan" ? "point" : "look"; this.show(); }
  start() { this.showTool(); }

  click(view, at) {
    const point = this.draft.points[this.chosenPoint];
    if (!point) { this.page.tell("Click the point on the plan first, then in the pictures."); return; }
    point.pixels[view.name] = round(at);
    this.changed();
  }

  drawing(name) {
    const seen = this.draft.points.map((one, index) => ({ at: one.pixels[name], label: this.title(one, index), kind: index === this.chosenPoint ? "" : "second" }));
    return { marks: seen.filter((one) => one.at) };
  }

  placed(at) {
    const where = round(at);
    if (this.mode === "scale") {
      const ends = this.draft.distance?.between ?? [];
      this.draft.distance = { ...this.draft.distance, between: ends.length === 1 ? [...ends, where] : [where] };
      this.draft.metres_per_pixel = null;
    } else if (this.mode === "camera") {
      this.draft.cameras[this.camera.value] = where;
      this.camera.value = this.page.state.cameras.find((name) => !(name in this.draft.cameras)) ?? this.camera.value;
    } else if (this.mode === "point") {
      const point = this.draft.points[this.chosenPoint];
      if (point) point.at = where;
      else this.chosenPoint = this.draft.points.push({ at: where, pixels: {} }) - 1;
    } else {
      return;
    }
    this.changed();
  }

  setUnit() {
    this.draft.metres_per_pixel = this.unit.valueAsNumber > 0 ? this.unit.valueAsNumber : null;
    if (this.draft.metres_per_pixel) this.draft.distance = null;
    this.changed();
  }

  setMetres() {
    if (this.draft.distance) this.draft.distance.metres = this.metres.valueAsNumber > 0 ? this.metres.valueAsNumber : undefined;
    this.changed();
  }

  title(point, index) { return point.name ?? String(index + 1); }

  // What is missing before the draft can be saved; empty for nothing.
  lacks() {
    const { metres_per_pixel: unit, distance, cameras, points } = this.draft;
    const open = points.findIndex((one) => !whole(one));
    if (!unit && !(distance?.between.length === 2 && distance.metres)) return "Set the scale: metres per pixel, or two clicks and the metres between them.";
    if (open >= 0) return `Point ${this.title(points[open], open)} needs a click in one or more pictures.`;
    return Object.keys(cameras).length + points.length < 2 ? "Place two or more cameras or points, as far apart as possible." : "";
  }

  content() {
    const { image, metres_per_pixel: unit, distance, cameras, points } = this.draft;
    return { image, metres_per_pixel: unit, distance: unit ? null : distance, cameras, points };
  }

  changed(dirty = true) {
    this.dirty = dirty;
    this.show();
    this.page.redraw();
    this.tryOut();
  }

  async tryOut() {
    const asked = ++this.asked;
    if (this.page.state) await this.page.cameras.pictures(PICTURES_MS);
    if (asked !== this.asked) return;
    const ready = this.size && !this.lacks() && this.page.state?.posed.length;
    const found = ready ? await send("/api/plan/fit", this.content()).catch((error) => ({ error: error.message })) : null;
    if (asked !== this.asked) return;
    this.fit = found;
    this.show();
  }

  async store() {
    this.dirty = false;  // what the file then says is this draft
    const done = await this.page.act({ act: "plan", plan: this.content() });
    this.dirty = !done;
    if (done) this.setMode("look");
    this.show();
  }

  show() {
    if (!this.page.state) return;
    for (const button of this.modes) button.setAttribute("aria-pressed", String(button.dataset.plan === this.mode));
    this.name.textContent = this.draft.name;
    this.remove.hidden = !this.page.state.plan;
    this.cameraField.hidden = this.mode !== "camera";
    this.metresField.hidden = !this.draft.distance;
    if (document.activeElement !== this.unit) this.unit.value = this.draft.metres_per_pixel ?? "";
    const [a, b] = this.draft.distance?.between ?? [];
    this.unit.placeholder = b && this.draft.distance.metres ? number(this.draft.distance.metres / Math.hypot(b[0] - a[0], b[1] - a[1]), 5) : "";
    if (document.activeElement !== this.metres) this.metres.value = this.draft.distance?.metres ?? "";
    this.hint.textContent = HINTS[this.mode];
    const lacks = this.lacks();
    this.save.disabled = !this.dirty || Boolean(lacks);
    this.drop.hidden = !this.dirty;
    show(this.outcome, ...(lacks ? [make("p", { class: "muted" }, lacks)] : this.told()));
    this.showList();
    this.showTool();
    this.stage.redraw();
  }

  told() {
    if (!this.fit) return this.page.state.posed.length ? [] : [make("p", { class: "muted" }, "After a calibration, this shows where the plan puts all cameras.")];
    if (this.fit.error) return [make("p", { class: "faults" }, this.fit.error)];
    const { scale_percent: scale, scale_sigma_percent: sigma, turn_sigma_deg: turn, place_sigma_m: place, notes } = this.fit;
    return [
      make("p", {}, `The rig as it is, laid upon the plan: lengths change by ${number(scale, 1)} % (one sigma ${number(sigma, 1)} %); heading known to ${number(turn, 1)}°, position to ${number(place, 2)} m.`),
      notes.length ? make("ul", { class: "faults" }, ...notes.map((one) => make("li", {}, one))) : null,
    ];
  }

  showList() {
    const off = (camera, point) => {
      const row = this.fit?.placements?.find((one) => one.camera === camera && (one.point ?? null) === point);
      return row ? `, ${row.off_m === null ? "above the horizon" : `${number(row.off_m, 2)} m off`}${row.used ? "" : ", left out"}` : "";
    };
    const entry = (text, ...buttons) => make("li", {}, text, " ", ...buttons);
    const button = (text, name, act) => make("button", { type: "button", class: "quiet", "aria-label": name, onclick: () => { act(); this.list.focus(); } }, text);
    const cameras = Object.entries(this.draft.cameras).map(([name, at]) => entry(
      `Camera ${name} at ${at.map((one) => number(one, 0)).join(", ")}${off(name, null)}`,
      button("Remove", `Remove camera ${name} from the plan`, () => { delete this.draft.cameras[name]; this.changed(); })));
    const points = this.draft.points.map((one, index) => {
      const title = this.title(one, index);
      const seen = Object.keys(one.pixels).map((name) => `${name}${off(name, title)}`).join("; ");
      return entry(`Point ${title} at ${one.at.map((value) => number(value, 0)).join(", ")}, seen in ${seen || "no picture yet"}`,
        button("Change", `Change point ${title}`, () => { this.setMode("point"); this.chosenPoint = index; this.show(); this.page.redraw(); }), " ",
        button("Remove", `Remove point ${title}`, () => { this.draft.points.splice(index, 1); this.chosenPoint = -1; this.changed(); }));
    });
    show(this.list, ...cameras, ...points);
  }

  // Beside the cameras' pictures, as long as a point is placed.
  showTool() {
    if (this.mode !== "point" || this.page.tool !== this) return;
    const point = this.draft.points[this.chosenPoint];
    const next = make("button", { type: "button", class: "main", disabled: !point || !whole(point), onclick: () => { this.setMode("point"); this.back(); } }, "Next point");
    show(find("tool"), make("p", {}, point
      ? `Point ${this.title(point, this.chosenPoint)}: click it on the ground in one or more pictures${whole(point) ? `; clicked in ${Object.keys(point.pixels).join(", ")}` : ""}.`
      : "Click a point of the ground on the plan first."),
    make("p", { class: "tools" }, next, make("button", { type: "button", class: "quiet", onclick: () => this.back() }, "Back to the plan")));
  }

  back() { this.stage.stage.scrollIntoView({ block: "center" }); this.stage.stage.focus({ preventScroll: true }); }

  shapes(unit) {
    if (!this.size) return [];
    const shapes = [this.picture];
    const fitted = this.fit?.cameras ?? [];
    const colour = (name) => fitted.find((one) => one.name === name)?.colour ?? "#0b57d0";
    for (const one of fitted) shapes.push(area(one.seen, { class: "plan-seen", fill: one.colour, stroke: one.colour, "stroke-width": unit }));
    for (const one of fitted) shapes.push(square(one.at, one.colour, unit), label(one.at, one.name, unit));
    const ends = this.draft.distance?.between ?? [];
    if (ends.length === 2) shapes.push(line(ends, { class: "plan-scale", "stroke-width": 2 * unit }));
    shapes.push(...ends.map((at) => cross(at, "scale", unit)));
    for (const { point, camera, found, used } of this.fit?.placements ?? []) {
      const at = point === null || point === undefined ? this.draft.cameras[camera]
        : this.draft.points.find((one, index) => this.title(one, index) === point)?.at;
      if (found && at) shapes.push(line([at, found], { class: used ? "plan-off" : "plan-off wrong", "stroke-width": 2 * unit }));
    }
    for (const [name, at] of Object.entries(this.draft.cameras)) {
      shapes.push(draw("circle", { cx: at[0], cy: at[1], r: 8 * unit, class: "plan-placed", stroke: colour(name), "stroke-width": 2.5 * unit }));
      if (!fitted.some((one) => one.name === name)) shapes.push(label(at, name, unit));
    }
    this.draft.points.forEach((one, index) => shapes.push(
      cross(one.at, index === this.chosenPoint ? "chosen" : "point", unit), label(one.at, this.title(one, index), unit, true)));
    return shapes;
  }
}
