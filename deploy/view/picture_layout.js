"use strict";
// Where the picture looks, and where its names stand. Pure: no canvas.
window.pictureLayout = (() => {
  const EDGE = 0.12;  // of the picture's width and height, kept free around what is in it
  const ZOOM_IN = 1.02;  // at most, from one picture to the next; zooming out waits for nothing

  // The scale, in px/mm, and centre at which all places lie in the picture: as near to `home` as they allow, and no
  // larger than `width_mm` across. A picture without width or height, as while the page is laid out, looks nowhere new.
  const follow = (view, home, places, [wide, high], width_mm) => {
    if (!(wide > 0 && high > 0)) return view;
    const inner = [wide * (1 - 2 * EDGE), high * (1 - 2 * EDGE)];
    const low = [0, 1].map((axis) => Math.min(...places.map((place) => place[axis])));
    const most = [0, 1].map((axis) => Math.max(...places.map((place) => place[axis])));
    let scale = Math.min(wide / width_mm, ...[0, 1].map((axis) => inner[axis] / Math.max(most[axis] - low[axis], 1e-9)));
    if (view) scale = Math.min(scale, view.scale * ZOOM_IN);
    const centre = [0, 1].map((axis) => {
      const half = inner[axis] / 2 / scale;
      return Math.min(Math.max(home[axis], most[axis] - half), low[axis] + half);
    });
    return { scale, centre };
  };

  const LINE_PX = 18, BESIDE_PX = 24;
  const meets = (one, other) =>
    one.left < other.left + other.width && other.left < one.left + one.width && Math.abs(one.y - other.y) < LINE_PX;

  // Each name beside its mark {text, x, y, width}, on the right or left, above or below: the first place that lies in
  // the picture and on no other name. `taken` are boxes of other words. A name without room is left out.
  const placed = (names, taken, [wide, high]) => {
    const done = [...taken], found = [];
    for (const name of names) {
      const tries = [0, 1, -1, 2, -2, 3, -3, 4, -4].flatMap((k) => [
        { left: name.x + BESIDE_PX, y: name.y + k * LINE_PX },
        { left: name.x - BESIDE_PX - name.width, y: name.y + k * LINE_PX },
      ]);
      const box = tries.map((one) => ({ ...name, ...one })).find((one) =>
        one.left >= 2 && one.left + one.width <= wide - 2 && one.y >= LINE_PX && one.y <= high - 4
        && !done.some((other) => meets(one, other)));
      if (!box) continue;
      done.push(box); found.push(box);
    }
    return found;
  };

  // A force as an arrow, in px on the canvas (its y points down): as long as it is strong, up to `most_px`. What is no
  // force, or a tenth of a newton or less, has none.
  const LEAST_N = 0.1, PX_PER_N = 22;
  const arrowOf = (force_n, most_px) => {
    if (!Array.isArray(force_n) || force_n.length !== 3 || !force_n.every(Number.isFinite)) return null;
    const size_n = Math.hypot(...force_n), flat_n = Math.hypot(force_n[0], force_n[1]);
    if (size_n <= LEAST_N) return null;
    const px = Math.min(PX_PER_N * flat_n, most_px), share = flat_n > 0 ? px / flat_n : 0;
    return { size_n, dx: share * force_n[0], dy: -share * force_n[1], isCut: PX_PER_N * flat_n > most_px };
  };

  // Where a hand of this stiffness would be that the force pushes off its place, in mm.
  const yielded = (place, force_n, n_per_m) => (n_per_m > 0 && arrowOf(force_n, 1)
    ? place.map((value, axis) => value + 1000 * force_n[axis] / n_per_m) : null);

  // What is felt, in words.
  const LIMITS = { force: "cut at the largest force that may be shown", stale: "fading, as nothing newer came back",
    inactive: "fading, as the arm does not follow" };
  const digits = (value) => (value < 10 ? Number(value.toPrecision(1)) : Math.round(value));
  const grows = ({ size_mm, growth_pct }) => `a swing of ${digits(size_mm)} mm grows by ${digits(growth_pct)} % a period`;
  const STANDS = {
    free: "The hand touches nothing: there is no loop to judge.",
    still: "The hand has stood still to a micrometre: nothing tells whether the loop is stable. Move it a little.",
  };
  const LOOPS = {
    stable: ({ over_s }) => `The loop is stable over the last ${over_s.toFixed(0)} s.`,
    not_yet: ({ over_s, young_s }) => `Not judged yet: ${over_s.toFixed(0)} of ${young_s.toFixed(0)} s. A swing grows slowly from small.`,
    not_decidable: ({ over_s, swing, stands }) => (Object.hasOwn(STANDS, stands) ? STANDS[stands]
      : `The last ${over_s.toFixed(0)} s do not tell whether the loop is stable${swing?.growth_pct ? `: ${grows(swing)}` : ""}.`),
    unstable: ({ over_s, swing }) => (swing?.seen_in_s
      ? `The loop is unstable: ${grows(swing)}; it will be seen in some ${digits(swing.seen_in_s)} s.`
      : `The loop is unstable over the last ${over_s.toFixed(0)} s: the hand swings${swing ? `, by ${digits(swing.size_mm)} mm` : ""}.`),
  };
  const feltWords = ({ hand_n, late_ms, limited }) => [
    `${Math.hypot(...hand_n).toFixed(1)} N on the hand`,
    late_ms == null ? "; none has come back yet" : `, as it was on the tool ${Math.max(late_ms, 0).toFixed(0)} ms ago`,
    Object.hasOwn(LIMITS, limited) ? `; ${LIMITS[limited]}` : "", "."].join("");
  // Whether the loop is stable, over which time, and from which stiffness on theory expects it to swing at the round trip of now:
  // a median of the last seconds, which after a change is that of before.
  const loopWords = ({ loop, wall_n_m, limit_n_m, late_ms }) => (!Object.hasOwn(LOOPS, loop?.state) ? "" : [LOOPS[loop.state](loop),
    wall_n_m == null ? "" : `What it touches has ${wall_n_m.toFixed(0)} N/m.`,
    limit_n_m == null || loop.over_s < loop.young_s ? "" : `In theory it swings from ${limit_n_m.toFixed(0)} N/m on, at the round trip of now${late_ms > 0 ? `, ${Math.round(late_ms)} ms` : ""}.`].filter(Boolean).join(" "));

  // A whole and a part of it in words, in one resolution, with the rest: what is read adds up. Times in ms. A rest of two ticks shows.
  const sharesOf = (whole_ms, part_ms, rate_hz) => {
    const step = whole_ms < 95 || rate_hz >= 100 ? 1 : 10, [whole, part] = [whole_ms, part_ms].map((ms) => step * Math.round(ms / step));
    return { whole: lateness(whole), part: lateness(part), rest: lateness(whole - part), rest_ms: whole - part };
  };
  const lateness = (ms) => (Math.abs(ms) < 950 ? `${ms} ms` : `${(ms / 1000).toFixed(2)} s`);
  // The parts of a lateness. What waits for ticks is between none and two of them, by where the delay falls between them. An arm's own lag is no part.
  const partsWords = (late_ms, network_ms, judged_s, rate_hz) => {
    const { part, rest, rest_ms } = sharesOf(late_ms, network_ms, rate_hz), over = `(medians of the last ${judged_s} s, of the same messages)`;
    const ticks = rate_hz > 0 ? `two ticks, ${lateness(Math.round(1000 / rate_hz))} to ${lateness(Math.round(2000 / rate_hz))} at ${rate_hz} Hz` : "two ticks";
    return rest_ms <= 0 ? ` The network took ${part} both ways ${over}.`
      : ` Of that the network takes ${part} both ways ${over}; the rest, ${rest}, is waiting for ticks, at arm and display, and computing: it depends on how the delay falls between them. Without a network it is one to ${ticks}. How far the arm is behind what it is told, and drawing by the browser, come on top.`;
  };
  // Why a page drew no picture for `drawn_ms`: none came to the operator's side, where the newest came `came_ms` ago as far as
  // was known `unlooked_ms` ago; or the page is late. An answer that tells of no picture is itself up to 0.8 s old.
  const SILENT_MS = 500, LATE_MS = 1000;
  const age = (ms) => (ms < 1000 ? `${Math.round(ms)} ms` : `${(ms / 1000).toFixed(1)} s`);
  const silence = (drawn_ms, unlooked_ms, came_ms) => {
    if (drawn_ms <= SILENT_MS || unlooked_ms === null) return null;
    const isCalm = came_ms - unlooked_ms > SILENT_MS, late_ms = isCalm ? unlooked_ms : Math.max(drawn_ms, unlooked_ms);
    if (late_ms > LATE_MS) return { state: "late", text: `This page is ${age(late_ms)} late, as the machine is busy: the operator's screen may show newer pictures. The report tells what it showed.` };
    return isCalm ? { state: "frozen", text: `No newer picture for ${age(came_ms)}.` } : null;
  };

  return { follow, placed, arrowOf, yielded, feltWords, loopWords, sharesOf, partsWords, age, silence };
})();
