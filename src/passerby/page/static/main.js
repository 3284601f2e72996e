// The page: asks for the state again and again, and shows it.

import { Cameras } from "./cameras.js";
import { find, make, show } from "./dom.js";
import { PlanView } from "./plan.js";
import { PlanPlacer } from "./plan_place.js";
import { MovedTool } from "./moved.js";
import { showCues, showResult, showRun } from "./results.js";
import { showTop, sorted } from "./faults.js";
import { ask, send } from "./server.js";
import { IdentityTool, LengthTool, LineTool, PersonTool, RegionTool, TimeTool, WorldTool } from "./tools.js";

const FAST_MS = 300, SLOW_MS = 3000, PICTURES_MS = 4000;

class Page {
  constructor() {
    this.state = null;
    this.checked = "";
    this.shown = "";
    this.reported = "";
    this.top = { faults: [], notes: [] };
    this.cameras = new Cameras(this);
    this.planView = new PlanView(this);
    this.plan = new PlanPlacer(this);
    this.tools = {
      length: new LengthTool(this), world: new WorldTool(this), person: new PersonTool(this), region: new RegionTool(this),
      time: new TimeTool(this), identity: new IdentityTool(this), line: new LineTool(this), plan: this.plan,
      moved: new MovedTool(this),
    };
    this.tool = null;
    this.answered = 0;
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.addEventListener("click", () => this.choose(button.dataset.tool));
    }
    find("start").addEventListener("click", () => this.command("/api/start"));
    find("stop").addEventListener("click", () => this.command("/api/stop"));
    find("undo").addEventListener("click", () => this.act({ act: "undo" }));
    document.addEventListener("keydown", (event) => { if (event.key === "Escape") this.choose("look"); });
  }

  posed(name) { return this.state.posed.some(([one]) => one === name); }
  regions(name) { return this.state?.excluded?.[name]?.exclude ?? []; }
  boxes(name) { return this.cameras.cards.get(name)?.boxes ?? []; }

  async poll() {
    const answered = this.answered;
    try {
      const state = await ask("/api/state");
      if (answered === this.answered) this.update(state); // else an act was answered meanwhile: this state may be older
    } catch (error) {
      this.tell(error.message === "Failed to fetch" ? "The server does not answer: is `passerby open` still running?" : error.message);
    }
    setTimeout(() => this.poll(), this.state?.run.state === "running" ? FAST_MS : SLOW_MS);
  }

  accept(state) {
    this.answered += 1;
    this.update(state);
  }

  update(state) {
    const changed = this.state && this.state.version !== state.version;
    this.state = state;
    const text = JSON.stringify(state);
    if (text === this.shown) return;
    this.shown = text;
    document.title = `${state.name} – Passerby`;
    find("scene-name").textContent = state.name;
    find("undo").disabled = !state.can_undo;
    this.cameras.update(state);
    this.planView.update(state);
    this.plan.update(state);
    showRun(state);
    this.showTop();
    showResult(state);
    showCues(state, (key, number) => this.act({ act: "remove", key, number }),
      (camera, key, number) => this.act({ act: "include", camera, key, number }),
      (camera, key) => this.act({ act: "keep_all", camera, key }));
    this.report();
    if (this.checked !== state.version) this.check(state.version);
    if (changed) this.redraw();
  }

  async check(version) {
    this.checked = version;
    await this.cameras.pictures(PICTURES_MS);
    const told = await ask("/api/check").catch((error) => this.tell(error.message));
    if (!told) return;
    const { own, top } = sorted(told);
    this.cameras.check(told, own);
    this.top = top;
    this.showTop();
  }

  showTop() { showTop(this.state.faults.length ? this.state.faults : this.top.faults, this.top.notes); }

  report() {
    if (this.state.report === this.reported) return;
    this.reported = this.state.report;
    show(find("report-box"), this.reported
      ? make("iframe", { src: `/report?${this.reported}`, sandbox: "allow-scripts", title: "Report of the calibration", loading: "lazy" })
      : make("p", { class: "nothing" }, "There is no report yet."));
  }

  choose(name) {
    this.tool = this.tools[name] ?? null;
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.setAttribute("aria-pressed", String(button.dataset.tool === (this.tool ? name : "look")));
    }
    document.body.classList.toggle("marking", Boolean(this.tool));
    find("tool").hidden = !this.tool;
    find("magnifier").hidden = true;
    this.tool?.start();
    this.plan.chosen(name);
    this.redraw();
  }

  click(view, at) { this.tool?.click(view, at); }

  redraw() {
    for (const [name, { view }] of this.cameras.cards) view.redraw(this.tool ? this.tool.drawing(name) : this.saved(name));
  }

  saved(name) {
    const ends = (this.state?.lengths ?? []).map((one) => one.points[name]).filter(Boolean);
    return { links: ends, marks: ends.flat().map((at) => ({ at })), regions: this.regions(name) };
  }

  leaveOut(name) { this.act({ act: "leave_out", camera: name }); }

  // Whether it was done. An act on an older scene file is not: the page shows what was changed.
  async act(content) {
    try {
      this.accept(await send("/api/act", { ...content, version: this.state.version }));
      this.tell("");
      return true;
    } catch (error) {
      this.tell(error.message);
      if (error.stale) this.accept(await ask("/api/state"));
      return false;
    }
  }

  async command(path) {
    await send(path).then((state) => this.accept(state), (error) => this.tell(error.message));
  }

  tell(text) {
    find("message").textContent = text;
    find("message").hidden = !text;
  }
}

new Page().poll();
