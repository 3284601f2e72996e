// What is wrong or found, beside the camera that it is about; what concerns several cameras or the scene stays at the top.

import { find, make, number, show } from "./dom.js";

export const list = (className, texts) => (texts.length ? make("ul", { class: className }, ...texts.map((one) => make("li", {}, one))) : null);

// Of `passerby check`: by camera and for the top, faults and doubts (which stop a rig from being accepted), and notices.
export function sorted(told) {
  const own = new Map(told.cameras.map((one) => [one.name, { faults: [...one.faults], notes: [] }]));
  const beside = new Set(told.cameras.flatMap((one) => one.faults));
  const top = { faults: told.faults.filter((one) => !beside.has(one)), notes: [] };
  for (const { severity, cameras, text } of told.diagnostics) {
    const place = (cameras.length === 1 && own.get(cameras[0])) || top;
    (severity === "notice" ? place.notes : place.faults).push(text);
  }
  return { own, top };
}

// Of a scene file that cannot be read: those that name the table of a camera.
export const ofTable = (faults, name) => faults.filter((one) => one.includes(`[cameras.${name}]`) || one.includes(`[cameras."${name}"]`));

export function showTop(faults, notes) {
  show(find("faults"), list("faults", faults));
  const text = notes.length === 1 ? "1 notice" : `${notes.length} notices`;
  if (find("notices").textContent === [text, ...notes].join("")) return; // it may be open
  show(find("notices"), notes.length ? make("details", { class: "muted" }, make("summary", {}, text), list("notes", notes)) : null);
}

// "Found: focal length 1203 ± 15 px · clock +0.213 ± 0.004 s · position ± 42 mm, rotation ± 0.20°"
export function found(one) {
  if (!one.registered) return "The last calibration could not register this camera.";
  const told = [];
  if (one.focal_px !== null) told.push(`focal length ${number(one.focal_px, 0)} ± ${number(one.focal_sigma_px, 0)} px`);
  if (one.time_offset_s === 0 && !one.time_offset_sigma_s) told.push("clock of the rig");
  else if (one.time_offset_s !== null && one.fps !== null) {
    const sure = one.time_offset_sigma_s === null ? "" : ` ± ${number(one.time_offset_sigma_s, 3)}`;
    told.push(`clock ${one.time_offset_s < 0 ? "−" : "+"}${number(Math.abs(one.time_offset_s), 3)}${sure} s`);
  }
  const [place, turn] = [one.position_sigma_mm, one.orientation_sigma_deg];
  told.push(place === null ? "position unknown" : `position ± ${number(place, 0)} mm, rotation ± ${number(turn, 2)}°`);
  return `Found: ${told.join(" · ")}`;
}
