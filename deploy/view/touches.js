"use strict";
// The task of touches on the page: one click sets the delay and shows the targets; its rows stay until the page closes.
(() => {
  const at = (id) => document.getElementById(id);
  const buttons = [...document.querySelectorAll("[data-touch_ms]")];
  if (!buttons.length) return;  // a page that does not drive
  const { begin, step, isOver, noted, spoilt, rowOf, read, csvOf, N_TARGETS, MAX_ROWS } = window.touchTask;
  const KEY = "tis touches";
  let rows = [], task = null, waits = null, now_s = 0, asked_s = 0;
  try { rows = read(sessionStorage.getItem(KEY)); } catch { /* a page that may keep nothing has them while it is open */ }

  const say = (text) => { if (at("touching").textContent !== text) at("touching").textContent = text; };
  const show = () => {
    at("touched").hidden = at("touched_csv").hidden = !rows.length;
    at("touched_csv").href = `data:text/csv;charset=utf-8,${encodeURIComponent(csvOf(rows))}`;
    const cells = ({ delay_ms, ghost, time_s, path_mm, n_misses }) =>
      [`${delay_ms} ms`, ghost ? "picture and ghost" : "late picture", `${time_s.toFixed(1)} s`, `${path_mm.toFixed(0)} mm`, n_misses];
    at("touched").querySelector("tbody").replaceChildren(...rows.map((row) => {
      const line = document.createElement("tr");
      line.append(...cells(row).map((text) => Object.assign(document.createElement("td"), { textContent: text })));
      return line;
    }));
  };
  const leave = (text) => {
    task = waits = null;
    window.live.setTask(null);
    at("give_up").hidden = true;
    say(text);
  };
  for (const button of buttons) {
    button.addEventListener("click", () => {
      const delay_ms = Number(button.dataset.touch_ms), ghost = at("with_ghost").checked;
      if (!window.live.take()) return say("Not begun: the arm is not there yet, or the connection is lost.");
      waits = { delay_ms, ghost };
      asked_s = now_s;
      task = null;
      window.live.setTask(null);
      at("give_up").hidden = false;
      say(`Setting ${delay_ms} ms there and back …`);
      window.live.ask({ ask: "task", value: delay_ms });
      at("drive").scrollIntoView({ block: "nearest" });
    });
  }
  at("give_up").addEventListener("click", () => leave("Given up; the network keeps this delay until Reset."));

  window.live.on((message) => {
    now_s = message.now_s ?? now_s;
    if ("network" in message) for (const button of buttons) button.disabled = !message.network;
    if (message.asked === "task" && waits) {
      if (!message.answer.startsWith("done")) return leave(`Not begun: ${message.answer}`);
      task = begin(window.live.home(), waits, asked_s);
      waits = null;
    }
    // what was told of a task that is over is of the past once the arm is stopped, or something is asked
    if (!task && !waits && (message.stopped || message.asked)) say("");
    if (!task || !message.arm_mm) return;
    if (message.driver === "other") return leave("Another page drives the arm.");
    if (window.live.isOver()) return leave("The run has ended.");
    task = noted(task, message.set);
    const why = spoilt(task, message);
    if (why) return leave(why);
    const before = task.next;
    // all of the arm's path counts, not what pictures happen to show
    for (const [at_ms, ...arm_mm] of message.arm_path) task = step(task, at_ms, arm_mm);
    window.live.setTask({ targets: task.targets, next: task.next, inside: task.inside_ms !== null, ghost: task.label.ghost });
    if (isOver(task)) {
      rows = [...rows, rowOf(task)].slice(-MAX_ROWS);
      try { sessionStorage.setItem(KEY, JSON.stringify(rows)); } catch { /* as above */ }
      const { delay_ms, ghost, time_s, path_mm, n_misses } = rows.at(-1);
      if (window.live.take()) window.live.send({ target_run: { delay_ms, with_ghost: ghost, time_s, path_mm, n_misses } });
      show();
      leave(`Done with ${delay_ms} ms: ${time_s.toFixed(1)} s, ${path_mm.toFixed(0)} mm, ${n_misses} ${n_misses === 1 ? "miss" : "misses"}.`);
    } else if (before !== task.next || !at("touching").textContent.startsWith("Bring")) {
      say(`Bring the arm to target ${task.next + 1} of ${N_TARGETS}, and keep it there: drag, or use the arrow keys.`);
    }
  });
  window.live.onClose(() => { for (const button of buttons) button.disabled = true; if (task || waits) leave(window.live.isOver() ? "The run has ended." : "The run may have ended, or the connection is lost."); });
  show();
})();
