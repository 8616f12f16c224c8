"use strict";
// An orthographic camera for the scenes of deploy/report/plots/scene_3d.py. The axis z points up; the azimuth turns
// the camera about it, the elevation lifts it.
(() => {
  const TRAIL_S = 2, HALF_STEP_S = 0.005, NAMES_PX = [60, 30], PER_PX_DEG = 0.5;
  const LIVE_EVERY_MS = 250;
  const AXES = ["x", "y", "z"];
  const UNITS = { time: " s", azimuth: "\u00b0", elevation: "\u00b0", zoom: "\u00d7" };
  const scenes = [];

  // Directions of the screen's right and up in space.
  const directions = (azimuthDeg, elevationDeg) => {
    const a = azimuthDeg * Math.PI / 180, e = elevationDeg * Math.PI / 180;
    return {
      right: [-Math.sin(a), Math.cos(a), 0],
      up: [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
    };
  };
  const dot = (one, other) => one[0] * other[0] + one[1] * other[1] + one[2] * other[2];

  // The number of entries of an ascending column that are at most `value`.
  const countUpTo = (column, value) => {
    let low = 0, high = column.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (column[middle] <= value) low = middle + 1;
      else high = middle;
    }
    return low;
  };

  class Scene {
    constructor(controls, doc) {
      this.figure = doc.get_model_by_name(controls.dataset.scene);
      this.paths = doc.get_model_by_name(this.figure.tags[0]);
      const ranges = new Map(Object.entries(this.figure.extra_x_ranges));
      this.box = AXES.map((axis) => ranges.get(axis));
      this.inputs = Object.fromEntries([...controls.querySelectorAll("input")].map((one) => [one.dataset.camera, one]));
      this.errors = controls.querySelector("[data-errors]");
      this.button = controls.querySelector("[data-play]");
      this.isLive = "live" in controls.dataset;
      this.kept = null;  // columns of a live page at the instant of the pause
      this.begunMs = null;
      this.drawn = "";
      controls.addEventListener("input", (event) => {
        if (event.target === this.inputs.time) this.isLive ? this.pause(true) : this.play(false);
        this.draw();
      });
      this.button.addEventListener("click", () => {
        if (this.isLive) this.pause(this.kept === null);
        else this.play(this.begunMs === null);
      });
      this.turnByDragging(controls.parentElement.querySelector(".plot, .figure"));
      const draw = () => this.drawSoon();
      this.figure.properties.inner_width.change.connect(draw);
      this.figure.properties.inner_height.change.connect(draw);
      this.paths.properties.data.change.connect(draw);
      this.paths.streaming.connect(draw);
      for (const range of this.box) range.change.connect(draw);
      this.draw();
    }

    // One update of a live page changes the paths and the box in many steps, all drawn at once and not too often.
    drawSoon() {
      if (this.waits) return;
      this.waits = true;
      const draw = () => { this.waits = false; this.draw(); };
      setTimeout(draw, this.isLive ? LIVE_EVERY_MS : 0);
    }

    value(name) { return Number(this.inputs[name].value); }

    column(name) { return this.kept?.get(name) ?? this.paths.get_column(name); }

    // A live page goes on below; the scene stands at one of its last seconds until it plays again.
    pause(paused) {
      if (paused) this.kept ??= new Map(this.paths.columns().map((name) => [name, this.paths.get_column(name).slice()]));
      else [this.kept, this.inputs.time.value] = [null, 0];
      this.button.textContent = paused ? "Play" : "Pause";
      this.draw();
    }

    turnByDragging(canvas) {
      let from = null;
      canvas.style.touchAction = "pan-y";
      canvas.style.cursor = "grab";
      canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; });
      addEventListener("pointerup", () => { from = null; });
      addEventListener("pointercancel", () => { from = null; });
      addEventListener("pointermove", (event) => {
        if (!from) return;
        const azimuth = this.value("azimuth") - PER_PX_DEG * (event.clientX - from[0]);
        this.inputs.azimuth.value = ((azimuth + 540) % 360) - 180;
        this.inputs.elevation.value = this.value("elevation") + PER_PX_DEG * (event.clientY - from[1]);
        from = [event.clientX, event.clientY];
        this.draw();
      });
    }

    play(running) {
      this.begunMs = null;
      this.button.textContent = running ? "Pause" : "Play";
      if (!running) return;
      const { time } = this.inputs;
      if (Number(time.value) >= Number(time.max)) time.value = 0;
      const begunS = Number(time.value), begunMs = performance.now();
      this.begunMs = begunMs;
      const step = (nowMs) => {
        if (this.begunMs !== begunMs) return;
        time.value = begunS + Math.max(nowMs - begunMs, 0) / 1000;
        this.draw();
        if (Number(time.value) < Number(time.max)) requestAnimationFrame(step);
        else this.play(false);
      };
      requestAnimationFrame(step);
    }

    draw() {
      const t = this.column("t");
      if (!t?.length || !(this.figure.inner_width > 0)) return;
      const low = this.box.map((range) => range.start), high = this.box.map((range) => range.end);
      this.middle = AXES.map((_, i) => (low[i] + high[i]) / 2);
      const { right, up } = directions(this.value("azimuth"), this.value("elevation"));
      Object.assign(this, { low, high, right, up });
      const atS = this.value("time") + HALF_STEP_S + (this.isLive ? t[t.length - 1] : 0);
      const head = Math.max(countUpTo(t, atS) - 1, 0);
      const begin = countUpTo(t, atS - TRAIL_S);
      this.frame(head);
      const view = JSON.stringify([right, up, low, high, t.length, t[0]]);
      const still = view === this.drawn;
      this.drawn = view;
      for (const { tags: [part, , columns], data_source: source } of this.figure.renderers) {
        if (part === "head") this.put(source, this.projected(columns, head, head + 1));
        else if (part === "trail") this.put(source, this.projected(columns, begin, head + 1));
        else if (still) continue;
        else if (part === "whole") this.put(source, this.projected(columns, 0, t.length));
        else if (part === "shadow") this.put(source, this.projected(columns, 0, t.length, low[2]));
        else if (part === "box") this.put(source, this.edges());
        else if (part === "names") this.put(source, this.names());
      }
      this.say(t[head], head);
    }

    // How a page looks is its own business: a live page's server is not told.
    put(source, data) { source.setv({ data }, { sync: false }); }

    at(place) {
      const from = place.map((value, i) => value - this.middle[i]);
      return [dot(this.right, from), dot(this.up, from)];
    }

    projected(columns, begin, end, z = null) {
      const [xs, ys, zs] = columns.map((name) => this.column(name));
      const u = new Float64Array(end - begin), v = new Float64Array(end - begin);
      for (let i = begin; i < end; i++) [u[i - begin], v[i - begin]] = this.at([xs[i], ys[i], z ?? zs[i]]);
      return { u, v };
    }

    // One scale for both directions; the whole box fits however it is turned. Zoomed in, it follows the first path.
    frame(head) {
      const size = AXES.map((_, i) => this.high[i] - this.low[i]);
      const wide = Math.hypot(size[0], size[1]), lift = Math.hypot(this.up[0], this.up[1]);
      const { inner_width: width, inner_height: height, x_range, y_range } = this.figure;
      const zoom = this.value("zoom");
      const room = [width, height].map((px, i) => Math.max(px - 2 * NAMES_PX[i], 1));
      const perPx = Math.max(wide / room[0], (wide * lift + size[2] * this.up[2]) / room[1]) / zoom;
      const first = this.figure.renderers.find((one) => one.tags[0] === "head").tags[2];
      const place = first.map((name) => this.column(name)[head]);
      const [u, v] = zoom > 1 && place.every(Number.isFinite) ? this.at(place) : [0, 0];
      x_range.setv({ start: u - perPx * width / 2, end: u + perPx * width / 2 }, { sync: false });
      y_range.setv({ start: v - perPx * height / 2, end: v + perPx * height / 2 }, { sync: false });
    }

    // The two ends of each of the four edges along an axis.
    along(axis) {
      const [b, c] = [0, 1, 2].filter((i) => i !== axis);
      return [0, 1, 2, 3].map((k) => [this.low, this.high].map((end) => {
        const place = [];
        place[axis] = end[axis];
        place[b] = (k & 1 ? this.high : this.low)[b];
        place[c] = (k & 2 ? this.high : this.low)[c];
        return place;
      }));
    }

    edges() {
      const ends = [0, 1, 2].flatMap((axis) => this.along(axis)).map((edge) => edge.map((place) => this.at(place)));
      const column = (end, i) => ends.map((edge) => edge[end][i]);
      return { u0: column(0, 0), v0: column(0, 1), u1: column(1, 0), v1: column(1, 1) };
    }

    // Names and ends of the axes: x and y at the lowest edge on the screen, z at the leftmost one.
    names() {
      const found = { u: [], v: [], text: [] };
      AXES.forEach((name, axis) => {
        const screen = axis === 2 ? 0 : 1;
        const middleOf = (edge) => (this.at(edge[0])[screen] + this.at(edge[1])[screen]) / 2;
        const floor = this.along(axis).filter((edge) => axis === 2 || edge[0][2] === this.low[2]);
        const edge = floor.reduce((best, one) => (middleOf(one) < middleOf(best) ? one : best));
        const [one, other] = edge.map((place) => this.at(place));
        const out = 0.035 * Math.hypot(...AXES.map((_, i) => this.high[i] - this.low[i]));
        const texts = [`${edge[0][axis].toFixed(0)}`, `${name}, mm`, `${edge[1][axis].toFixed(0)}`];
        texts.forEach((text, k) => {
          const share = [0.06, 0.5, 0.94][k];
          found.u.push(one[0] + share * (other[0] - one[0]) - (axis === 2 ? 1.3 * out : 0));
          found.v.push(one[1] + share * (other[1] - one[1]) - (axis === 2 ? 0 : out));
          found.text.push(text);
        });
      });
      return found;
    }

    say(atS, head) {
      for (const [name, input] of Object.entries(this.inputs)) {
        const digits = name === "time" ? 2 : name === "zoom" ? 1 : 0;
        const text = `${Number(input.value).toFixed(digits)}${UNITS[name]}`;
        input.nextElementSibling.textContent = text;
        input.setAttribute("aria-valuetext", text);
      }
      if (!this.errors) return;
      const heads = this.figure.renderers.filter((one) => one.tags[0] === "head" && one.visible);
      const off = heads.flatMap(({ tags: [, name] }) => {
        const error = this.column(`${name} error`)?.[head];
        return Number.isFinite(error) ? [`${name} by ${error.toFixed(2)} mm`] : [];
      });
      this.errors.textContent = off.length ? `Off the arm at ${atS.toFixed(2)} s: ${off.join(", ")}` : "";
    }
  }

  // A name that was pressed shows or hides a path, and with it its error.
  document.addEventListener("click", (event) => {
    if (event.target.closest("[data-series]")) for (const scene of scenes) scene.draw();
  });
  const wait = () => {
    const doc = window.Bokeh?.documents[0];
    if (!doc) requestAnimationFrame(wait);
    else for (const one of document.querySelectorAll("[data-scene]")) scenes.push(new Scene(one, doc));
  };
  addEventListener("DOMContentLoaded", () => { if (window.Bokeh) wait(); });  // a live page loads it beside the rest
})();
