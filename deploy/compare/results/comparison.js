// Filters, and what they choose in curves, map, error against age and table.
(async () => {
  const byId = (id) => document.getElementById(id);
  const about = JSON.parse(byId("about").textContent);
  const bytes = Uint8Array.from(atob(byId("sums").textContent), (char) => char.charCodeAt(0));
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const pool = pooling(about, await new Response(unpacked).arrayBuffer());
  const ENOUGH_PEOPLE = 6, LABELS_CHARS = 60, LOG_FROM = 20, MAX_TEXTS = 200, MARGIN = 0.04;
  const model = (name) => Bokeh.documents[0].get_model_by_name(name);
  const all = (selector) => [...document.querySelectorAll(selector)];

  // What is chosen.
  const pressed = (kind) => {
    const chips = all(`[data-chip=${kind}]`);
    const on = chips.filter((chip) => chip.getAttribute("aria-pressed") === "true");
    return on.length === chips.length ? null : on.map((chip) => Number(chip.dataset.place));
  };
  const filter = () => {
    const axes = about.axes.map(() => null);
    for (const one of all("[data-axis]")) if (Number(one.value)) axes[one.dataset.axis] = [Number(one.value) - 1];
    return { axes, people: pressed("people"), hands: pressed("hands") };
  };
  const shown = () => pressed("estimators") ?? about.estimators.map((_, e) => e);

  // Places of an axis' values: to scale where they are numbers, of equal distance where they are names.
  const scale = ({ values, numbers }) => {
    if (!numbers) return values.map((_, i) => i);
    const low = Math.min(...numbers), high = Math.max(...numbers);
    return low > 0 && high > LOG_FROM * low ? numbers.map(Math.log10) : numbers;
  };
  const marks = (axis, places, texts) => {
    const short = texts.map((text) => (text.trim() && Number.isFinite(Number(text)) ? String(Number(Number(text).toPrecision(4))) : text));
    const step = Math.ceil((places.length * (2 + Math.max(...short.map(({ length }) => length)))) / LABELS_CHARS);
    const kept = places.map((place, i) => [place, short[i]]).filter((_, i) => i % step === 0);
    axis.ticker.ticks = kept.map(([place]) => place);
    axis.major_label_overrides = new Map(kept);
  };
  const fit = (range, places) => {
    const low = Math.min(...places), high = Math.max(...places), margin = MARGIN * (high - low) || 0.5;
    range.setv({ start: low - margin, end: high + margin, reset_start: low - margin, reset_end: high + margin });
  };
  const fixed = (value, digits = 3) => (value === null ? "-" : Math.abs(value) < 1e4 ? value.toFixed(digits) : value.toExponential(0));
  const between = (interval, digits = 3) => (interval ? `${fixed(interval[0], digits)} to ${fixed(interval[1], digits)}` : "");
  const top = (name, highest) => {
    if (highest > 0) model(`${name}-figure`).y_range.setv({ start: 0, end: highest, reset_start: 0, reset_end: highest });
  };

  const empty = () => ({ x: [], y: [], low: [], high: [], at: [], band: [], ticks: [], people: [], estimator: [] });
  const add = (columns, e, x, y, interval, at, ticks, people) => {
    const [low, high] = interval ?? [NaN, NaN];
    const row = { x, y, low, high, at, band: interval ? `(${between(interval)})` : "", ticks, people, estimator: about.labels[e] };
    for (const name in row) columns[name].push(row[name]);
  };
  const fill = (name, columns, visible) => {
    about.estimators.forEach((estimator, e) => { model(`${name}:${estimator}`).data = visible.includes(e) ? columns[e] : empty(); });
  };
  const highest = (columns, most) => {
    const hold = columns[about.estimators.indexOf("hold")];
    const seen = columns.flatMap(({ y, high }) => [...y, ...high]).filter(Number.isFinite);
    return Math.min(1.05 * Math.max(...seen, 0), most * Math.max(...hold.y.filter(Number.isFinite), 0) || Infinity);
  };

  const drawCurves = (groups, visible) => {
    const i = about.axes.findIndex(({ path }) => path === byId("x-axis").value), axis = about.axes[i];
    const places = scale(axis), ratio = about.estimators.map(empty), rmse = about.estimators.map(empty);
    pool.along(groups, i).forEach((own, place) => {
      if (!own.length) return;
      about.estimators.forEach((_, e) => {
        if (!visible.includes(e) && about.estimators[e] !== "hold") return;
        const found = pool.scores(own, e), at = `${axis.title}: ${axis.values[place]}`;
        const rest = [at, found.n_scored, found.n_people];
        if (found.ratio_to_hold !== null) add(ratio[e], e, places[place], found.ratio_to_hold, found.ratio_to_hold_interval_95, ...rest);
        if (found.rmse_3d_mm !== null) add(rmse[e], e, places[place], found.rmse_3d_mm, found.rmse_3d_mm_interval_95, ...rest);
      });
    });
    for (const [name, columns, most] of [["ratio", ratio, 2], ["rmse", rmse, 1.6]]) {
      const figure = model(`${name}-figure`), order = places.map((_, k) => k).sort((a, b) => places[a] - places[b]);
      const ordered = columns.map((own) => {
        const turn = own.x.map((_, k) => k).sort((a, b) => own.x[a] - own.x[b]);
        return Object.fromEntries(Object.entries(own).map(([key, list]) => [key, turn.map((k) => list[k])]));
      });
      fill(name, ordered, visible);
      marks(figure.below[0], order.map((k) => places[k]), order.map((k) => axis.values[k]));
      figure.below[0].axis_label = axis.title;
      fit(figure.x_range, places);
      top(name, highest(ordered, most));
    }
  };

  const drawMap = (groups) => {
    const [across, up] = ["across", "up"].map((id) => about.axes.findIndex(({ path }) => path === byId(id).value));
    const e = about.estimators.indexOf(byId("of").value);
    const rows = { x: [], y: [], ratio: [], text: [], ink: [], across: [], up: [], rmse: [], ticks: [], people: [] };
    const [right, above] = [about.axes[across], about.axes[up]];
    const few = right.values.length * above.values.length <= MAX_TEXTS && right.values.length <= 20;
    pool.along(groups, up).forEach((own, y) => pool.along(own, across).forEach((cell, x) => {
      if (!cell.length) return;
      const found = pool.scores(cell, e, false), ratio = found.ratio_to_hold ?? NaN;
      const row = {
        x, y, ratio, text: few ? fixed(found.ratio_to_hold, 2) : "", ink: ratio > 0.7 ? "black" : "white",
        across: `${right.title}: ${right.values[x]}`, up: `${above.title}: ${above.values[y]}`,
        rmse: found.rmse_3d_mm ?? NaN, ticks: found.n_scored, people: found.n_people,
      };
      for (const name in row) rows[name].push(row[name]);
    }));
    model("heat").data = rows;
    const figure = model("heat-figure");
    for (const [axis, range, { title, values }] of [[figure.below[0], figure.x_range, right], [figure.left[0], figure.y_range, above]]) {
      marks(axis, values.map((_, i) => i), values);
      axis.axis_label = title;
      const end = values.length - 0.5;
      range.setv({ start: -0.5, end, reset_start: -0.5, reset_end: end });
    }
  };

  const drawAge = (groups, visible) => {
    // a point at the mean age of its bin; of the last bin, which is open, the axis shows as much as of the one before
    const ages = about.age_edges_ms, edge = (k) => ages[k] ?? 2 * ages.at(-1) - ages.at(-2), edges = new Set();
    const columns = about.estimators.map((_, e) => {
      const own = empty();
      for (const bin of pool.byAge(groups, e)) {
        const low = about.age_edges_ms.indexOf(bin.from_ms), to_ms = about.age_edges_ms[low + 1];
        const words = to_ms === undefined ? `from ${bin.from_ms} ms` : `${bin.from_ms} to ${to_ms} ms`;
        edges.add(edge(low)).add(edge(low + 1));
        add(own, e, bin.age_ms, bin.rmse_3d_mm, null, words, bin.n, "");
      }
      return own;
    });
    fill("age", columns, visible);
    const places = [...edges].sort((a, b) => a - b), figure = model("age-figure");
    marks(figure.below[0], places, places.map((place) => (ages.includes(place) ? String(place) : "older")));
    if (places.length) fit(figure.x_range, [...places, ...columns.flatMap(({ x }) => x)]);
    top("age", highest(columns, 1.6));
  };

  const drawTable = (groups, visible) => {
    const scores = visible.map((e) => [e, pool.scores(groups, e)]);
    const hold = groups.length ? pool.scores(groups, about.estimators.indexOf("hold"), false) : null;
    // One without a scored tick, where hold has some, gave no estimate at any of these.
    const named = (e, found) => (hold?.n_scored && !found.n_scored ? `${about.estimators[e]} failed` : about.labels[e]);
    scores.sort(([, one], [, other]) => (one.rmse_3d_mm ?? Infinity) - (other.rmse_3d_mm ?? Infinity));
    const rows = scores.map(([e, found]) => {
      const row = document.createElement("tr");
      const cells = [
        named(e, found), ...found.r2_pct.map((value) => fixed(value, 2)), fixed(found.rmse_3d_mm),
        between(found.rmse_3d_mm_interval_95) || "-", fixed(found.ratio_to_hold), between(found.ratio_to_hold_interval_95) || "-",
        fixed(found.coverage_pct, 1), found.n_scored.toLocaleString("en"), found.n_people,
      ];
      cells.forEach((text, i) => {
        const cell = row.appendChild(document.createElement(i ? "td" : "th"));
        cell.textContent = text;
        cell.dataset.head = heads[i];
      });
      return row;
    });
    byId("rows").replaceChildren(...rows);
    return hold;
  };
  const heads = all("#table thead th").map((cell) => cell.textContent);

  // What the figures pool, told beside them: "all" on a slider is easily overlooked.
  const MAX_VALUES = 8;
  const pooledOver = ({ axes }) => {
    const swept = about.axes.map((axis, i) => ({ ...axis, chosen: axes[i] })).filter(({ values }) => values.length > 1);
    const every = ({ title, values }) =>
      `${title} (${values.length > MAX_VALUES ? `${values.length}: ${values[0]} ... ${values.at(-1)}` : values.join(", ")})`;
    const over = swept.filter(({ chosen }) => !chosen).map(every).join(" and all values of ");
    const at = swept.filter(({ chosen }) => chosen).map(({ title, values, chosen }) => `${title}: ${values[chosen[0]]}`).join("; ");
    return [over && `Pooled over all values of ${over}.`, at && `At ${at}.`].filter(Boolean).join(" ");
  };

  const words = (found) => {
    if (!found?.n_scored) return "Nothing is chosen that has a scored tick.";
    const count = found.n_people, who = about.synthetic ? ", one for each seed" : "";
    const least = `${found.n_scored.toLocaleString("en")} scored ticks`;
    if (count < 2) return `${least} of one person or device. No bands: intervals are over several.`;
    const few = count < ENOUGH_PEOPLE ? ` So few cover less than 95 %: at most ${Math.round(100 * (1 - 2 ** (1 - count)))} %.` : "";
    return `${least}. Bands: 95 % bootstrap intervals over ${count} people${who}.${few}`;
  };

  const draw = () => {
    const groups = pool.chosen(filter()), visible = shown();
    byId("words").textContent = words(drawTable(groups, visible));
    for (const one of all(".pooled")) one.textContent = pooledOver(filter());
    document.documentElement.style.setProperty("--panel", `${byId("choose").offsetHeight}px`);
    if (byId("x-axis")) drawCurves(groups, visible);
    if (byId("across")) drawMap(groups);
    drawAge(groups, visible);
  };

  // A change is drawn with the next frame, so that a slider that moves fast is not drawn for each step.
  let waiting = false;
  const soon = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };
  document.addEventListener("input", (event) => {
    if (event.target.matches("[data-axis]")) {
      const { values } = about.axes[event.target.dataset.axis], place = Number(event.target.value);
      event.target.nextElementSibling.textContent = place ? values[place - 1] : "all";
    }
    soon();
  });
  document.addEventListener("click", (event) => {
    const chip = event.target.closest("[data-chip]"), every = event.target.closest("[data-every]");
    if (chip) chip.setAttribute("aria-pressed", chip.getAttribute("aria-pressed") !== "true");
    if (every) for (const one of all(`[data-chip=${every.dataset.every}]`)) one.setAttribute("aria-pressed", every.dataset.to);
    if (chip || every) soon();
  });
  const begin = () => {
    if (!window.Bokeh?.documents.length) return requestAnimationFrame(begin);
    draw();
    window.comparison = { about, pool, filter, draw };
  };
  begin();
})();
