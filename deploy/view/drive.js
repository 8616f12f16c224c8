"use strict";
// The surgeon's display on a canvas: the hand now, the arm late, and its ghost. A pointer moves the hand.
(() => {
  const canvas = document.getElementById("drive");
  const tones = JSON.parse(document.getElementById("drive_tones").textContent);
  const drives = canvas.hasAttribute("tabindex");
  const at = (id) => document.getElementById(id);
  const TRAIL_MS = 2500, SEND_MS = 25, WIDTH_MM = 110, REACH_MM = [46, 29, 30], KEY_MM = 1.5, WHEEL_MM = 0.02;
  const IDLE_MS = 20_000;  // without a touch of it the hand is let go, for another page to take
  const SETTLED_MS = 600;  // after a drag, the hand is drawn where it was put until the surgeon's side has it

  let socket = null, seen = null, refused = "", centre = null, over = false;
  const trails = { hand: [], shown: [], ghost: [] };
  // Movement of the hand since this page took it, in mm, and the pointer that moves it.
  let moved = [0, 0, 0], engaged = false, drag = null, early = null, clutch = false, gripper = 0, touched = 0, sent = 0, local = null;

  // Connection: pictures come in, moves go out while this page drives.
  const connect = () => {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    socket = new WebSocket(`${scheme}//${location.host}/drive`);
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if ("refused" in message) {
        refused = message.refused;
        // moves that came too fast are lost, no more: each says where the hand is, and the next one is taken
        if (message.lost) letGo();
        return say();
      }
      if ("arm" in message) {
        seen = message;
        follow();
      }
      for (const hear of heard) hear(message, hand());
    };
    socket.onclose = (event) => {
      over = true; letGo(); refused = event.reason; say();
      for (const close of closed) close();
    };
  };
  // What the other scripts of the page use: they ask, hear each message, and draw.
  const heard = [], closed = [];
  let stops = false;  // whether this page was the last one here to stop the arms
  let task = null;  // what it shows: its targets, and what it hides
  // Where the pointer has put the hand; a simulated hand is then off it, by the force that it feels.
  const hand = () => local ?? (seen?.yields ? seen.felt?.meant_mm : null) ?? seen?.hand_mm;
  Object.assign(window.live, {
    ask: (request) => {
      if (socket?.readyState !== WebSocket.OPEN) return false;
      socket.send(JSON.stringify(request));
      if (["stop", "release"].includes(request.ask)) stops = request.ask === "stop";
      return true;
    },
    on: (hear) => heard.push(hear),
    onClose: (close) => closed.push(close),
    setTask: (shown) => { task = shown; canvas.classList.toggle("plays", task !== null); },
    home: () => centre,
    say: () => say(),
    take: () => take(),
    send: (more) => send(more),
  });
  const send = (more) => {
    if (!engaged || socket?.readyState !== WebSocket.OPEN) return;
    const release = !drag && performance.now() - touched > IDLE_MS;
    sent = performance.now();
    socket.send(JSON.stringify({ moved_mm: moved, gripper_rad: gripper, clutch, release, ...more }));
    if (release) letGo();
  };
  const letGo = () => { engaged = false; drag = null; moved = [0, 0, 0]; local = null; for (const one of document.querySelectorAll(".dragged")) one.classList.remove("dragged"); };

  const take = (surface = canvas) => {
    if (!drives || over || !seen?.hand_mm) return false;
    if (!engaged) { engaged = true; moved = [0, 0, 0]; local = [...hand()]; refused = ""; }
    surface.focus({ preventScroll: true });
    return true;
  };
  const move = (dx, dy, dz) => {
    const step = [dx, dy, dz];
    for (let axis = 0; axis < 3; axis++) {
      // the hand stays in the picture
      const to = Math.min(Math.max(local[axis] + step[axis], centre[axis] - REACH_MM[axis]), centre[axis] + REACH_MM[axis]);
      moved[axis] += clutch ? step[axis] : to - local[axis];
      if (!clutch) local[axis] = to;
    }
    touched = performance.now();
    if (at("depth")) at("depth").value = local[2] - centre[2];
    if (touched - sent >= SEND_MS) send();  // else with the next tick of the timer: a mouse moves 1000 times a second
  };

  // What was seen, for the trails and the words.
  const follow = () => {
    if (!seen.arm) return;
    const now = performance.now();
    if (!centre && (seen.shown_mm ?? seen.hand_mm)) centre = [...(seen.shown_mm ?? seen.hand_mm)];
    if (engaged && seen.driver === "other" && now - touched > 1000) letGo();
    if (!drag && now - touched > SETTLED_MS && !engaged) local = null;
    const places = { hand: hand(), shown: seen.shown_mm, ghost: seen.ghost_mm };
    for (const [name, place] of Object.entries(places)) {
      if (hides(name)) { trails[name] = []; continue; }
      if (place) trails[name].push([now, place[0], place[1]]);
      while (trails[name].length && now - trails[name][0][0] > TRAIL_MS) trails[name].shift();
    }
    const words = (value, unit, digits) => (value == null ? "–" : `${value.toFixed(digits)} ${unit}`);
    at("late").textContent = seen.late_ms == null ? "–" : window.pictureLayout.sharesOf(seen.late_ms, 0, Number(at("late_parts").dataset.rate_hz)).whole;
    at("no_ghost").hidden = !stands();
    at("late_mm").textContent = words(seen.feedback_error_mm, "mm", 1);
    at("ghost_mm").textContent = words(stands() ? null : seen.ghost_error_mm, "mm", 1);
    at("key_hand").hidden = task !== null;
    at("key_ghost").hidden = task !== null && !task.ghost;
    at("late_parts").textContent = parts(seen);
    at("why").textContent = seen.why;
    at("cut").hidden = !seen.outage;
    tellFelt();
    const halt = haltOf(seen);
    at("halted").hidden = !halt;
    at("halted").classList.toggle("bad", isStopped());
    if (at("halted").textContent !== halt) at("halted").textContent = halt;
    canvas.parentElement.classList.toggle("cut", Boolean(seen.outage));
    say();
  };
  // In a run with touch: the force in words, and the page's figures of it. A page that has seen touch keeps them.
  const tellFelt = () => {
    const { felt, operator_n_m: stiffness } = seen;
    if (felt) for (const node of document.querySelectorAll(".touched")) node.hidden = false;
    if (at("felt").hidden) return;
    at("felt_words").textContent = felt ? window.pictureLayout.feltWords(felt) : "no force is told.";
    const loop = felt && !seen.outage && !stands() ? window.pictureLayout.loopWords(seen) : "";  // where nothing follows there is none
    if (at("loop").textContent !== loop) at("loop").textContent = loop;
    at("loop").className = seen.loop?.state ?? "";
    at("felt_energy").textContent = felt ? (felt.most_given_mj < 1000 ? `${felt.most_given_mj.toFixed(1)} mJ` : `${(felt.most_given_mj / 1000).toFixed(1)} J`) : "–";
    at("yields").textContent = !drives || !stiffness ? "" : `A pointer cannot push back. ${seen.yields
      ? `A simulated hand, held to it by ${stiffness.toFixed(0)} N/m, yields to the force: the dashed circle, which the arm follows.`
      : `The dashed circle shows where a hand of ${stiffness.toFixed(0)} N/m would be pushed.`}`;
  };
  // Of each state why; what the arm does in it is said in the same words everywhere, which come with the picture.
  const WHY = {
    resuming: `it comes slowly to where ${drives ? "your" : "the"} hand is.`,
    hold: "what arrives is too old or in doubt, so it waits.",
    slow_stop: "it brakes until it stands.",
    safe: "what arrives is too old or in doubt. It resumes when fresh data come; where the scenario latches it, Release is needed.",
  };
  // Why it stands: a stop, by this page or another, or the data. A page that came later may not have heard of a stop.
  const haltOf = ({ mode, doing, stopped }) => {
    const told = mode in WHY ? `The arm is ${doing}: ${WHY[mode]}` : "";
    if (mode !== "safe" || stopped === false) return told;
    if (stopped) return `${stops ? "You" : "Somebody"} pressed Stop the arms: the arm does not follow until Release, so there is no ghost.`;
    return drives ? told : `${told} If somebody pressed Stop the arms, Release ends it.`;
  };
  const isStopped = () => ["safe", "slow_stop"].includes(seen.mode);
  // An arm that was stopped goes nowhere, whatever the hand does; in an outage the hand's moves may still reach it.
  const stands = () => Boolean(seen.stopped) || (isStopped() && !seen.outage);
  const parts = ({ late_ms, network_ms, silent_s, outage, settles }) => {
    if (late_ms == null || outage) return "";
    if (silent_s != null) return ` Nothing newer arrived for ${silent_s.toFixed(1)} s.`;
    if (settles) return " The network was changed: this settles in some seconds.";
    if (network_ms == null) return "";
    const { judged_s, rate_hz } = at("late_parts").dataset;
    return window.pictureLayout.partsWords(late_ms, network_ms, Number(judged_s), Number(rate_hz));
  };
  const LAST_S = 1;
  const ended = () => `The run has ended.${seen?.moved === false ? " Nobody moved the hand." : ""}`;
  const ends = (left_s) => (window.live.isOver() ? ended() : left_s == null ? "" : left_s > 0
    ? `The drive ends in ${Math.floor(left_s / 60)}:${String(Math.floor(left_s % 60)).padStart(2, "0")} min, or with Ctrl-C in the terminal; then the ${at("left").dataset.leaves} is written.`
    : "The drive is over.");
  const say = () => {
    // a server that goes when the drive's time is up went with the run, though its last words did not come
    const line = at("driver"), isEnded = window.live.isOver() || (over && seen?.left_s != null && seen.left_s < LAST_S);
    if (at("left") && seen) at("left").textContent = ends(seen.left_s);
    line.classList.toggle("refused", Boolean(refused) && !isEnded);
    if (isEnded) line.textContent = ended();
    else if (refused) line.textContent = `Not taken: ${refused}.`;
    else if (early !== null) line.textContent = "Waiting for the arm: your drag begins when it is there.";
    else if (over) line.textContent = "The page's server does not answer any more: the run may have ended.";
    else if (!drives) line.textContent = "";
    else if (seen?.driver === "you") line.textContent = clutch ? "Clutch: your hand moves, the arm stays." : seen.unreached ? "You have the hand, but your moves do not reach the arm now: an outage."
      : isStopped() ? `You have the hand, but the arm is ${seen.doing}.` : "You drive the arm.";
    else if (seen?.driver === "other") line.textContent = "Another page drives the arm.";
    else line.textContent = seen?.hand_mm ? "Nobody drives: the hand holds. Press and drag in the picture." : "Waiting for the arm.";
  };

  // Drawing, at the screen's own pace.
  let scale = 1, view = null, inks = {};
  const x = (place) => canvas.clientWidth / 2 + (place[0] - view.centre[0]) * scale;
  const y = (place) => canvas.clientHeight / 2 - (place[1] - view.centre[1]) * scale;
  const hides = (name) => (name === "ghost" && stands()) || (task !== null && (name === "hand" || (name === "ghost" && !task.ghost)));
  const near = (place) => Math.min(Math.max(1 + (place[2] - centre[2]) / 60, 0.5), 1.6);

  const paint = () => {
    requestAnimationFrame(paint);
    const wide = canvas.clientWidth, high = canvas.clientHeight, ratio = devicePixelRatio || 1;
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
      canvas.width = Math.round(wide * ratio); canvas.height = Math.round(high * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const dark = document.documentElement.dataset.scheme === "dark" ? 1 : 0;
    for (const [name, pair] of Object.entries(tones)) inks[name] = pair[dark];
    const style = getComputedStyle(canvas);
    pen.font = `600 14px ${style.fontFamily}`;
    if (!seen?.arm || !centre) {
      pen.fillStyle = style.color; pen.textAlign = "center";
      return pen.fillText("Waiting for the arm …", wide / 2, high / 2);
    }
    const reached = hides("hand") ? null : hand(), ghost = hides("ghost") ? null : seen.ghost_mm;
    const really = at("show_arm").checked ? seen.arm_mm : null;
    const estimate = at("show_estimate").checked ? seen.estimate_mm : null;
    const places = [centre, hand(), seen.shown_mm, ghost, really, estimate, ...(task?.targets ?? [])].filter(Boolean);
    view = window.pictureLayout.follow(view, centre, places, [wide, high], WIDTH_MM);
    if (!view) return;
    scale = view.scale;
    grid(pen, wide, high, dark);
    for (const name of ["hand", "shown", "ghost"]) trail(pen, name);
    wall(pen, style);
    if (task) targets(pen, style);
    if (really) ring(pen, really, inks.arm);
    if (ghost) tool(pen, ghost, inks.ghost, true, gripper);
    if (seen.shown_mm) tool(pen, seen.shown_mm, inks.shown, false, gripper);
    if (estimate) diamond(pen, estimate, inks.estimate);
    if (reached) disc(pen, reached, inks.hand);
    const pushed = reached && drives && seen.felt ? pushedTo(reached, seen.felt) : null;
    if (pushed) {
      pen.strokeStyle = inks.hand; pen.lineWidth = 2.5; pen.setLineDash([5, 4]);
      pen.beginPath(); pen.arc(x(pushed), y(pushed), 13 * near(pushed), 0, 7); pen.stroke(); pen.setLineDash([]);
    }
    const forces = [[seen.shown_mm, seen.felt?.tool_n, inks.shown, "on the tool"], [seen.yields && pushed ? pushed : reached, seen.felt?.hand_n, inks.hand, "on the hand"]]
      .map((one) => force(pen, ...one)).filter(Boolean);
    labels(pen, { hand: reached, ghost, estimate, really }, [...forces, ...pushed ? [[seen.yields ? "the hand, pushed off" : "pushed back", pushed, inks.hand]] : [], ...behind(pen, reached, style)], [wide, high]);
    depth(pen, reached, ghost, wide, high);
  };
  // Where the force pushes a hand that is to be at a place: where a simulated one is, or where another would be.
  const pushedTo = (place, { hand_n, place_mm, meant_mm }) => (seen.yields
    ? (window.pictureLayout.arrowOf(hand_n, 1) ? place.map((value, axis) => value + place_mm[axis] - meant_mm[axis]) : null)
    : window.pictureLayout.yielded(place, hand_n, seen.operator_n_m));
  const grid = (pen, wide, high, dark) => {
    pen.strokeStyle = dark ? "#262e37" : "#e0e5ea"; pen.lineWidth = 1;
    const step = 10 * scale, left = ((x(centre) % step) + step) % step, top = ((y(centre) % step) + step) % step;
    pen.beginPath();
    for (let at_x = left; at_x < wide; at_x += step) { pen.moveTo(at_x, 0); pen.lineTo(at_x, high); }
    for (let at_y = top; at_y < high; at_y += step) { pen.moveTo(0, at_y); pen.lineTo(wide, at_y); }
    pen.stroke();
    pen.strokeStyle = pen.fillStyle = dark ? "#b4bec8" : "#4a545e"; pen.lineWidth = 2; pen.textAlign = "left";
    pen.beginPath(); pen.moveTo(14, 20); pen.lineTo(14 + step, 20); pen.stroke();
    pen.fillText("10 mm", 22 + step, 25);
  };
  const trail = (pen, name) => {
    const now = performance.now(), rows = trails[name];
    pen.strokeStyle = inks[name]; pen.lineWidth = 2.5; pen.lineCap = "round";
    for (let i = 1; i < rows.length; i++) {
      pen.globalAlpha = 0.45 * Math.max(0, 1 - (now - rows[i][0]) / TRAIL_MS);
      pen.beginPath();
      pen.moveTo(x([rows[i - 1][1], 0]), y([0, rows[i - 1][2]]));
      pen.lineTo(x([rows[i][1], 0]), y([0, rows[i][2]]));
      pen.stroke();
    }
    pen.globalAlpha = 1;
  };
  // An instrument: its shaft comes from beyond the upper edge, its jaws are at the tip.
  const tool = (pen, place, ink, ghostly, grip) => {
    const tip = [x(place), y(place)], size = near(place);
    const from = [canvas.clientWidth * 0.5, -canvas.clientHeight * 0.5];
    const angle = Math.atan2(tip[1] - from[1], tip[0] - from[0]), jaw = 26 * size, shaft = 10 * size;
    const wrist = [tip[0] - jaw * Math.cos(angle), tip[1] - jaw * Math.sin(angle)];
    pen.strokeStyle = pen.fillStyle = ink; pen.lineJoin = pen.lineCap = "round";
    pen.setLineDash(ghostly ? [9, 7] : []);
    pen.globalAlpha = ghostly ? 1 : 0.85;
    pen.lineWidth = ghostly ? 3 : shaft;
    pen.beginPath(); pen.moveTo(...from); pen.lineTo(...wrist); pen.stroke();
    pen.lineWidth = (ghostly ? 3 : 5) * size;
    const open = 0.14 + 0.35 * Math.max(0, 1 - grip);
    for (const side of [-open, open]) {
      const elbow = [wrist[0] + 0.6 * jaw * Math.cos(angle + 1.6 * side), wrist[1] + 0.6 * jaw * Math.sin(angle + 1.6 * side)];
      pen.beginPath(); pen.moveTo(...wrist); pen.lineTo(...elbow);
      const gap = 26 * (open - 0.12) * Math.sign(side) * size;
      pen.lineTo(tip[0] - gap * Math.sin(angle), tip[1] + gap * Math.cos(angle)); pen.stroke();
    }
    pen.setLineDash([]); pen.globalAlpha = 1;
  };
  const disc = (pen, place, ink) => {
    pen.strokeStyle = pen.fillStyle = ink; pen.lineWidth = 3;
    pen.beginPath(); pen.arc(x(place), y(place), 13 * near(place), 0, 7);
    pen.globalAlpha = clutch ? 0.05 : 0.25; pen.fill(); pen.globalAlpha = 1; pen.stroke();
  };
  // A force as an arrow that begins where it acts; returns its name, and where that belongs.
  const force = (pen, place, force_n, ink, where) => {
    const one = place ? window.pictureLayout.arrowOf(force_n, 0.4 * Math.min(canvas.clientWidth, canvas.clientHeight)) : null;
    if (!one) return null;
    const from = [x(place), y(place)], to = [from[0] + one.dx, from[1] + one.dy], angle = Math.atan2(one.dy, one.dx);
    pen.strokeStyle = pen.fillStyle = ink; pen.lineWidth = 5; pen.lineCap = "butt"; pen.setLineDash(one.isCut ? [8, 4] : []);
    pen.beginPath(); pen.moveTo(...from); pen.lineTo(to[0] - 8 * Math.cos(angle), to[1] - 8 * Math.sin(angle)); pen.stroke();
    pen.setLineDash([]);
    pen.beginPath(); pen.moveTo(...to);
    for (const side of [-1, 1]) pen.lineTo(to[0] - 16 * Math.cos(angle + 0.45 * side), to[1] - 16 * Math.sin(angle + 0.45 * side));
    pen.fill();
    return [`${one.size_n.toFixed(1)} N ${where}`, [place[0] + one.dx / scale, place[1] - one.dy / scale], ink];
  };
  // The surface that the arm touches, where the picture can show it: seen from its side.
  const wall = (pen, style) => {
    const { place_mm, normal } = seen.wall ?? {};
    if (!place_mm || Math.abs(normal[2]) > 0.1) return;
    const far = 2000, size = Math.hypot(normal[0], normal[1]), [nx, ny] = [normal[0] / size, normal[1] / size];
    const corner = (along, deep) => [place_mm[0] - ny * along - nx * deep, place_mm[1] + nx * along - ny * deep];
    const corners = [corner(-far, 0), corner(far, 0), corner(far, far), corner(-far, far)].map((at_mm) => [x(at_mm), y(at_mm)]);
    pen.fillStyle = pen.strokeStyle = style.color; pen.lineWidth = 3;
    pen.globalAlpha = 0.1; pen.beginPath(); for (const point of corners) pen.lineTo(...point); pen.fill();
    pen.globalAlpha = 0.6; pen.beginPath(); pen.moveTo(...corners[0]); pen.lineTo(...corners[1]); pen.stroke(); pen.globalAlpha = 1;
  };
  const ring = (pen, place, ink) => {
    pen.strokeStyle = ink; pen.lineWidth = 3; pen.setLineDash([4, 4]);
    pen.beginPath(); pen.arc(x(place), y(place), 18, 0, 7); pen.stroke(); pen.setLineDash([]);
  };
  const diamond = (pen, place, ink) => {
    const [cx, cy] = [x(place), y(place)];
    pen.fillStyle = ink; pen.beginPath();
    pen.moveTo(cx, cy - 9); pen.lineTo(cx + 9, cy); pen.lineTo(cx, cy + 9); pen.lineTo(cx - 9, cy); pen.fill();
  };
  // Targets of a task: those that are done, the next one, and where the ones to come lie.
  const targets = (pen, style) => {
    const radius = window.touchTask.RADIUS_MM * scale;
    for (const [k, place] of task.targets.entries()) {
      const isNext = k === task.next;
      pen.strokeStyle = pen.fillStyle = isNext ? inks.ghost : style.color;
      pen.lineWidth = isNext ? 4 : 1.5; pen.globalAlpha = isNext ? 1 : 0.45;
      pen.beginPath(); pen.arc(x(place), y(place), radius, 0, 7); pen.stroke();
      if (isNext) { pen.globalAlpha = task.inside ? 0.5 : 0.18; pen.fill(); pen.globalAlpha = 1; }
      pen.textAlign = "center";
      pen.fillText(k < task.next ? "\u2713" : k + 1, x(place), y(place) + 5);
    }
    pen.globalAlpha = 1;
  };
  // How far the picture is behind the hand; returns the words for it, and where they belong.
  const behind = (pen, hand, style) => {
    if (!hand || !seen.shown_mm) return [];
    const far_mm = Math.hypot(hand[0] - seen.shown_mm[0], hand[1] - seen.shown_mm[1]);
    if (far_mm < 8) return [];
    pen.strokeStyle = style.color; pen.lineWidth = 1.5; pen.setLineDash([2, 5]);
    pen.beginPath(); pen.moveTo(x(seen.shown_mm), y(seen.shown_mm)); pen.lineTo(x(hand), y(hand)); pen.stroke();
    pen.setLineDash([]);
    const middle = [0, 1].map((axis) => (hand[axis] + seen.shown_mm[axis]) / 2);
    return [[`${far_mm.toFixed(0)} mm behind`, middle, style.color]];
  };
  const labels = (pen, { hand, ghost, estimate, really }, more, size) => {
    const named = [[drives ? (seen.yields ? "your pointer" : "your hand") : "the hand", hand, inks.hand], [seen.outage ? "frozen picture" : "as you see it", seen.shown_mm, inks.shown],
      ["ghost", ghost, inks.ghost], ["the arm itself", really, inks.arm], ["estimate", estimate, inks.estimate], ...more];
    const names = named.filter(([, place]) => place).map(([text, place, ink]) =>
      ({ text, ink, x: x(place), y: y(place) + 5, width: pen.measureText(text).width }));
    const [wide, high] = size;  // the scale, and near and far
    const taken = [{ left: 0, y: 25, width: 90 + 10 * scale }, { left: wide - 50, y: 24, width: 50 }, { left: wide - 50, y: high - 14, width: 50 }];
    pen.textAlign = "left";
    for (const one of window.pictureLayout.placed(names, taken, size)) {
      pen.fillStyle = one.ink;
      pen.fillText(one.text, one.left, one.y);
    }
  };
  const depth = (pen, hand, ghost, wide, high) => {
    const [cx, top, tall] = [wide - 22, 34, high - 68];
    pen.strokeStyle = inks.shown; pen.globalAlpha = 0.35; pen.lineWidth = 2;
    pen.beginPath(); pen.moveTo(cx, top); pen.lineTo(cx, top + tall); pen.stroke();
    pen.globalAlpha = 1; pen.fillStyle = inks.shown; pen.textAlign = "right"; pen.font = pen.font.replace("600", "400");
    pen.fillText("near", wide - 8, 24); pen.fillText("far", wide - 8, high - 14);
    for (const [place, ink, radius] of [[seen.shown_mm, inks.shown, 6], [ghost, inks.ghost, 5], [hand, inks.hand, 4]]) {
      if (!place) continue;
      const share = Math.min(Math.max(0.5 - (place[2] - centre[2]) / (2 * REACH_MM[2]), 0), 1);
      pen.fillStyle = ink; pen.beginPath(); pen.arc(cx, top + share * tall, radius, 0, 7); pen.fill();
    }
  };

  // Pointer, wheel and keys; touch is a pointer.
  if (drives) {
    const press = (on) => { clutch = on; at("clutch").setAttribute("aria-pressed", on); send(); say(); };
    const grip = (on) => {
      gripper = on ? 1 : 0; at("grip").textContent = `${on ? "Open" : "Close"} the gripper (G)`;
      if (take()) move(0, 0, 0);
    };
    const steps = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0],
      PageUp: [0, 0, 1], PageDown: [0, 0, -1] };
    // A surface on which the hand is moved: `along` turns a step to the right, up and away into one along x, y and z.
    const driveOn = (surface, pxPerMm, along) => {
      const pressOn = (event) => {
        drag = { id: event.pointerId, x: event.clientX, y: event.clientY };
        early = null;
        surface.setPointerCapture(event.pointerId);
        surface.classList.add("dragged");
        if (event.buttons & 2) press(true);
        move(0, 0, 0);
      };
      surface.addEventListener("pointerdown", (event) => {
        if (take(surface)) pressOn(event);
        else if (over) return;
        else { early = event.pointerId; say(); }
        event.preventDefault();
      });
      surface.addEventListener("pointermove", (event) => {
        if (early === event.pointerId && !event.buttons) early = null;
        if (early === event.pointerId && take(surface)) pressOn(event);  // it was pressed before the arm was there
        if (drag?.id !== event.pointerId || !engaged) return;
        move(...along([(event.clientX - drag.x) / pxPerMm(), (drag.y - event.clientY) / pxPerMm(), 0]));
        drag.x = event.clientX; drag.y = event.clientY;
      });
      const lift = (event) => {
        if (early === event.pointerId) { early = null; say(); }
        if (drag?.id !== event.pointerId) return;
        drag = null; surface.classList.remove("dragged");
        if (event.button === 2) press(false);
      };
      surface.addEventListener("pointerup", lift);
      surface.addEventListener("pointercancel", lift);
      surface.addEventListener("contextmenu", (event) => event.preventDefault());
      surface.addEventListener("wheel", (event) => {
        if (!drag) return;  // else the page scrolls
        event.preventDefault();
        move(...along([0, 0, -WHEEL_MM * event.deltaY]));
      }, { passive: false });
      surface.addEventListener("keydown", (event) => {
        const step = steps[event.key];
        if (step && take(surface)) { move(...along(step.map((unit) => unit * KEY_MM))); event.preventDefault(); }
        else if (event.key === "c" && !event.repeat) press(!clutch);
        else if (event.key === "g" && !event.repeat) grip(gripper === 0);
        else if (event.key === "Escape" && engaged) {
          drag = null; touched = -Infinity;
          send();
        }
      });
    };
    driveOn(canvas, () => scale, (step) => step);
    window.live.driveOn = driveOn;
    at("clutch").addEventListener("click", () => press(!clutch));
    at("grip").addEventListener("click", () => grip(gripper === 0));
    at("depth").addEventListener("input", () => {
      if (take()) move(0, 0, at("depth").valueAsNumber - (local[2] - centre[2]));
    });
    setInterval(() => { if (performance.now() - sent >= SEND_MS - 1) send(); }, SEND_MS);
  }
  connect();
  requestAnimationFrame(paint);
})();
