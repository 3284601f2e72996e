// The page of a monitored rig: which cameras moved, and their pictures then and now. It asks again, for the rig may be monitored again.

import { find, make, number, show, table } from "./dom.js";
import { clock, history } from "./scores.js";
import { ask } from "./server.js";
import { Wipe } from "./wipe.js";

const POLL_MS = 3000;
const KINDS = { steady: "state-steady", "cannot tell": "state-unknown" };
const kind = (state) => KINDS[state] ?? "state-moved";

class Page {
  constructor() { this.version = null; this.wipes = new Map(); }

  async poll() {
    try {
      const state = await ask("/api/monitor");
      this.tell("");
      if (state.version !== this.version) this.update(state);
    } catch (error) {
      this.tell(error.message === "Failed to fetch" ? "The server does not answer: is `passerby open` still running?" : error.message);
    }
    setTimeout(() => this.poll(), POLL_MS);
  }

  update(state) {
    this.version = state.version;
    document.title = `${state.name} – Passerby`;
    find("folder-name").textContent = state.name;
    const { text, state: worst } = verdict(state);
    find("state-pill").textContent = text;
    find("state-pill").className = `pill ${kind(worst)}`;
    find("about").textContent = about(state);
    show(find("summary"), banner(state, text, worst), limits(state),
      ...state.notes.map((one) => make("p", { class: "known" }, `Note: ${one}`)));
    show(find("grid"), ...state.cameras.map((one) => this.card(one, state)));
  }

  card(camera, state) {
    const { name } = camera;
    if (!this.wipes.has(name)) this.wipes.set(name, new Wipe(name));
    const wipe = this.wipes.get(name);
    wipe.update(state.version);
    const moves = state.moves.filter((one) => one.camera === name || one.or.includes(name));
    return make("article", { class: "camera", "aria-label": `Camera ${name}` },
      make("header", {}, make("h3", {}, name), make("span", { class: `state ${kind(camera.state)}` }, camera.state)),
      wipe.box,
      camera.carried ? make("p", { class: "known" }, `No news since ${camera.as_of ?? "the last run"}: this is what an earlier run found.`) : null,
      moves.length ? make("ul", { class: "moves" }, ...moves.map((one) => make("li", {}, sentence(one)))) : null,
      camera.new_pose ? make("p", { class: "known" }, "rig.toml in this folder has its new pose.") : null,
      camera.carried ? null : history(name, state));
  }

  tell(text) {
    find("message").textContent = text;
    find("message").hidden = !text;
  }
}

function verdict({ cameras }) {
  const count = (...states) => cameras.filter((one) => states.includes(one.state)).length;
  const moved = count("moved", "one of several moved"), silent = count("cannot tell");
  if (moved) return { text: count("moved") ? `${count("moved")} of ${cameras.length} moved` : "one of several moved", state: "moved" };
  if (silent) return { text: `${silent} of ${cameras.length} cannot be tested`, state: "cannot tell" };
  return { text: "all cameras steady", state: "steady" };
}

function about({ rig, footage, from_s, until_s, by_joints }) {
  const where = rig ? `Rig ${rig}` : "The rig";
  return `${where}, ${footage ? `footage of ${footage}` : "new footage"}, ${clock(from_s)} to ${clock(until_s)} by the rig's clock, ` +
    `tested by ${by_joints ? "keypoints and boxes" : "boxes"}.`;
}

function banner(state, text, worst) {
  const lines = state.moves.map((one) => make("li", {}, `${[one.camera, ...one.or].join(" or ")} ${sentence(one)}`));
  if (state.most_moved.length) {
    lines.push(make("li", {}, `Most cameras moved relative to each other (${state.most_moved.join(", ")}): calibrate anew.`));
  }
  return make("div", { class: `banner ${kind(worst)}` }, make("strong", {}, text), lines.length ? make("ul", {}, ...lines) : null);
}

// "moved at 00:01:30 (between 00:01:28 and 00:01:31), by 0.067 ± 0.032 m and 1.40 ± 0.20°; noticed at 00:01:50"
function sentence(move) {
  const when = move.seconds === null ? "before the footage began"
    : `at ${clock(move.seconds)} (between ${clock(move.from_s)} and ${clock(move.until_s)})`;
  const known = [move.metres, move.metres_sigma, move.degrees, move.degrees_sigma].every((one) => one !== null);
  const much = known
    ? `, by ${number(move.metres, 3)} ± ${number(move.metres_sigma, 3)} m and ${number(move.degrees, 2)} ± ${number(move.degrees_sigma, 2)}°`
    : "; too few people to estimate by how much";
  const which = move.or.length ? `, if it was ${move.camera}: the people do not show which` : "";
  return `moved ${when}${much}${which}; noticed ${move.carried ? "in an earlier run " : ""}at ${clock(move.noticed_s)}`;
}

function limits({ cameras, window_s }) {
  const columns = ["camera", "state", `windows of ${number(window_s, 0)} s`, "detection limit m", "limit °", "worst direction m", "worst °"];
  return table("State and detection limits", columns, cameras.map((one) => [one.name, one.state, `${one.windows_told} of ${one.windows}`,
    number(one.smallest_shift_m, 2), number(one.smallest_turn_deg, 1), number(one.worst_shift_m, 2), number(one.worst_turn_deg, 1)]));
}

new Page().poll();
