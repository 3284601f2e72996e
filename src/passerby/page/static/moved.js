// A camera that was moved while it filmed: which part of its recording is kept.

import { make, show } from "./dom.js";
import { Tool, field, read } from "./tools.js";

export class MovedTool extends Tool {
  start() { [this.camera, this.seconds] = [null, ""]; show(this.box); this.show(); }

  // The frame that is shown when it is clicked is the one at which the camera moved, unless another time is typed.
  click(view) {
    this.camera = view.name;
    const seconds = this.page.cameras.seconds(view.name);
    const typed = this.box.querySelector("[name=moved]")?.value ?? "";
    this.seconds = seconds === null ? typed : String(Math.round(100 * seconds) / 100);
    this.show();
  }

  show() {
    const kept = this.box.querySelector("[name=keep]:checked")?.value ?? "before";
    const choice = (value, text) => make("label", {}, make("input", { type: "radio", name: "keep", value, checked: value === kept }), text);
    const told = this.camera
      ? `Camera ${this.camera}: only the part that you keep is used, and its pose is the camera's. Leave a second for the move itself.`
      : "Below the picture of the camera, choose a frame just before or after it was moved; then click the picture.";
    show(this.box, this.form(
      make("p", {}, told),
      field("Moved at, seconds of its recording", { name: "moved", type: "number", min: "0", step: "any", required: true, value: this.seconds }),
      make("fieldset", { class: "choice" }, make("legend", {}, "Keep what it saw"), choice("before", "before"), choice("after", "after")),
      this.buttons("Keep this part", Boolean(this.camera))));
  }

  save(form) {
    const keep = form.querySelector("[name=keep]:checked").value;
    this.act({ act: "moved", camera: this.camera, at_s: read(form, "moved"), keep });
  }
}
