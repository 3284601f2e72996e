// Two pictures of one camera, the later one laid over the earlier one up to a slider.

import { make, show } from "./dom.js";
import { ask } from "./server.js";

export class Wipe {
  constructor(name) {
    this.name = name;
    this.images = { then: this.image("then"), now: this.image("now") };
    this.texts = { then: make("span", { class: "side left" }), now: make("span", { class: "side right" }) };
    this.edge = make("span", { class: "edge" });
    this.stage = make("div", { class: "wipe" }, this.images.then, this.images.now, this.edge, this.texts.then, this.texts.now);
    this.slider = make("input", { type: "range", min: 0, max: 100, value: 50, step: 1, "aria-label": `Then and now of camera ${name}` });
    this.slider.addEventListener("input", () => this.move());
    this.selects = { then: this.select("then", "Left"), now: this.select("now", "Right") };
    this.notes = make("div");
    this.chosen = make("div", { class: "chosen" }, ...Object.values(this.selects).map(({ label }) => label));
    this.frames = make("div", { class: "frames" }, this.slider);
    this.box = make("div", {}, this.stage, this.frames, this.chosen, this.notes);
    this.move();
  }

  image(side) {
    const image = make("img", { alt: "", decoding: "async", draggable: "false", hidden: true });
    image.addEventListener("load", () => {
      image.hidden = false;
      this.stage.style.aspectRatio = `${image.naturalWidth} / ${image.naturalHeight}`;
    });
    image.addEventListener("error", () => { image.hidden = true; this.texts[side].textContent = "no picture can be decoded here"; });
    return image;
  }

  select(side, text) {
    const select = make("select", { "aria-label": `${text} picture of camera ${this.name}` });
    select.addEventListener("change", () => this.load(side));
    return { select, label: make("label", { class: "field" }, make("span", {}, `${text} picture`), select) };
  }

  async update(version) {
    this.version = version;
    const told = await ask("/api/views", { camera: this.name }).catch((error) => ({ pictures: [], notes: [error.message] }));
    if (this.version !== version) return;
    show(this.notes, ...told.notes.map((one) => make("p", { class: "known" }, one)));
    for (const part of [this.stage, this.frames, this.chosen]) part.hidden = !told.pictures.length;
    this.pictures = { then: [], now: [] };
    for (const one of told.pictures) this.pictures[one.side].push(one);
    for (const side of ["then", "now"]) {
      show(this.selects[side].select, ...this.pictures[side].map((one, index) => make("option", { value: index }, one.label)));
      this.load(side);
    }
  }

  load(side) {
    const picture = this.pictures[side][Number(this.selects[side].select.value)];
    if (!picture) return;
    const image = this.images[side];
    image.alt = `Camera ${this.name} ${picture.label}, frame ${picture.frame}`;
    this.texts[side].textContent = picture.label;
    image.src = `/picture?${new URLSearchParams({ camera: this.name, of: picture.source, frame: picture.frame, v: this.version })}`;
  }

  // The edge follows the slider: then on its left, now on its right.
  move() {
    const share = Number(this.slider.value);
    this.images.now.style.clipPath = `inset(0 0 0 ${share}%)`;
    this.edge.style.left = `${share}%`;
    this.slider.setAttribute("aria-valuetext", `${share} % then, ${100 - share} % now`);
  }
}
