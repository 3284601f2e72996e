// A drawing that is moved and zoomed: with the wheel once it is focused, by dragging, two fingers, buttons or keys.

import { draw, make } from "./dom.js";

const CLOSEST = 60, STEP = 1.5, STILL_PX = 4;

export class PlanStage {
  // paint(unit) makes what is drawn; a screen pixel is `unit` long. onclick(at) is called with clicks, in the drawing's own units.
  constructor(label, paint, onclick = null) {
    this.paint = paint;
    this.onclick = onclick;
    this.whole = this.seen = [0, 0, 1, 1];
    this.cursor = null;
    this.pointers = new Map();
    this.layer = draw("svg", { class: "plan-layer", "aria-hidden": "true" });
    this.stage = make("div", { class: "plan-stage", tabindex: "0", role: "application", "aria-label": `${label}. ${onclick
      ? "Click, or move the cross with the arrow keys and press Enter" : "Arrow keys move the drawing"}; plus and minus zoom, 0 shows all` }, this.layer);
    const button = (text, name, act) => make("button", { type: "button", class: "quiet", onclick: act, "aria-label": name }, text);
    this.buttons = make("span", { class: "tool-buttons", role: "group", "aria-label": "Zoom" },
      button("+", "Zoom in", () => this.zoom(STEP)), button("−", "Zoom out", () => this.zoom(1 / STEP)),
      button("Whole", "Show the whole drawing", () => this.fit()));
    this.stage.addEventListener("pointerdown", (event) => this.down(event));
    this.stage.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) this.stage.addEventListener(end, (event) => this.up(event));
    this.stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.stage.addEventListener("keydown", (event) => this.key(event));
    this.stage.addEventListener("blur", () => { this.cursor = null; this.redraw(); });
    new ResizeObserver(() => this.redraw()).observe(this.stage);
  }

  // [x, y, width, height] of everything.
  setBox(box) {
    this.whole = box;
    this.stage.style.aspectRatio = `${box[2]} / ${box[3]}`;
    this.fit();
  }

  fit() { this.seen = [...this.whole]; this.redraw(); }

  get unit() {
    const { width, height } = this.stage.getBoundingClientRect();
    return Math.max(this.seen[2] / (width || 1), this.seen[3] / (height || 1));
  }

  at({ clientX, clientY }) {
    const box = this.stage.getBoundingClientRect();
    const [x, y, width, height] = this.seen;
    return [x + width / 2 + (clientX - box.left - box.width / 2) * this.unit, y + height / 2 + (clientY - box.top - box.height / 2) * this.unit];
  }

  middle() { return [this.seen[0] + this.seen[2] / 2, this.seen[1] + this.seen[3] / 2]; }

  zoom(factor, at = this.cursor ?? this.middle()) {
    const closer = Math.min(Math.max((factor * this.whole[2]) / this.seen[2], 1), CLOSEST) * (this.seen[2] / this.whole[2]);
    this.seen = [at[0] - (at[0] - this.seen[0]) / closer, at[1] - (at[1] - this.seen[1]) / closer, this.seen[2] / closer, this.seen[3] / closer];
    this.pan(0, 0);
  }

  pan(dx, dy) {
    [dx, dy].forEach((by, axis) => {
      const [low, size] = [this.whole[axis], this.whole[axis + 2]];
      this.seen[axis] = Math.min(Math.max(this.seen[axis] + by, low), low + size - this.seen[axis + 2]);
    });
    this.redraw();
  }

  wheel(event) {
    if (!event.ctrlKey && document.activeElement !== this.stage) return;
    event.preventDefault();
    this.zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, this.at(event));
  }

  down(event) {
    if (event.button !== 0) return;
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, event);
    if (this.pointers.size === 1) { this.start = event; this.dragged = false; }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const other = [...this.pointers.values()].find((one) => one.pointerId !== event.pointerId);
    if (!other && !this.dragged && Math.hypot(event.clientX - this.start.clientX, event.clientY - this.start.clientY) < STILL_PX) return;
    this.dragged = true;
    this.pointers.set(event.pointerId, event);
    if (other) {
      const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1;
      this.zoom(apart(event) / apart(before), this.at({ clientX: (event.clientX + other.clientX) / 2, clientY: (event.clientY + other.clientY) / 2 }));
    } else {
      this.pan((before.clientX - event.clientX) * this.unit, (before.clientY - event.clientY) * this.unit);
    }
  }

  up(event) {
    const known = this.pointers.delete(event.pointerId);
    if (known && !this.dragged && event.type === "pointerup") this.click(this.at(event));
  }

  click(at) {
    const [x, y, width, height] = this.whole;
    if (this.onclick && at[0] >= x && at[0] <= x + width && at[1] >= y && at[1] <= y + height) this.onclick(at);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = (event.shiftKey ? 1 : 12) * this.unit;
    const way = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (way && this.onclick) this.cross(way);
    else if (way) this.pan(3 * way[0], 3 * way[1]);
    else if (event.key === "+" || event.key === "=") this.zoom(STEP);
    else if (event.key === "-") this.zoom(1 / STEP);
    else if (event.key === "0") this.fit();
    else if (event.key === "Enter" && this.cursor) this.click(this.cursor);
    else return;
    event.preventDefault();
  }

  // The cross is moved, and the drawing with it where it would leave what is seen.
  cross(way) {
    const from = this.cursor ?? this.middle();
    this.cursor = from.map((value, axis) => Math.min(Math.max(value + way[axis], this.whole[axis]), this.whole[axis] + this.whole[axis + 2]));
    const out = this.cursor.map((value, axis) => Math.min(value - this.seen[axis], 0) + Math.max(value - this.seen[axis] - this.seen[axis + 2], 0));
    this.pan(...out);
  }

  redraw() {
    this.layer.setAttribute("viewBox", this.seen.join(" "));
    const unit = this.unit;
    this.layer.replaceChildren(...this.paint(unit), ...(this.cursor ? [cross(this.cursor, "cursor", unit)] : []));
  }
}

export const line = (points, attributes) => draw("polyline", { points: points.map((at) => at.join(",")).join(" "), fill: "none", ...attributes });
export const area = (points, attributes) => draw("polygon", { points: points.map((at) => at.join(",")).join(" "), ...attributes });

export function cross([x, y], kind, unit, arm = 8 * unit) {
  return draw("path", { d: `M${x - arm} ${y}h${2 * arm}M${x} ${y - arm}v${2 * arm}`, class: `plan-mark ${kind}`, "stroke-width": 2 * unit });
}

export function square([x, y], colour, unit, side = 11 * unit) {
  return draw("rect", { x: x - side / 2, y: y - side / 2, width: side, height: side, fill: colour, class: "plan-camera", "stroke-width": 1.5 * unit });
}

export function label([x, y], text, unit, below = false) {
  return draw("text", { x, y: y + (below ? 24 : -11) * unit, "font-size": 13 * unit, "stroke-width": 3.5 * unit, class: "plan-label" }, text);
}
