// The history of one camera: a bar for the score of each window, with the threshold. A move raises the scores of others as well.

import { draw, make, number, table } from "./dom.js";

const WIDTH = 1000, HEIGHT = 100, TOP = 3;

export function clock(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  const two = (value) => String(value).padStart(2, "0");
  return `${two(Math.floor(whole / 3600))}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

// Scores beyond three thresholds are as high as the drawing; the table has them.
export function history(name, state) {
  const { from_s: from, until_s: until, threshold, windows } = state;
  const over = (score) => (score ?? Infinity) >= threshold;
  const x = (seconds) => (WIDTH * (seconds - from)) / Math.max(until - from, 1e-9);
  const y = (score) => HEIGHT * (1 - Math.min(score, TOP * threshold) / (TOP * threshold));
  const own = windows.filter((one) => one.cameras[name]).map((one) => ({ ...one, ...one.cameras[name] }));
  const suspected = state.moves.filter((one) => one.camera === name || one.or.includes(name));
  const bars = own.map(({ from_s, until_s, score, told }) => {
    const [left, right] = [x(from_s), x(until_s)];
    const inset = Math.min(3, (right - left) / 6);
    const box = { x: left + inset, width: Math.max(right - left - 2 * inset, 0.5) };
    if (!told) return draw("rect", { ...box, y: 4, height: HEIGHT - 8, class: "bar-silent" });
    const high = Math.min(y(score ?? Infinity), HEIGHT - 1);
    return draw("rect", { ...box, y: high, height: HEIGHT - high, class: suspected.length && over(score) ? "bar-over" : "bar-quiet" });
  });
  const moments = suspected.filter((one) => one.seconds !== null).map(({ seconds }) => (
    draw("line", { x1: x(seconds), x2: x(seconds), y1: 0, y2: HEIGHT, class: "moment" })));
  const line = draw("line", { x1: 0, x2: WIDTH, y1: y(threshold), y2: y(threshold), class: "threshold" });
  const clear = own.filter((one) => one.told);
  const most = clear.length ? Math.max(...clear.map((one) => one.score ?? Infinity)) : null;
  const told = most === null ? "no window can test it" : `highest score ${score(most)}`;
  return make("figure", { class: "scores" },
    draw("svg", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img",
      "aria-label": `Scores of camera ${name} in ${own.length} windows: ${told}, threshold ${number(threshold)}`,
    }, ...bars, line, ...moments),
    make("div", { class: "span", "aria-hidden": "true" }, make("span", {}, clock(from)), make("span", {}, clock(until))),
    make("figcaption", {}, `Score of each window of ${number(state.window_s, 0)} s: how strongly people contradict its pose. ` +
      `Line: threshold ${number(threshold)}. ${told[0].toUpperCase()}${told.slice(1)}.${moments.length ? " Dashed: when it moved." : ""}` +
      `${!suspected.length && clear.some((one) => over(one.score)) ? " Another camera that moved raises it, too." : ""}` +
      `${clear.length < own.length ? " Outlined: too few people." : ""}`),
    make("details", {}, make("summary", {}, `Windows of camera ${name}`),
      table(`Windows of camera ${name}`, ["from", "to", "score"],
        own.map((one) => [clock(one.from_s), clock(one.until_s), one.told ? score(one.score ?? Infinity) : "too few people"]))));
}

const score = (value) => (Number.isFinite(value) ? number(value, 1) : "beyond all bounds");
