"use strict";
/* Integrates the loop, finds its poles and the peak of |S|, and draws them. Every equation is in
   `P`, printed from the lowered programs; `D` holds the rig. */

const bound = (value) => (value === null ? Infinity : value);
D.known.u_max = bound(D.known.u_max);
D.known.gap_high = bound(D.known.gap_high);

/* The design's controller with other poles, on a plant whose beta is beta_c/ratio. */
function designed(set) {
  const gains = P.gains(set);
  const known = { ...D.known, ...gains, beta: D.known.beta_c / set.ratio };
  return { known: { ...known, ...P.coefficients(known) }, gains };
}

/* The nonlinear plant under the sampled law, by Runge-Kutta 4 between changes of the voltage. */
function simulated({ known }) {
  const x = { ...known, t: 0, ...D.initial };
  Object.assign(x, P.reference(x));
  const own = P.start(x), states = Object.keys(own);
  Object.assign(x, own);
  let pipeline = Array(D.held).fill(P.feedforward(x).applied);
  let alive = true;
  const point = { ...known };
  const acceleration = (y, u) => {
    point.y = Math.max(y, known.gap_low / 2);
    point.u = u;
    return P.acceleration(point).acc;
  };
  const run = { t: [0], y: [x.y], ref: [x.y_ref], commanded: [], applied: [] };
  const sums = { ise: 0, iae: 0, itae: 0 };
  let peak = -Infinity, least = Infinity;
  for (let k = 0; k < D.periods; k++) {
    const begin = k * known.T, end = k + 1 === D.periods ? D.horizon : (k + 1) * known.T;
    const out = P.step(x);
    run.commanded.push(out.commanded);
    run.applied.push(out.applied);
    if (alive) {
      peak = Math.max(peak, out.commanded);
      least = Math.min(least, out.commanded);
    }
    pipeline = [out.applied, ...pipeline];
    const early = Math.min(known.T_1, end - begin);
    let clock = begin;
    for (const [part, count, voltage] of [
      [early, D.substeps[0], pipeline[D.whole + 1]],
      [end - begin - early, D.substeps[1], pipeline[D.whole]],
    ]) {
      for (let n = 0; n < count; n++) {
        const h = part / count, half = h * 0.5, { y, v } = x;
        const e_start = y - x.y_ref, slope_start = v - x.v_ref;
        const a1 = acceleration(y, voltage);
        const v2 = v + half * a1, a2 = acceleration(y + half * v, voltage);
        const v3 = v + half * a2, a3 = acceleration(y + half * v2, voltage);
        const v4 = v + h * a3, a4 = acceleration(y + h * v3, voltage);
        const moved = y + (h * (v + 2 * (v2 + v3) + v4)) / 6;
        const faster = v + (h * (a1 + 2 * (a2 + a3) + a4)) / 6;
        const inside = moved > known.gap_low && moved < known.gap_high;
        if (alive) x.y = Math.min(Math.max(moved, known.gap_low), known.gap_high);
        alive = alive && inside;
        x.v = alive ? faster : 0;
        clock += h;
        x.t = clock;
        Object.assign(x, P.reference(x));
        const step = P.metrics({
          e_start, slope_start, e_end: x.y - x.y_ref, slope_end: x.v - x.v_ref,
          t_start: clock - h, h,
        });
        for (const name of Object.keys(sums)) sums[name] += step[name];
      }
    }
    pipeline.length = D.held;
    for (const name of states) x[name] = out[name + "_next"];
    run.t.push(end);
    run.y.push(x.y);
    run.ref.push(x.y_ref);
  }
  return { ...run, ...sums, peak, least, alive };
}

/* Numerator and denominator of the sampled open loop at a gap, highest power first. */
function openLoop({ known }, gap) {
  const rest = P.plant({ ...known, y: gap });
  const { slope } = P.slope({ ...known, u: rest.U, y_ref: gap });
  const loop = P.sampled_loop({ ...known, loop_gain: rest.C_U * slope, C_Y_true: rest.C_Y });
  const part = (name) => Object.keys(loop).filter((key) => key.startsWith(name)).map((key) => loop[key]);
  const denominator = [...part("den"), ...Array(D.whole).fill(0)];
  const numerator = part("num");
  const closed = denominator.map((c, n) => c + (numerator[n - denominator.length + numerator.length] ?? 0));
  return { denominator, closed };
}

/* The value of a polynomial at the complex number a + jb. */
function value(coefficients, a, b) {
  let re = 0, im = 0;
  for (const c of coefficients) [re, im] = [re * a - im * b + c, re * b + im * a];
  return [re, im];
}

/* All roots at once, by Durand and Kerner. */
function roots(coefficients) {
  const monic = coefficients.map((c) => c / coefficients[0]), degree = monic.length - 1;
  const z = Array.from({ length: degree }, (_, k) => {
    const angle = (2 * Math.PI * k) / degree + 0.4;
    return [0.9 * Math.cos(angle), 0.9 * Math.sin(angle)];
  });
  for (let turn = 0; turn < 500; turn++) {
    let change = 0;
    for (let k = 0; k < degree; k++) {
      let [nr, ni] = value(monic, ...z[k]), dr = 1, di = 0;
      for (let j = 0; j < degree; j++) {
        if (j === k) continue;
        const [a, b] = [z[k][0] - z[j][0], z[k][1] - z[j][1]];
        [dr, di] = [dr * a - di * b, dr * b + di * a];
      }
      const size = dr * dr + di * di || 1e-300;
      const [a, b] = [(nr * dr + ni * di) / size, (ni * dr - nr * di) / size];
      z[k] = [z[k][0] - a, z[k][1] - b];
      change = Math.max(change, Math.hypot(a, b));
    }
    if (change < 1e-15) break;
  }
  return z;
}

/* |S| = |D|/|D + N| over the frequencies up to Nyquist's, and its peak. */
function sensitivity(loop, T) {
  const size = (theta) => {
    const [a, b] = [Math.cos(theta), Math.sin(theta)];
    return Math.hypot(...value(loop.denominator, a, b)) / Math.hypot(...value(loop.closed, a, b));
  };
  const count = 240, low = Math.log(1e-3 * Math.PI), width = (Math.log(Math.PI) - low) / (count - 1);
  const thetas = Array.from({ length: count }, (_, n) => Math.exp(low + n * width));
  const sizes = thetas.map(size);
  let best = thetas[sizes.indexOf(Math.max(...sizes))], reach = width;
  for (let zoom = 0; zoom < 9; zoom++, reach /= 4) {
    let top = -Infinity, at = best;
    for (let n = -4; n <= 4; n++) {
      const theta = Math.min(best * Math.exp((reach * n) / 4), Math.PI);
      if (size(theta) > top) [top, at] = [size(theta), theta];
    }
    best = at;
  }
  return { omega: thetas.map((theta) => theta / T), sizes, ms: size(best), at: best / T };
}

function computed(set) {
  const controller = designed(set);
  const loops = D.gaps.map((gap) => {
    const loop = openLoop(controller, gap), z = roots(loop.closed);
    return { gap, z, radius: Math.max(...z.map((p) => Math.hypot(...p))), s: sensitivity(loop, D.known.T) };
  });
  return { ...controller, run: simulated(controller), loops };
}

/* Drawing */

const NS = "http://www.w3.org/2000/svg";
const W = 420, H = 260, LEFT = 58, RIGHT = 12, TOP = 26, BOTTOM = 40;

function add(parent, name, attributes, text) {
  const node = document.createElementNS(NS, name);
  for (const [key, item] of Object.entries(attributes)) node.setAttribute(key, item);
  if (text !== undefined) node.textContent = text;
  parent.append(node);
  return node;
}

function ticks(low, high) {
  const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) found.push(n * step);
  return found;
}

const short = (x) => String(Number(x.toPrecision(4))).replace("-", "−");

/* One chart: axes with units, curves [{x, y, kind}], marks [{x, y, kind}], dotted lines across at
   `limits` and upright at `upright`. */
function chart(svg, { title, xlabel, ylabel, curves, marks = [], limits = [], log = false, upright = null }) {
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
  const place = log ? Math.log10 : (x) => x;
  const finite = (list) => list.filter(Number.isFinite);
  const xs = finite([...curves.flatMap(({ x }) => [place(x[0]), place(x[x.length - 1])]), ...marks.map(({ x }) => x), upright ?? NaN]);
  const ys = finite([...curves.flatMap(({ y }) => y), ...marks.map(({ y }) => y), ...limits]);
  const ends = (list) => list.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  const wider = ([a, b], share) => (b > a ? [a - share * (b - a), b + share * (b - a)] : [a - 1, b + 1]);
  const [x0, x1] = wider(ends(xs), marks.length ? 0.06 : 0), [y0, y1] = wider(ends(ys), 0.05);
  const wide = W - LEFT - RIGHT;
  const px = (x) => LEFT + ((place(x) - x0) / (x1 - x0)) * wide;
  const py = (y) => H - BOTTOM - ((y - y0) / (y1 - y0)) * (H - TOP - BOTTOM);
  const xt = log ? Array.from({ length: Math.floor(x1) - Math.ceil(x0) + 1 }, (_, n) => 10 ** (Math.ceil(x0) + n)) : ticks(x0, x1);
  for (const x of xt) {
    add(svg, "line", { class: "grid", x1: px(x), x2: px(x), y1: TOP, y2: H - BOTTOM });
    add(svg, "text", { class: "tick", x: px(x), y: H - BOTTOM + 14, "text-anchor": "middle" }, short(x));
  }
  for (const y of ticks(y0, y1)) {
    add(svg, "line", { class: "grid", x1: LEFT, x2: LEFT + wide, y1: py(y), y2: py(y) });
    add(svg, "text", { class: "tick", x: LEFT - 5, y: py(y) + 4, "text-anchor": "end" }, short(y));
  }
  for (const y of limits) add(svg, "line", { class: "limit", x1: LEFT, x2: LEFT + wide, y1: py(y), y2: py(y) });
  if (upright !== null) add(svg, "line", { class: "limit", x1: px(upright), x2: px(upright), y1: TOP, y2: H - BOTTOM });
  for (const { x, y, kind } of curves) {
    const stride = Math.max(1, Math.ceil(x.length / 1200));
    let d = "", pen = "M";
    for (let n = 0; n < x.length; n += stride) {
      if (!Number.isFinite(y[n])) { pen = "M"; continue; }
      d += `${pen}${px(x[n]).toFixed(2)} ${py(y[n]).toFixed(2)}`;
      pen = "L";
    }
    add(svg, "path", { class: `curve ${kind}`, d });
  }
  for (const { x, y, kind } of marks) {
    const [a, b, r] = [px(x), py(y), 4];
    add(svg, "path", { class: `mark ${kind}`, d: `M${a - r} ${b - r}L${a + r} ${b + r}M${a - r} ${b + r}L${a + r} ${b - r}` });
  }
  add(svg, "text", { class: "title", x: LEFT, y: 15 }, title);
  add(svg, "text", { class: "label", x: LEFT + wide / 2, y: H - 6, "text-anchor": "middle" }, xlabel);
  add(svg, "text", { class: "label", x: 0, y: 0, "text-anchor": "middle", transform: `translate(13 ${(TOP + H - BOTTOM) / 2}) rotate(-90)` }, ylabel);
}

function draw(now, saved) {
  const at = (id) => document.getElementById(id);
  const both = (make) => [...make(saved, "saved"), ...make(now, "now")];
  const micro = (run) => run.y.map((y, n) => 1e6 * (y - run.ref[n]));
  const split = now.run.t.findIndex((t) => t > D.early);
  const first = (list) => list.slice(0, split), rest = (list) => list.slice(split);
  chart(at("plot-gap"), {
    title: "Tracking", xlabel: "time t [s]", ylabel: "gap y [mm]",
    curves: [
      ...both(({ run }, kind) => [{ x: run.t, y: run.y.map((y) => 1e3 * y), kind }]),
      { x: now.run.t, y: now.run.ref.map((y) => 1e3 * y), kind: "reference" },
    ],
  });
  chart(at("plot-start"), {
    title: "Error, the start", xlabel: "time t [s]", ylabel: "error e [µm]",
    curves: both(({ run }, kind) => [{ x: first(run.t), y: first(micro(run)), kind }]),
  });
  chart(at("plot-rest"), {
    title: "Error, the rest", xlabel: "time t [s]", ylabel: "error e [µm]",
    curves: both(({ run }, kind) => [{ x: rest(run.t), y: rest(micro(run)), kind }]),
  });
  chart(at("plot-voltage"), {
    title: "Commanded voltage, the start", xlabel: "time t [s]", ylabel: "voltage u [V]",
    curves: both(({ run }, kind) => [{ x: first(run.t), y: first(run.commanded), kind }]),
    limits: [D.known.u_min, D.known.u_max].filter(Number.isFinite),
  });
  const dash = ["", " far"], { T } = D.known;
  const reach = 8 * Math.max(...D.sliders.filter(({ unit }) => unit === "rad/s").map(({ value }) => value));
  chart(at("plot-poles"), {
    title: "Poles of the sampled loop, as s = ln(z)/T", xlabel: "real part [1/s]", ylabel: "imaginary part [rad/s]",
    curves: [],
    upright: 0,
    marks: both(({ loops }, kind) => loops.flatMap(({ z }, n) => z
      .map(([a, b]) => ({ x: Math.log(Math.hypot(a, b)) / T, y: Math.atan2(b, a) / T, kind: kind + dash[n] }))
      .filter(({ x, y }) => Math.hypot(x, y) < reach))),
  });
  chart(at("plot-sensitivity"), {
    title: "Sensitivity of the sampled loop", xlabel: "frequency ω [rad/s]", ylabel: "|S| [-]", log: true,
    curves: both(({ loops }, kind) => loops.map(({ s }, n) => ({ x: s.omega, y: s.sizes, kind: kind + dash[n] }))),
    limits: [1],
  });
}

/* The page */

const state = {};

function settings() {
  const set = {};
  for (const slider of D.sliders) for (const name of slider.sets) set[name] = state[slider.id];
  return set;
}

function show(id, number, text) {
  const node = document.getElementById(id);
  node.dataset.value = String(number);
  node.textContent = text;
}

/* Four digits, with a raised power of ten where there are many zeros. */
function engineering(x) {
  if (!Number.isFinite(x)) return "none";
  const power = x === 0 ? 0 : Math.floor(Math.log10(Math.abs(x)));
  if (power >= -4 && power < 5) return short(x);
  const raised = [...String(power)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
  return `${short(x / 10 ** power)} × 10${raised}`;
}

function refresh(saved) {
  const now = computed(settings());
  draw(now, saved);
  const { run, loops, gains } = now;
  for (const name of ["ise", "iae", "itae"]) show(name, run[name], engineering(run[name]));
  show("peak", run.peak, engineering(run.peak));
  show("least", run.least, engineering(run.least));
  show("ms", Math.max(...loops.map(({ s }) => s.ms)), engineering(Math.max(...loops.map(({ s }) => s.ms))));
  const radius = Math.max(...loops.map((loop) => loop.radius));
  show("radius", radius, engineering(radius));
  const fate = run.alive ? (radius < 1 ? "stable" : "unstable near rest") : "the ball is lost";
  show("fate", run.alive ? 1 : 0, fate);
  for (const [name, gain] of Object.entries(gains)) show(`gain-${name}`, gain, engineering(gain));
  for (const slider of D.sliders) {
    const x = state[slider.id];
    document.getElementById(slider.id).value = Math.log(x);
    document.getElementById(`${slider.id}-number`).value = Number(x.toPrecision(5));
    document.getElementById(slider.id).dataset.value = String(x);
  }
  document.body.dataset.ready = String(Number(document.body.dataset.ready ?? 0) + 1);
}

function begin() {
  for (const slider of D.sliders) state[slider.id] = slider.value;
  const saved = computed(settings());
  const read = () => {
    for (const [name, text] of new URLSearchParams(location.hash.slice(1))) {
      const x = Number(text);
      if (D.sliders.some((slider) => slider.id === name) && Number.isFinite(x) && x > 0) state[name] = x;
    }
  };
  read();
  for (const slider of D.sliders) {
    const range = document.getElementById(slider.id);
    range.min = Math.log(slider.low);
    range.max = Math.log(slider.high);
    range.addEventListener("input", () => { state[slider.id] = Math.exp(Number(range.value)); refresh(saved); });
    document.getElementById(`${slider.id}-number`).addEventListener("change", (event) => {
      const x = Number(event.target.value);
      if (Number.isFinite(x) && x > 0) state[slider.id] = x;
      refresh(saved);
    });
  }
  document.getElementById("back").addEventListener("click", () => {
    for (const slider of D.sliders) state[slider.id] = slider.value;
    refresh(saved);
  });
  window.addEventListener("hashchange", () => { read(); refresh(saved); });
  refresh(saved);
}
