"use strict";
// Forms that ask netem or the patient for something: Enter or the button sends, and a fault stands beside its field.
(() => {
  const tellAnswer = (form, text) => {
    form.closest("section").querySelector(".answer").textContent = `${form.querySelector("button").textContent}: ${text}`;
  };
  const forms = [...document.querySelectorAll("form[data-ask]")];
  const way = document.getElementById("way");
  const profile = document.getElementById("profile");
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
  const delay = document.getElementById("delay");
  const tellWays = () => {
    document.getElementById("delay_ways").textContent = ways(number(delay.value, delay.dataset.low, delay.dataset.high).value, way.value);
  };
  const check = (input) => {
    const found = number(input.value, Number(input.dataset.low), Number(input.dataset.high));
    tell(input, found.fault ?? "");
    return found.value;
  };

  for (const form of forms) {
    const input = form.querySelector("input"), { ask } = form.dataset;
    input?.addEventListener("input", () => { check(input); tellWays(); });
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const request = { ask };
      if (input) {
        request.value = check(input);
        if (request.value === undefined) return input.focus();
        request.way = way.value;
      }
      if (ask === "profile") request.profile = profile.value;
      if (ask === "reset") {
        for (const one of forms) { one.reset(); const field = one.querySelector("input"); if (field) tell(field, ""); }
        way.value = "both";
        title();
        tellWays();
      }
      tellAnswer(form, window.live.ask(request) ? "sent …" : "not sent, the connection is lost");
    });
  }
  profile.addEventListener("change", title);
  title();
  way.addEventListener("change", tellWays);
  tellWays();

  const usable = (on) => { for (const one of document.querySelectorAll(".asks :is(button, input, select)")) one.disabled = !on; };
  usable(false);
  window.live.on((message) => {
    if ("network" in message) usable(message.network);
    const form = forms.find((one) => one.dataset.ask === message.asked);
    if (form) tellAnswer(form, message.answer);
    else if (message.asked) way.closest("section").querySelector(".answer").textContent = "";  // a task's delay ended what it tells
  });
  window.live.onClose(() => usable(false));
  window.live.number = number;
})();
