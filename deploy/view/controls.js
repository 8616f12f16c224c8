"use strict";
// Forms that ask netem or the patient for something: Enter or the button sends, and a fault stands beside its field.
(() => {
  const tellAnswer = (form, text) => {
    form.closest("section").querySelector(".answer").textContent = `${form.querySelector("button").textContent}: ${text}`;
  };
  const forms = [...document.querySelectorAll("form[data-ask]")];
  const way = document.getElementById("way");
  const profile = document.getElementById("profile");
  const asking = {};  // the form that asked, by what it asked for
  const title = () => { document.getElementById("profile_title").textContent = profile.selectedOptions[0]?.dataset.title ?? ""; };

  // The number in a field, or in words why there is none.
  const number = (text, low, high) => {
    const value = text.trim() === "" ? NaN : Number(text);
    return value >= low && value <= high ? { value } : { fault: `must be a number from ${low} to ${high} (got ${text.trim() || "nothing"})` };
  };
  const tell = (input, fault) => {
    input.setAttribute("aria-invalid", Boolean(fault));
    document.getElementById(`${input.id}_fault`).textContent = fault;
  };
  // What a delay is of: of each way alone, where a task's buttons mean there and back.
  const ways = (value, way) => (value === undefined ? "" : {
    both: `each way: ${value} there and ${value} back`, forward: `${value} there, back as it is`, feedback: `there as it is, ${value} back`,
  }[way]);
  // Delay and loss show what netem is set to, until a value is typed: from then on that, until it is set or given up.
  const shown = ["delay", "loss"].map((ask) => document.getElementById(ask)), typed = new Set();
  const ENDS = { delay: [shown[0]], loss: [shown[1]], reset: shown, profile: shown, task: shown };
  let set = { delay: [null, null], loss: [null, null] }, queues = false;
  const follow = () => {
    for (const input of shown.filter((one) => !typed.has(one))) {
      const [there, back] = set[input.id];
      input.value = { forward: there, feedback: back, both: there === back ? there : null }[way.value] ?? "";
    }
    const [delay] = shown, [there, back] = set.delay, isKnown = there !== null && back !== null;
    const asked = typed.has(delay) ? ways(number(delay.value, delay.dataset.low, delay.dataset.high).value, way.value) : "";
    const now = !isKnown ? "" : there === back ? ways(there, "both") : `${there} there and ${back} back`;
    const line = document.getElementById("delay_ways"), words = [asked, now && `now ${now}`, queues && "the wait in a queue comes on top"].filter(Boolean).join("; ");
    if (line.textContent !== words) line.textContent = words;
  };
  const check = (input) => {
    const found = number(input.value, Number(input.dataset.low), Number(input.dataset.high));
    tell(input, found.fault ?? "");
    return found.value;
  };

  for (const form of forms) {
    const input = form.querySelector("input"), { ask } = form.dataset;
    input?.addEventListener("input", () => { typed.add(input); check(input); follow(); });
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const request = { ask };
      if (form.dataset.value) request.value = Number(form.dataset.value);
      if (input) {
        request.value = check(input);
        if (request.value === undefined) return input.focus();
        request.way = way.value;
      }
      if (ask === "profile") request.profile = profile.value;
      if (ask === "reset") {
        for (const one of forms) { one.reset(); const field = one.querySelector("input"); if (field) tell(field, ""); }
        typed.clear();
        way.value = "both";
        title();
        follow();
      }
      asking[ask] = form;
      tellAnswer(form, window.live.ask(request) ? "sent …" : "not sent, the connection is lost");
    });
  }
  profile.addEventListener("change", title);
  title();
  way.addEventListener("change", follow);

  const usable = (on) => { for (const one of document.querySelectorAll(".asks :is(button, input, select)")) one.disabled = !on; };
  usable(false);
  window.live.on((message) => {
    if ("network" in message) {
      usable(message.network);
      ({ set, queues } = message);
      follow();
    }
    const form = asking[message.asked];
    delete asking[message.asked];
    if (message.answer?.startsWith("done")) for (const input of ENDS[message.asked] ?? []) { typed.delete(input); tell(input, ""); }
    if (form) tellAnswer(form, message.answer);
    else if (message.asked) way.closest("section").querySelector(".answer").textContent = "";  // a task's delay ended what it tells
  });
  window.live.onClose(() => usable(false));
  window.live.number = number;
})();
