// The calibration at work, its verdict, and what is known so far.

import { find, make, number, show, table } from "./dom.js";

const WORDS = { running: "running", done: "finished", failed: "failed", stopped: "stopped: it goes on from there", none: "" };

export function showRun(state) {
  const { run, result } = state;
  const running = run.state === "running";
  const stale = run.version && run.version !== state.version && !running;
  find("start").hidden = running;
  find("start").disabled = state.faults.length > 0;
  find("start").textContent = run.state === "stopped" ? "Resume" : result ? "Solve again" : "Calibrate";
  find("stop").hidden = !running;
  find("run-state").textContent = stale && run.state === "done" ? "the scene file was changed since: solve again" : WORDS[run.state];
  const stages = running || run.state === "failed" ? run.stages : [];
  show(find("stages"), ...stages.map(stage), run.error ? make("li", { class: "error" }, run.error) : null);
}

function stage({ name, state, parts, seconds }) {
  const counted = Object.entries(parts).filter(([, [, total]]) => total);
  const bars = counted.map(([part, [done, total]]) => make("label", { class: "part" }, make("span", {}, part || name),
    make("progress", { max: total, value: done })));
  return make("li", { class: state }, make("span", {}, `${name}${state === "done" ? `, ${number(seconds, 1)} s` : ""}`),
    ...(state === "running" ? bars : []));
}

export function showResult(state) {
  const { result, before } = state;
  const pill = find("verdict-pill");
  pill.textContent = result ? result.verdict : "";
  pill.className = `pill verdict-${result?.verdict ?? "none"}`;
  if (!result) { show(find("result")); return; }
  const old = new Map((before?.cameras ?? []).map((one) => [one.name, one]));
  const rows = result.cameras.map((one) => [one.name, ...row(one), ...(before ? changes(one, old.get(one.name)) : [])]);
  const columns = ["camera", "x m", "y m", "z m", "heading °", "points std mm", "ground std mm", "position std mm", "rotation std °"];
  const more = before ? ["moved m", "turned °", "position std before mm"] : [];
  const verdict = before && before.verdict !== result.verdict ? `${before.verdict} before, ${result.verdict} now` : result.verdict;
  show(find("result"),
    make("div", { class: `banner verdict-${result.verdict}` }, make("strong", {}, verdict),
      make("ul", {}, ...result.reasons.map((one) => make("li", {}, one)))),
    table("The cameras of the rig", [...columns, ...more], rows),
    result.findings.length ? make("details", {}, make("summary", {}, `${result.findings.length} warnings`),
      make("ul", {}, ...result.findings.map((one) => make("li", {}, one)))) : null);
}

function row({ centre_m: centre, heading_deg, points_sigma_mm, ground_sigma_mm, position_sigma_mm, orientation_sigma_deg }) {
  return [...(centre ?? [null, null, null]).map((one) => number(one, 2)), number(heading_deg, 1),
    number(points_sigma_mm, 0), number(ground_sigma_mm, 0), number(position_sigma_mm, 0), number(orientation_sigma_deg, 2)];
}

function changes(now, old) {
  if (!old?.centre_m || !now.centre_m) return ["–", "–", "–"];
  const moved = Math.hypot(...now.centre_m.map((value, axis) => value - old.centre_m[axis]));
  const turned = ((now.heading_deg - old.heading_deg + 540) % 360) - 180;
  return [number(moved, 2), number(turned, 1), number(old.position_sigma_mm, 0)];
}

export function showCues(state, remove, include, keepAll) {
  find("scene-file").textContent = state.file;
  const lines = [];
  (state.lengths ?? []).forEach((one, index) => lines.push(
    cue(`Length ${index + 1}: ${one.metres} m, in ${Object.keys(one.points).join(", ")}`, () => remove("lengths", index + 1))));
  (state.checks ?? []).forEach((one, index) => lines.push(
    cue(`Check length ${index + 1}: ${one.metres} m, in ${(one.between ?? Object.keys(one.points)).join(", ")}`, () => remove("checks", index + 1))));
  (state.people ?? []).forEach((one, index) => lines.push(
    cue(`Person ${index + 1}: ${one.height_m} m${one.camera ? `, in ${one.camera}` : ""}`, () => remove("people", index + 1))));
  for (const [key, words] of [["same", "are the same person"], ["different", "are different people"]]) {
    (state[key] ?? []).forEach(({ boxes }, index) => lines.push(
      cue(`Boxes in ${boxes.map((one) => one.camera).join(", ")} ${words}`, () => remove(key, index + 1))));
  }
  (state.not_people ?? []).forEach(({ camera }, index) => lines.push(
    cue(`Box in ${camera} is not a person`, () => remove("not_people", index + 1))));
  for (const [name, { exclude, exclude_s }] of Object.entries(state.excluded ?? {})) {
    exclude.forEach((corners, index) => lines.push(
      cue(`Region ${index + 1} of ${name} is excluded: ${corners.length} corners`, () => include(name, "exclude", index + 1))));
    exclude_s.forEach(([begin, end], index) => lines.push(
      cue(`Camera ${name} is not used from ${begin} to ${end} s`, () => include(name, "exclude_s", index + 1))));
  }
  (state.lines ?? []).forEach(({ direction, points }, index) => lines.push(
    cue(`${direction === "x" ? "x axis along a line" : `A ${direction} line`} in ${Object.keys(points).join(", ")}`, () => remove("lines", index + 1))));
  for (const [name, { from_s, until_s }] of Object.entries(state.limits ?? {})) {
    if (from_s !== undefined) lines.push(cue(`Camera ${name} is used only after ${from_s} s`, () => keepAll(name, "from_s")));
    if (until_s !== undefined) lines.push(cue(`Camera ${name} is used only before ${until_s} s`, () => keepAll(name, "until_s")));
  }
  if (state.world) lines.push(make("li", {}, `World frame: set by ${state.world}`));
  const none = "Nothing yet: heights of people alone set the scale. One marked length makes it metric to a per cent.";
  show(find("cues"), lines.length ? make("ul", { class: "cues" }, ...lines) : make("p", { class: "nothing" }, none));
}

const cue = (text, remove) =>
  make("li", {}, text, " ", make("button", { type: "button", class: "quiet", onclick: remove, "aria-label": `Remove: ${text}` }, "Remove"));
