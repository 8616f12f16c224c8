"use strict";
// Pools sums of groups (point, person, hand) as deploy/compare/results/pooled.py does; a test compares both.
const pooling = (about, buffer) => {
  const G = about.n_groups, E = about.estimators.length, B = about.age_edges_ms.length;
  const HOLD = about.estimators.indexOf("hold");
  let at = 0;
  const take = (Kind, count) => {
    const found = new Kind(buffer, at, count);
    at += found.byteLength;
    return found;
  };
  const n = take(Float64Array, G), sst = take(Float64Array, 3 * G), nByAge = take(Float64Array, B * G);
  const ageByAge = take(Float64Array, B * G);
  const sse = take(Float64Array, 3 * E * G), counts = take(Float64Array, 3 * E * G);
  const sseByAge = take(Float32Array, B * E * G);
  const group = take(Int32Array, 3 * G), draws = take(Uint32Array, (buffer.byteLength - at) / 4);
  const sum3 = (array, i) => array[i] + array[i + 1] + array[i + 2];
  const known = (value) => (Number.isFinite(value) ? value : null);

  // A filter: allowed places of each axis, of people and of hands; null allows all.
  const chosen = ({ axes = [], people = null, hands = null }) => {
    const allowed = about.points.map((places) => places.every((place, i) => !axes[i] || axes[i].includes(place)));
    const found = [];
    for (let g = 0; g < G; g++) {
      if (!allowed[group[3 * g]]) continue;
      if (people && !people.includes(group[3 * g + 1])) continue;
      if (hands && !hands.includes(group[3 * g + 2])) continue;
      found.push(g);
    }
    return found;
  };

  const percentile = (sorted, share) => {
    const place = share * (sorted.length - 1), low = Math.floor(place);
    const high = Math.min(low + 1, sorted.length - 1);
    return sorted[low] + (place - low) * (sorted[high] - sorted[low]);
  };
  const interval = (values) => {
    for (const value of values) if (!Number.isFinite(value)) return null;
    values.sort();
    return [percentile(values, 0.025), percentile(values, 0.975)];
  };
  const bootstrap = (parts) => {
    const count = parts.length, N = about.n_resamples;
    const runs = Math.min(N, Math.floor(draws.length / count));
    if (count < 2 || !runs) return { ratio: null, rmse: null };
    const ratios = new Float64Array(runs), errors = new Float64Array(runs);
    for (let r = 0, d = 0; r < runs; r++) {
      let ticks = 0, own = 0, held = 0;
      for (let i = 0; i < count; i++, d++) {
        const part = parts[Math.floor((draws[d] / 4294967296) * count)];
        ticks += part.n; own += part.sse; held += part.hold;
      }
      ratios[r] = held > 0 ? Math.sqrt(own / held) : NaN;
      errors[r] = 1000 * Math.sqrt(own / ticks);
    }
    return { ratio: interval(ratios), rmse: interval(errors) };
  };

  // Scores of one estimator over groups; with intervals over people when told.
  const scores = (groups, e, withIntervals = true) => {
    const total = { n: 0, missing: 0, covered: 0, ellipsoids: 0, hold: 0 };
    const own = [0, 0, 0], moved = [0, 0, 0], people = new Map();
    for (const g of groups) {
      const i = 3 * (g * E + e);
      if (Number.isNaN(sse[i])) continue;
      const all = sum3(sse, i), held = sum3(sse, 3 * (g * E + HOLD)), who = group[3 * g + 1];
      for (let k = 0; k < 3; k++) { own[k] += sse[i + k]; moved[k] += sst[3 * g + k]; }
      total.n += n[g]; total.hold += held;
      total.missing += counts[i]; total.covered += counts[i + 1]; total.ellipsoids += counts[i + 2];
      const part = people.get(who) ?? { n: 0, sse: 0, hold: 0 };
      part.n += n[g]; part.sse += all; part.hold += held;
      people.set(who, part);
    }
    const all = own[0] + own[1] + own[2];
    const bands = withIntervals ? bootstrap([...people.values()]) : { ratio: null, rmse: null };
    return {
      n_scored: total.n,
      n_missing: total.missing,
      n_people: people.size,
      r2_pct: own.map((value, k) => (moved[k] > 0 ? known(100 * (1 - value / moved[k])) : null)),
      rmse_3d_mm: known(1000 * Math.sqrt(all / total.n)),
      rmse_3d_mm_interval_95: bands.rmse,
      ratio_to_hold: total.hold > 0 ? known(Math.sqrt(all / total.hold)) : null,
      ratio_to_hold_interval_95: bands.ratio,
      coverage_pct: total.ellipsoids ? (100 * total.covered) / total.ellipsoids : null,
    };
  };

  // The groups of each value of an axis, in the order of its values.
  const along = (groups, axis) => {
    const found = about.axes[axis].values.map(() => []);
    for (const g of groups) found[about.points[group[3 * g]][axis]].push(g);
    return found;
  };

  const byAge = (groups, e) => {
    const ticks = new Float64Array(B), ages = new Float64Array(B), squares = new Float64Array(B);
    for (const g of groups) {
      if (Number.isNaN(sse[3 * (g * E + e)])) continue;
      for (let b = 0; b < B; b++) {
        ticks[b] += nByAge[g * B + b]; ages[b] += ageByAge[g * B + b]; squares[b] += sseByAge[(g * E + e) * B + b];
      }
    }
    return about.age_edges_ms
      .map((from_ms, b) => ({ from_ms, age_ms: ages[b] / ticks[b], n: ticks[b], rmse_3d_mm: 1000 * Math.sqrt(squares[b] / ticks[b]) }))
      .filter((bin) => bin.n);
  };
  return { chosen, scores, along, byAge };
};
