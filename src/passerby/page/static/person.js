// The person who was clicked, cut out of the pictures of all cameras that saw the same identity.

import { draw, make, number } from "./dom.js";
import { send } from "./server.js";

const MARGIN = 0.25;

// Elements to be shown below the form: who it is, as the last calibration has it, and what it looks like elsewhere.
export async function samePerson({ camera, frame, at }) {
  const told = await send("/api/person", { camera, frame, at }).catch((error) => ({ error: error.message }));
  if (told.error) return make("p", { class: "known" }, told.error);
  if (told.identity === null) {
    return make("p", { class: "known" }, "The last calibration has identified no person here. The height still counts if a calibration finds one.");
  }
  const [own, ...others] = told.seen;
  const many = others.length + told.further.length;
  const rest = [
    told.further.length ? `also seen by ${told.further.join(", ")}` : "",
    told.unseen.length ? `never seen by ${told.unseen.join(", ")}` : "",
  ].filter(Boolean).join("; ");
  const lead = many ? "Is this the same person everywhere?" : "No other camera has seen this person.";
  return make("div", { class: "same" },
    make("p", {}, `Person ${told.identity} of the last calibration. ${lead}${rest ? ` (${rest})` : ""}`),
    make("div", { class: "crops", role: "group", tabindex: "0", "aria-label": `Person ${told.identity} in each camera` },
      ...[own, ...others].map((one) => crop(one, told.identity))));
}

function crop({ camera, frame, box: [left, top, width, height], size, late_s, late_frames }, identity) {
  const pad = MARGIN * height;
  const picture = draw("svg", {
    viewBox: [left - pad, top - pad, width + 2 * pad, height + 2 * pad].map((one) => one.toFixed(1)).join(" "), role: "img",
    "aria-label": `Person ${identity} in camera ${camera}, frame ${frame}`,
  });
  // OpenCV's pixels: the centre of the first one is (0, 0).
  const image = draw("image", {
    x: -0.5, y: -0.5, width: size[0], height: size[1], preserveAspectRatio: "none",
    href: `/picture?${new URLSearchParams({ camera, frame })}`,
  });
  const text = make("figcaption", {}, `${camera}, ${late(late_s, late_frames)}`);
  image.addEventListener("error", () => { text.textContent += ", no picture"; });
  const outline = draw("rect", { x: left, y: top, width, height, class: "box", "stroke-width": height / 90 });
  picture.append(image, outline);
  return make("figure", { class: "crop" }, picture, text);
}

function late(seconds, frames) {
  if (!frames) return "same moment";
  const [size, unit] = seconds === null ? [Math.abs(frames), Math.abs(frames) === 1 ? "frame" : "frames"] : [number(Math.abs(seconds), 1), "s"];
  return `${size} ${unit} ${frames > 0 ? "later" : "earlier"}`;
}
