// The rig from above: cameras, what they see, their sigmas and people, on the plan or on a grid. The server computes all of it.

import { draw, find, make, show } from "./dom.js";
import { area, label, line, PlanStage, square } from "./plan_stage.js";
import { ask } from "./server.js";

// What needs the rig's mathematics waits so long for the cameras' first pictures.
export const PICTURES_MS = 4000;

const WIDTHS = { grid: 1, path: 1.3, seen: 1, sigma: 1.5, heading: 3 };

export class PlanView {
  constructor(page) {
    this.page = page;
    this.shown = "";
    this.drawing = null;
    this.stage = new PlanStage("The rig from above", (unit) => this.shapes(unit));
    this.caption = make("p", { class: "muted" });
    this.box = make("div", { class: "plan-part", hidden: true }, make("h3", {}, "The rig from above"), this.stage.stage,
      make("p", { class: "tools" }, this.stage.buttons,
        make("button", { type: "button", onclick: () => this.png() }, "Save as PNG"),
        make("a", { class: "button", href: "/plan/view.svg", download: "rig-from-above.svg" }, "Save as SVG"),
        make("a", { class: "button", href: "/plan/view.geojson", download: "rig-from-above.geojson" }, "Save as GeoJSON")),
      this.caption);
    this.nothing = make("p", { class: "nothing" }, "After a calibration, the cameras are drawn here from above.");
    show(find("plan-view"), this.nothing, this.box);
  }

  async update(state) {
    const now = JSON.stringify([state.posed, state.calibration]);
    if (now === this.shown) return;
    this.shown = now;
    await this.page.cameras.pictures(PICTURES_MS);
    if (now !== this.shown) return;
    const found = state.posed.length ? await ask("/api/plan/view").catch((error) => this.page.tell(error.message)) : null;
    if (now !== this.shown) return;
    this.drawing = found ?? null;
    this.box.hidden = !this.drawing;
    this.nothing.hidden = Boolean(this.drawing);
    if (!this.drawing) return;
    const frame = this.drawing.georeferenced ? "GeoJSON has longitude and latitude." : "GeoJSON has metres of the rig's world: positions in degrees would make it longitude and latitude.";
    this.caption.textContent = [this.drawing.caption, ...this.drawing.notes, frame].join(" ");
    const [x, y, width, height] = this.drawing.backdrop ?? [];
    this.backdrop = this.drawing.backdrop && draw("image", {
      href: `/plan/backdrop?v=${state.calibration}`, x, y, width, height, preserveAspectRatio: "none",
    });
    this.stage.setBox(this.drawing.box);
  }

  shapes(unit) {
    if (!this.drawing) return [];
    return [...(this.backdrop ? [this.backdrop] : []), ...this.drawing.shapes.map((one) => shape(one, unit))];
  }

  // The saved SVG painted by the browser, which has the letters of every language.
  async png() {
    const picture = new Image();
    picture.src = `/plan/view.svg?${Date.now()}`;
    const done = await picture.decode().then(() => true, () => false);
    if (!done) { this.page.tell("The drawing cannot be saved as PNG: save it as SVG."); return; }
    const canvas = make("canvas", { width: picture.naturalWidth, height: picture.naturalHeight });
    canvas.getContext("2d").drawImage(picture, 0, 0);
    canvas.toBlob((blob) => {
      const address = URL.createObjectURL(blob);
      make("a", { href: address, download: "rig-from-above.png" }).click();
      setTimeout(() => URL.revokeObjectURL(address), 10000);
    }, "image/png");
  }
}

function shape({ kind, points, colour, text, below }, unit) {
  if (kind === "camera") return square(points[0], colour, unit);
  if (kind === "label" || kind === "bar-label") return label(points[0], text, unit, below);
  // On a plan or on the page, bright or dark: a bar with a halo.
  if (kind === "bar") return draw("g", {}, line(points, { class: "plan-halo", "stroke-width": 6 * unit }), line(points, { class: "plan-bar", "stroke-width": 3 * unit }));
  const attributes = { class: `plan-${kind}`, "stroke-width": WIDTHS[kind] * unit, ...(colour ? { stroke: colour } : {}) };
  return kind === "seen" || kind === "sigma" ? area(points, { ...attributes, ...(colour ? { fill: colour } : {}) }) : line(points, attributes);
}
