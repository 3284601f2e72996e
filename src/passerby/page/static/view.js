// One camera's picture: where it is clicked in its own pixels, and what is drawn over it.

import { draw, make } from "./dom.js";

const ZOOM = 6;

export class View {
  constructor(name, onclick) {
    this.name = name;
    this.onclick = onclick;
    this.frame = null;
    this.size = null;
    this.cursor = null;
    this.image = make("img", { alt: `Picture of camera ${name}`, decoding: "async", draggable: "false", hidden: true });
    this.layer = draw("svg", { class: "layer", "aria-hidden": "true" });
    this.stage = make("div", {
      class: "stage", tabindex: "0", role: "application",
      "aria-label": `Picture of camera ${name}: click, or move the cross with the arrow keys and press Enter`,
    }, this.image, this.layer);
    this.stage.addEventListener("pointerup", (event) => { if (event.button === 0) this.onclick(this, this.pixel(event)); });
    this.stage.addEventListener("pointermove", (event) => this.magnify(this.pixel(event)));
    this.stage.addEventListener("pointerleave", () => { lens().hidden = true; });
    this.stage.addEventListener("keydown", (event) => this.key(event));
    this.stage.addEventListener("blur", () => { lens().hidden = true; this.cross(null); });
    this.image.addEventListener("load", () => this.resize([this.image.naturalWidth, this.image.naturalHeight]));
    this.image.addEventListener("error", () => { this.image.hidden = true; });
  }

  // A scene of boxes has no pictures: then its frame alone is set. Done when the picture is there, or cannot be had.
  load(frame) {
    this.frame = frame;
    this.image.hidden = false;
    const shown = new Promise((done) => { for (const end of ["load", "error"]) this.image.addEventListener(end, done, { once: true }); });
    this.image.src = `/picture?${new URLSearchParams({ camera: this.name, frame })}`;
    return shown;
  }

  resize(size) {
    this.size = size;
    this.stage.style.aspectRatio = `${size[0]} / ${size[1]}`;
    this.layer.setAttribute("viewBox", `-0.5 -0.5 ${size[0]} ${size[1]}`);
    this.redraw();
  }

  // OpenCV's pixels: (0, 0) is the centre of the first one.
  pixel(event) {
    const box = this.stage.getBoundingClientRect();
    const [width, height] = this.size ?? [1, 1];
    const at = [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
    return at.map((value, axis) => Math.min(Math.max(value, 0), this.size?.[axis] ?? 1) - 0.5);
  }

  key(event) {
    if (!this.size) return;
    const step = event.shiftKey ? 0.5 : Math.max(1, this.size[0] / 100);
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (move) {
      event.preventDefault();
      const from = this.cursor ?? this.size.map((value) => value / 2 - 0.5);
      this.cross(from.map((value, axis) => Math.min(Math.max(value + move[axis], -0.5), this.size[axis] - 0.5)));
      this.magnify(this.cursor);
    } else if (event.key === "Enter" && this.cursor) {
      event.preventDefault();
      this.onclick(this, this.cursor);
    }
  }

  cross(at) {
    this.cursor = at;
    this.redraw();
  }

  magnify([u, v]) {
    const glass = lens();
    if (!this.size || this.image.hidden || !document.body.classList.contains("marking")) { glass.hidden = true; return; }
    const box = this.stage.getBoundingClientRect();
    const side = glass.width / ZOOM;
    const paint = glass.getContext("2d");
    paint.imageSmoothingEnabled = false;
    paint.fillStyle = "#000";
    paint.fillRect(0, 0, glass.width, glass.height);
    paint.drawImage(this.image, u + 0.5 - side / 2, v + 0.5 - side / 2, side, side, 0, 0, glass.width, glass.height);
    paint.strokeStyle = "#ff3b30";
    paint.beginPath();
    paint.moveTo(glass.width / 2, 0); paint.lineTo(glass.width / 2, glass.height);
    paint.moveTo(0, glass.height / 2); paint.lineTo(glass.width, glass.height / 2);
    paint.stroke();
    const right = u < this.size[0] / 2;
    glass.hidden = false;
    glass.style.left = `${Math.max(0, right ? box.right - glass.width - 6 : box.left + 6)}px`;
    glass.style.top = `${Math.max(0, v < this.size[1] / 2 ? box.bottom - glass.height - 6 : box.top + 6)}px`;
  }

  // regions: [[at, at, at]], marks: [{at, label, kind}], links: [[at, at]], lines: [{line: [[[u, v], width]]}], boxes: [[l, t, w, h]]
  redraw(drawing = this.drawing) {
    this.drawing = drawing ?? {};
    if (!this.size) return;
    const unit = this.size[0] / 480;
    const shapes = [];
    for (const corners of this.drawing.regions ?? []) {
      shapes.push(draw("polygon", { points: corners.map((at) => at.join(",")).join(" "), class: "region", "stroke-width": 1.4 * unit }));
    }
    for (const [left, top, width, height] of this.drawing.boxes ?? []) {
      shapes.push(draw("rect", { x: left, y: top, width, height, class: "box", "stroke-width": 1.4 * unit }));
    }
    for (const one of this.drawing.lines ?? []) shapes.push(...curve(one, unit));
    for (const [a, b] of this.drawing.links ?? []) {
      shapes.push(draw("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], class: "link", "stroke-width": 1.4 * unit }));
    }
    for (const one of this.drawing.marks ?? []) shapes.push(...mark(one.at, one.label, one.kind ?? "", unit));
    if (this.cursor) shapes.push(...mark(this.cursor, "", "cursor", unit));
    this.layer.replaceChildren(...shapes);
  }
}

const lens = () => document.getElementById("magnifier");

function mark([u, v], label, kind, unit) {
  const arm = 7 * unit;
  const cross = draw("path", {
    d: `M${u - arm} ${v}h${2 * arm}M${u} ${v - arm}v${2 * arm}`, class: `mark ${kind}`, "stroke-width": 1.6 * unit,
  });
  const text = draw("text", { x: u + arm, y: v - arm / 2, class: `mark-label ${kind}`, "font-size": 13 * unit }, label ?? "");
  return label ? [cross, text] : [cross];
}

function curve({ line, kind = "" }, unit) {
  if (line.length < 2) return [];
  const sides = [[], []];
  line.forEach(([[u, v], width], index) => {
    const [[u0, v0]] = line[Math.max(0, index - 1)];
    const [[u1, v1]] = line[Math.min(line.length - 1, index + 1)];
    const long = Math.hypot(u1 - u0, v1 - v0) || 1;
    const across = [(-(v1 - v0) / long) * width, ((u1 - u0) / long) * width];
    sides[0].push(`${u + across[0]},${v + across[1]}`);
    sides[1].unshift(`${u - across[0]},${v - across[1]}`);
  });
  return [
    draw("polygon", { points: [...sides[0], ...sides[1]].join(" "), class: `band ${kind}` }),
    draw("polyline", { points: line.map(([at]) => at.join(",")).join(" "), class: `epipolar ${kind}`, "stroke-width": 1.2 * unit }),
  ];
}
