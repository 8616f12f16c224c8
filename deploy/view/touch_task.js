"use strict";
// Touch targets in order, as ISO 9241-411 lays them out: on a ring, each across from the last. Pure: no clock, no page.
// It is the arm itself that touches, in the plane of the picture; a depth is no miss.
window.touchTask = (() => {
  const N_TARGETS = 9, RING_MM = 22, RADIUS_MM = 5, DWELL_MS = 300, MAX_ROWS = 30;
  const ROUNDED_MS = 0.5;  // instants are sums of ticks, which have no whole ms
  const STRIDE = (N_TARGETS + 1) / 2;

  const far = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);
  const place = (centre, k) => {
    const angle = Math.PI / 2 - (2 * Math.PI * ((k * STRIDE) % N_TARGETS)) / N_TARGETS;
    return [centre[0] + RING_MM * Math.cos(angle), centre[1] + RING_MM * Math.sin(angle)];
  };

  // A task about `centre`, in mm, asked for at `asked_s` of run time; `label` is what its row tells of how it was played.
  const begin = (centre, label, asked_s) => ({
    label, asked_s, targets: Array.from({ length: N_TARGETS }, (_, k) => place(centre, k)),
    next: 0, n_misses: 0, path_mm: 0, began_ms: null, ended_ms: null, inside_ms: null, at_ms: -Infinity, arm_mm: null,
    set_s: null,
  });
  const isOver = (task) => task.ended_ms !== null;

  // The task after the arm was seen at a place. A target counts once the arm has stayed in it for DWELL_MS; to leave it
  // sooner is a miss. Time, path and misses count from the touch of the first target to that of the last.
  const step = (task, at_ms, arm_mm) => {
    if (isOver(task) || !(at_ms > task.at_ms)) return task;
    const after = { ...task, at_ms, arm_mm };
    if (task.began_ms !== null) after.path_mm += far(task.arm_mm, arm_mm);
    if (far(arm_mm, task.targets[task.next]) > RADIUS_MM) {
      if (task.inside_ms !== null && task.began_ms !== null) after.n_misses += 1;
      after.inside_ms = null;
      return after;
    }
    after.inside_ms = task.inside_ms ?? at_ms;
    if (at_ms - after.inside_ms < DWELL_MS - ROUNDED_MS) return after;
    after.inside_ms = null;
    after.next += 1;
    if (task.began_ms === null) after.began_ms = at_ms;
    if (after.next === N_TARGETS) after.ended_ms = at_ms;
    return after;
  };

  // The task once its own delay is set, by the newest request that netem holds, at `at_s`: an older one may set the same.
  // Where netem does not answer, as at the end of the run, nothing is known.
  const isKnown = ({ at_s, delay, loss }) => [at_s, ...delay, ...loss].some((one) => one !== null);
  const isDelay = (task, { delay: [there, back] }) => there + back === task.label.delay_ms;
  const noted = (task, set) => (task.set_s === null && set.at_s > task.asked_s && isDelay(task, set) ? { ...task, set_s: set.at_s } : task);

  // Why a task tells no longer of its delay alone; "" while it does. A stop before it counts delays it only.
  const OTHER = "Ended: the delay is no longer that of these targets.", ended = (why) => `Ended: ${why}, so it tells no longer of this delay alone.`;
  const spoilt = (task, { stopped, set }) => {
    if (isOver(task)) return "";
    if (task.set_s !== null && isKnown(set) && set.at_s !== task.set_s) return isDelay(task, set) ? ended("the network was changed") : OTHER;
    return stopped && task.began_ms !== null ? ended("the arms were stopped") : "";
  };

  const rowOf = (task) => ({
    ...task.label, time_s: (task.ended_ms - task.began_ms) / 1000, path_mm: task.path_mm, n_misses: task.n_misses,
  });

  // The rows kept in a page's storage; what is none of ours is left out.
  const read = (text) => {
    let rows = [];
    try { rows = JSON.parse(text) ?? []; } catch { /* somebody else's */ }
    const numbers = ["delay_ms", "time_s", "path_mm", "n_misses"];
    const ours = (row) => row && numbers.every((name) => Number.isFinite(row[name])) && typeof row.ghost === "boolean";
    return Array.isArray(rows) ? rows.filter(ours).slice(-MAX_ROWS) : [];
  };

  // The rows as a table for other programs; names carry the units.
  const csvOf = (rows) => ["delay_there_and_back_ms,with_ghost,time_s,arm_path_mm,n_misses", ...rows.map((row) =>
    [row.delay_ms, row.ghost, row.time_s.toFixed(3), row.path_mm.toFixed(2), row.n_misses].join(","))].join("\n") + "\n";

  return { N_TARGETS, RADIUS_MM, DWELL_MS, RING_MM, begin, step, isOver, noted, spoilt, rowOf, read, csvOf, MAX_ROWS };
})();
